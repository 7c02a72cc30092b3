"""The demand side in words for a flight engineer: its verdict in a sentence, each effect's size."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from bhm_service.discrepancy.demand_model import Craft, Demand, Term
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.labels import flight_name, flights_in_words
from bhm_service.prediction.demand_effects import DEMAND_EFFECTS, DemandEffect, Motion, demanded
from bhm_service.units import Array

_CLIMB_MPS, _SINK_MPS = 3.0, -1.5
_FAST = 0.98  # quantile of the airspeeds that stands for the fastest


def demand_titles(ids: Sequence[str]) -> str:
    """What effects say, joined."""
    titles = [DEMAND_EFFECTS[name].title for name in ids]
    return " and ".join(t[0].lower() + t[1:] for t in titles)


def demand_sentence(
    verdict: str,
    ids: Sequence[str],
    alternatives: Sequence[Sequence[str]],
    level: float,
    drift: float | None = None,
) -> str:
    """The verdict in one sentence; ``level``: by which share the hover takes more than the vehicle file says, and
    ``drift``: by which it takes more at the end of a flight than at its beginning, if nothing explains that.
    """
    if verdict == "named":
        return f"The vehicle file leaves out physics of the demand: {demand_titles(ids)}."
    if verdict == "ambiguous":
        told = ", or ".join(demand_titles(names) for names in (ids, *alternatives))
        return f"The vehicle file leaves out physics of the demand, but these flights cannot tell which: {told}."
    if verdict == "unknown":
        if drift is not None:
            way = "more" if drift > 0.0 else "less"
            return (
                "The flights ask for power that no demand effect of the catalogue explains: flown alike, they take "
                f"{100.0 * abs(drift):.1f} % {way} of the hover's power at their end than after take-off."
            )
        return "The flights ask for power that no demand effect of the catalogue explains."
    if verdict == "parameter":
        way = "more" if level > 0.0 else "less"
        return (
            f"The hover takes {100.0 * abs(level):.0f} % {way} power than the vehicle file says, on all flights: its "
            "mass, its efficiency or the current sensor is not as it says, and only a balance tells which."
        )
    return "Nothing is missing in the demand that these flights could show."


def demand_effect_in_words(term: Term, fitted: Fitted[Demand]) -> str:
    """An effect's size at these flights."""
    return _WORDS[term.id](term, fitted)


def _percent(ratio: float) -> str:
    return f"{100.0 * abs(ratio - 1.0):.0f} % {'more' if ratio >= 1.0 else 'less'} power"


def _at(craft: Craft, effect: DemandEffect, **how: float) -> float:
    """Power over that of the hover."""
    return float(np.ravel(demanded([effect], Motion(mass_kg=craft.mass_kg, disc_area_m2=craft.disc_area_m2, **how)))[0])


def _effect(term: Term, fitted: Fitted[Demand]) -> DemandEffect:
    (declared,) = term.kind.parameters()
    return term.kind(**{declared.name: float(fitted.x[fitted.joint.places[term.key]][0])})


def _all(fitted: Fitted[Demand], name: str) -> Array:
    return np.concatenate([getattr(f, name) for f in fitted.joint.flights])


def _climb(term: Term, fitted: Fitted[Demand]) -> str:
    craft, effect = fitted.joint.craft, _effect(term, fitted)
    return (
        f"Climbing at {_CLIMB_MPS:g} m/s costs {_percent(_at(craft, effect, climb=_CLIMB_MPS))} than the hover, "
        f"sinking at {-_SINK_MPS:g} m/s {_percent(_at(craft, effect, climb=_SINK_MPS))}."
    )


def _fast(term: Term, fitted: Fitted[Demand]) -> str:
    speed = float(np.quantile(_all(fitted, "airspeed_mps"), _FAST))
    ratio = _at(fitted.joint.craft, _effect(term, fitted), airspeed=speed)
    why = "the drag costs" if term.id == "wind-tilt" else "the flow through the rotors makes it"
    return f"At {speed:.0f} m/s through the air {why} {_percent(ratio)} than the hover."


def _density(term: Term, fitted: Fitted[Demand]) -> str:
    thin = float(_all(fitted, "density").min())
    ratio = _at(fitted.joint.craft, _effect(term, fitted), density=thin)
    return f"In the thinnest air flown in, {thin:.2f} kg/m3, the hover takes {_percent(ratio)} than at sea level."


def _payload(term: Term, fitted: Fitted[Demand]) -> str:
    mass_kg, x = fitted.joint.craft.mass_kg, fitted.x[fitted.joint.places[term.key]]
    every = [f.label for f in fitted.joint.flights]
    dropped = {flight for flight, _ in term.change_points}
    if term.per_flight:
        low, high = every[int(np.argmin(x))], every[int(np.argmax(x))]
        return (
            f"From flight to flight the mass differs from {100.0 * x.min():+.0f} % (flight {flight_name(low)}) to "
            f"{100.0 * x.max():+.0f} % (flight {flight_name(high)}), {mass_kg * np.ptp(x):.2f} kg between them."
        )
    carried = [label for label, shape in zip(every, term.shapes, strict=True) if shape.any()]
    others = "its own" if len(carried) == len(every) else "on the others"
    text = (
        f"On {flights_in_words(carried, every)} the vehicle carried {100.0 * x[0]:.1f} % of its mass "
        f"({mass_kg * x[0]:.2f} kg) more than {others}: {_percent((1.0 + float(x[0])) ** 1.5)}"
    )
    if not dropped:
        return text + "."
    all_of_them = "" if dropped == set(carried) else f" on {flights_in_words(sorted(dropped), every)}"
    return f"{text}, until it was let go{all_of_them}."


def _efficiency(term: Term, fitted: Fitted[Demand]) -> str:
    first, last = (flight_name(fitted.joint.flights[k].label) for k in (0, -1))
    ratio = 1.0 / (1.0 - float(fitted.x[fitted.joint.places[term.key]][0]))
    return f"By the last flight ({last}) the rotors take {_percent(ratio)} than on the first ({first}), step by step."


_WORDS: dict[str, Callable[[Term, Fitted[Demand]], str]] = {
    "air-density": _density,
    "payload-mass": _payload,
    "wind-tilt": _fast,
    "translational-lift": _fast,
    "climb-power": _climb,
    "propulsion-efficiency": _efficiency,
}
