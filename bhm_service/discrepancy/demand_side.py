"""The demand side of an explanation: power given motion, against the demand model of the vehicle file.

It shares nothing with the battery's side but the recordings and a current sensor's zero, so a payload can never be
named a cold battery.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.config import Vehicle
from bhm_service.discrepancy.demand_drift import drifting
from bhm_service.discrepancy.demand_model import (
    EXACT,
    LEVEL_SD,
    Craft,
    Demand,
    Flown,
    Term,
    Zero,
    airs_k,
    craft_of,
    flown_of,
)
from bhm_service.discrepancy.demand_search import PAYLOAD, Chosen, DemandSearch, Fit, choose, rms, search, unseen
from bhm_service.discrepancy.demand_words import demand_effect_in_words, demand_sentence
from bhm_service.discrepancy.findings import ChangePoint, EffectFound, Quantity, Verdict
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.odds import LEAST_SNR
from bhm_service.prediction.demand_effects import DEMAND_EFFECTS, DemandEffect
from bhm_service.prediction.demand_file import KnownDemand
from bhm_service.units import Array

_FEWEST = 2  # flights
_SAMPLES = 800  # of a flight, as on the battery's side
_SEED = 1
_SHIFTED = 3.0  # standard deviations by which the level of the hover has moved
_SLOW_S = 60.0  # misfit faster than this is wind and control
# Slow misfit in a flight, of the hover's power: three times the most that wind leaves (1 % in the concealed world's
# nulls), or half of that where other flights have a third of it.
_STRANGE, _UNLIKE = 0.03, 3.0
# No equation of the catalogue is exact: a rotor's profile power goes with the weight, not with its power of 3/2, and
# grows with speed. A number means what it says to this share.
_FORM_SD = 0.05
_REST = 0.15  # of the misfit: what is left beyond this is said to be left


@dataclass(frozen=True, slots=True)
class PowerCourse:
    """One flight in the air: power measured and modelled. [W] (T,)"""

    flight: Flown
    before_w: Array  # by the vehicle file, its hover at the level that these flights have
    after_w: Array  # by the explanation


@dataclass(frozen=True, slots=True, kw_only=True)
class DemandSide:
    """What the flights' power says of the vehicle file."""

    craft: Craft
    verdict: Verdict
    effects: tuple[EffectFound, ...]
    asked_for: tuple[float, ...]  # of the evidence of each [nats]
    alternatives: tuple[tuple[str, ...], ...]
    change_points: tuple[ChangePoint, ...]
    rest: float
    level: Quantity  # by how much the hover takes more than the file says, as a share
    noise: float  # of the hover's power
    errors_w: tuple[float, float]  # before and after, on the flights of the fit
    unseen_w: tuple[float, float] | None  # the same on what no fit saw
    courses: tuple[PowerCourse, ...]
    sentence: str
    in_words: tuple[str, ...]
    not_shown: tuple[str, ...]  # effects that these flights could not show
    repaired: tuple[KnownDemand, ...] | None  # the demand model with what was found; None where nothing was
    efficiency: float  # of the hover, with its level moved


@dataclass(frozen=True, slots=True)
class NotLooked:
    """Why the demand was not looked at."""

    because: str


def demand_side(
    vehicle: Vehicle | None, flights: Sequence[FlightData], missing_a: float = 0.0
) -> DemandSide | NotLooked:
    """Diagnose the power of the flights, where a vehicle file and their motion allow it.

    ``missing_a`` is what the battery's side found the current sensor to read too little at all times. [A]
    Raises BadInputError for a wrong demand table of the vehicle file.
    """
    if vehicle is None:
        return NotLooked("no vehicle file was given (--vehicle)")
    craft = craft_of(vehicle, vehicle.name)
    if craft is None:
        return NotLooked("the vehicle file has no [rotors]")
    airs = airs_k(flights)
    zero = EXACT
    if missing_a:
        zero = Zero(missing_a, float(np.nanmean(np.concatenate([f.voltage_v[f.airborne] for f in flights]))))
    told = (flown_of(data.thinned(_SAMPLES), air_k, zero) for data, air_k in zip(flights, airs, strict=True))
    flown = [f for f in told if f is not None]
    if len(flown) < _FEWEST:
        return NotLooked(f"{len(flown)} of the flights tell climb and speed in the air, {_FEWEST} are needed")
    found = search(Demand(craft, tuple(flown)))
    return _found(found, choose(found, np.random.default_rng(_SEED)))


def _found(found: DemandSearch, chosen: Chosen) -> DemandSide:
    craft = found.base.craft
    bare, fitted = found.fitted(frozenset()), found.fitted(chosen.names)
    courses = tuple(
        PowerCourse(data, bare.joint.predicted(_shared(bare), k)[0], fitted.joint.predicted(_shared(fitted), k)[0])
        for k, data in enumerate(found.base.flights)
    )
    before = [(c.flight.power_w - c.before_w) / craft.hover_w for c in courses]
    after = [(c.flight.power_w - c.after_w) / craft.hover_w for c in courses]
    errors = rms(before), rms(after)
    effects = _effects(found, chosen, fitted, max(1.0 - (errors[1] / errors[0]) ** 2, 0.0))
    slow = [_slow(a, c.flight) for a, c in zip(after, courses, strict=True)]
    # What one flight's hover is off by is scatter, not a shape that no effect has.
    left = [rms([_slow(m, f)]) for m, f in zip(fitted.joint.misfits(fitted.x), fitted.joint.flights, strict=True)]
    drift = drifting(fitted)
    strange = drift is not None or max(left) > min(_STRANGE, max(_UNLIKE * float(np.median(left)), _STRANGE / 2.0))
    where = fitted.joint.places["level"]
    level = Quantity(value=float(np.expm1(fitted.x[where][0])), sd=float(fitted.sd("level")[0]), unit="1")
    verdict: Verdict = "none"
    if chosen.names:
        verdict = "ambiguous" if chosen.alternatives else "named"
    elif strange:
        verdict = "unknown"
    elif abs(float(fitted.x[where][0])) > _SHIFTED * LEVEL_SD:
        verdict = "parameter"
    rest = (rms(slow) / max(rms([_slow(b, c.flight) for b, c in zip(before, courses, strict=True)]), 1e-9)) ** 2
    much = verdict == "unknown" or (bool(chosen.names) and rest > _REST)
    held = unseen(found, chosen.names), unseen(found, frozenset())
    unseen_w = (
        None if held[0] is None or held[1] is None else (craft.hover_w * rms(held[1]), craft.hover_w * rms(held[0]))
    )
    alternatives = tuple(dict.fromkeys(tuple(sorted(found.ids(names))) for names in chosen.alternatives))
    shown = {t.id for t in found.terms} | {k.effect.id for k in craft.known}
    return DemandSide(
        craft=craft,
        verdict=verdict,
        effects=tuple(effects),
        asked_for=tuple(found.needed(t.key) for t in _by_size(chosen, fitted)),
        alternatives=alternatives,
        change_points=tuple(
            ChangePoint(flight=flight, time_s=time_s) for t in fitted.joint.terms for flight, time_s in t.change_points
        ),
        rest=float(np.clip(rest, 0.0, 1.0)) if strange and much else 0.0,
        level=level,
        noise=found.noise.sigma_v,
        errors_w=(craft.hover_w * errors[0], craft.hover_w * errors[1]),
        unseen_w=unseen_w,
        courses=courses,
        sentence=demand_sentence(verdict, [e.id for e in effects], alternatives, level.value, drift),
        in_words=tuple(demand_effect_in_words(t, fitted) for t in _by_size(chosen, fitted)),
        not_shown=tuple(name for name in DEMAND_EFFECTS if name not in shown and found.snr.get(name, 0.0) < LEAST_SNR),
        repaired=_repaired(fitted) if chosen.names or verdict == "parameter" else None,
        efficiency=craft.efficiency / (1.0 + level.value),
    )


def _shared(fitted: Fit) -> Array:
    """A fit's numbers without what only one flight's hover is off by. (1, n)"""
    x = fitted.x.copy()
    x[fitted.joint.places["flight"]] = 0.0
    return x[None, :]


def _slow(misfit: Array, flight: Flown) -> Array:
    width = max(int(_SLOW_S / max(float(np.median(np.diff(flight.time_s))), 0.1)), 1)
    return np.convolve(misfit, np.full(width, 1.0 / width), mode="valid" if misfit.size > width else "same")


def _by_size(chosen: Chosen, fitted: Fit) -> list[Term]:
    return sorted(fitted.joint.terms, key=lambda t: -chosen.added[t.key])


def _effects(found: DemandSearch, chosen: Chosen, fitted: Fit, explained: float) -> list[EffectFound]:
    power = sum(size**2 for size in chosen.added.values()) or 1.0
    return [
        EffectFound(
            id=term.id,
            parameters=_parameters(term, fitted),
            evidence_nats=float(chosen.earned[term.key]),
            p_familywise=chosen.p_familywise[term.key],
            share_of_misfit=float(explained * chosen.added[term.key] ** 2 / power),
            decoys_beaten=None,
        )
        for term in _by_size(chosen, fitted)
    ]


def _parameters(term: Term, fitted: Fit) -> dict[str, Quantity]:
    (declared,) = term.kind.parameters()
    x = fitted.x[fitted.joint.places[term.key]]
    sd = np.hypot(fitted.sd(term.key), _FORM_SD * x)
    labels = [f"{declared.name}[{f.label}]" for f in fitted.joint.flights] if term.per_flight else [declared.name]
    return {
        label: Quantity(value=float(v), sd=float(s), unit=declared.unit)
        for label, v, s in zip(labels, x, sd, strict=True)
    }


def _repaired(fitted: Fit) -> tuple[KnownDemand, ...]:
    """The demand model with all numbers where the flights put them; what differs from flight to flight stays out."""
    found = []
    for known in fitted.joint.craft.known:
        key = f"known.{known.effect.id}"
        found.append(_known(type(known.effect), float(fitted.x[fitted.joint.places[key]][0]), float(fitted.sd(key)[0])))
    for term in fitted.joint.terms:
        if term.id != PAYLOAD:
            (told,) = _parameters(term, fitted).values()
            found.append(_known(term.kind, told.value, told.sd))
    return tuple(found)


def _known(kind: type[DemandEffect], value: float, sd: float) -> KnownDemand:
    (declared,) = kind.parameters()
    return KnownDemand(effect=kind(**{declared.name: value}), sd=sd)
