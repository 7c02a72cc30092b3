"""What to fly next, so that the recordings can tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bhm_service.battery.effects import EFFECTS, WeakCell
from bhm_service.battery.effects.self_heating import SelfHeating
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.explanation import Contest
from bhm_service.discrepancy.findings import Verdict
from bhm_service.discrepancy.first_order import expected_snr
from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.manoeuvres import MENU, ORDINARY, Manoeuvre
from bhm_service.discrepancy.odds import LEAST_SNR, Names
from bhm_service.discrepancy.search import Search
from bhm_service.discrepancy.selection import Selection
from bhm_service.units import Array

_ENOUGH = 5.0  # standard deviations by which two explanations have to part
_MOST = 3  # rivals, and effects of a line, that are told of
_AIR, _START = f"{SelfHeating.id}.ambient", f"{SelfHeating.id}.start_above"  # of a temperature that nobody recorded


def advice(
    found: Search, chosen: Selection, verdict: Verdict, tried: Sequence[Candidate] = (), rivals: Sequence[Contest] = ()
) -> list[str]:
    """The cheapest manoeuvre, by simulation, that would settle what is open; nothing where nothing is.

    That is each rivalry of an ambiguous verdict, with another set or with a phantom driver (``rivals``), and which of
    the effects ``tried`` are there at all where the flights could show hardly any.
    """
    if verdict == "ambiguous":
        sets = [_set(found, chosen.names, names) for names in chosen.alternatives[:_MOST]]
        unbeaten = [c for c in rivals if not c.beaten and c.rival is not None and c.driver is not None]
        flown = _settling(found, [*sets, *(_phantom(found, chosen.names, c) for c in unbeaten)])
        return [*_by_cells(found, chosen), *flown]
    return _exciting(found, tried) if verdict == "not-excited" else []


def _by_cells(found: Search, chosen: Selection) -> list[str]:
    """What needs no manoeuvre: voltages of single cells show a weak one beside the others on any flight."""
    weak = frozenset({WeakCell.id})
    disputed = [names for names in chosen.alternatives if weak <= chosen.names ^ names]
    if not disputed or found.credit(weak):
        return []
    rivals = sorted({_title(chosen.names, names) for names in disputed})
    return [f"Record the voltages of single cells (BATTERY_STATUS): they tell it from {' or '.join(rivals)}."]


@dataclass(frozen=True, slots=True)
class _Rivalry:
    """Two explanations that the flights do not tell apart."""

    against: str
    apart: Callable[[FlightData, Manoeuvre], Array]  # their voltages of a flight to come, one less the other [V]
    special: str  # what would tell them apart beside flights


def _title(names: Names, rival: Names) -> str:
    """What a rival has that a set has not; all of it, where it is a part of that."""
    return " and ".join(sorted(rival - names) or sorted(rival))


def _set(found: Search, names: Names, rival: Names) -> _Rivalry:
    one, other = found.fitted(names), found.fitted(rival)
    special = next((EFFECTS[n].manoeuvre for n in sorted(names - rival)), "")
    return _Rivalry(_title(names, rival), lambda data, m: _said(one, data, m) - _said(other, data, m), special)


def _phantom(found: Search, names: Names, contest: Contest) -> _Rivalry:
    one, rival, driver = found.fitted(names), contest.rival, contest.driver
    assert rival is not None and driver is not None
    driven = [m.id for m in one.joint.members if m.inferred or m.driven_by_temperature]

    def apart(data: FlightData, manoeuvre: Manoeuvre) -> Array:
        return _said(one, data, manoeuvre) - _said(rival, replace(data, temperature_k=driver(data)), manoeuvre)

    return _Rivalry(f"{contest.decoy} as its driver", apart, EFFECTS[driven[0]].manoeuvre)


def _settling(found: Search, rivalries: Sequence[_Rivalry]) -> list[str]:
    """Of each rivalry the cheapest manoeuvre by which it parts, or in words what no ordinary flight shows."""
    parted: dict[Manoeuvre, list[tuple[str, float]]] = {}
    said = []
    for rivalry in rivalries:
        cheapest = _cheapest(found, rivalry)
        if cheapest is not None:
            manoeuvre, sigma = cheapest
            parted.setdefault(manoeuvre, []).append((rivalry.against, sigma))
        elif rivalry.special:
            said.append(f"Against {rivalry.against}: no flight tells the two apart; {rivalry.special}.")
    for manoeuvre, against in parted.items():
        *more, last = (f"{rival} ({sigma:.0f} sigma)" for rival, sigma in against)
        told = f"{', '.join(more)} or {last}" if more else last
        said.append(f"{_sentence(manoeuvre)}: it would tell it from {told}.")
    return list(dict.fromkeys(said))


def _cheapest(found: Search, rivalry: _Rivalry) -> tuple[Manoeuvre, float] | None:
    """The cheapest manoeuvre that settles a rivalry, and by how many standard deviations; None where none does."""

    def sigma(manoeuvre: Manoeuvre) -> float:
        data = _with(found, manoeuvre)
        return _outstanding(found, rivalry.apart(data, manoeuvre), data)

    ordinary = sigma(ORDINARY)  # which did not settle it
    for manoeuvre in MENU:
        more = float(np.sqrt(max(sigma(manoeuvre) ** 2 - ordinary**2, 0.0)))
        if more > _ENOUGH:
            return manoeuvre, more
    return None


def _exciting(found: Search, tried: Sequence[Candidate]) -> list[str]:
    """The cheapest manoeuvres that show effects which these flights could not, each with what it shows."""
    dull = [c for c in tried if c.id in found.snr and found.snr[c.id] < LEAST_SNR and not c.inferred]
    said = []
    for manoeuvre in MENU:
        at = _as_it_is(found, _with(found, manoeuvre))
        of = {c.id: _shown(found, c, at) for c in dull}
        shown = sorted((name for name in of if of[name] >= LEAST_SNR), key=lambda name: -of[name])
        if shown:
            named = ", ".join(f"{name} ({of[name]:.0f} sigma)" for name in shown[:_MOST])
            more = f" and {len(shown) - _MOST} more" if len(shown) > _MOST else ""
            said.append(f"{_sentence(manoeuvre)}: it would show whether there is {named}{more}.")
            dull = [c for c in dull if c.id not in shown]
    dullest = sorted(dull, key=lambda c: found.snr[c.id])[:_MOST]
    return said or [f"{EFFECTS[c.id].title}: {EFFECTS[c.id].manoeuvre}." for c in dullest]


def _as_it_is(found: Search, data: FlightData) -> Fitted[Joint]:
    """The battery on a flight that is as the battery says."""
    bare = Joint(found.base.lab, (data,))
    told = replace(data, voltage_v=np.asarray(bare.predicted(bare.unknowns.start[None, :], 0).voltage[0]))
    return fit(replace(bare, flights=(told,)), found.noise)


def _shown(found: Search, candidate: Candidate, at: Fitted[Joint]) -> float:
    """By how many standard deviations an effect of the usual size would stand out of a flight of the battery."""
    own = candidate.on([_usual(found)])
    return expected_snr(at, replace(at.joint, members=(own,)), own)


def _sentence(manoeuvre: Manoeuvre) -> str:
    return manoeuvre.words[0].upper() + manoeuvre.words[1:]


def _usual(found: Search) -> int:
    """The longest flight: what one with a manoeuvre is made of."""
    return max(range(len(found.base.flights)), key=lambda k: float(found.base.flights[k].time_s[-1]))


def _with(found: Search, manoeuvre: Manoeuvre) -> FlightData:
    """An ordinary flight with a manoeuvre, not measured yet."""
    usual = found.base.flights[_usual(found)]
    data = manoeuvre.flown(replace(usual, voltage_v=np.zeros_like(usual.voltage_v)), found.base.lab.capacity_c)
    return replace(data, notes=replace(data.notes, rest_voltage_v=None))


def _outstanding(found: Search, difference: Array, data: FlightData) -> float:
    """Standard deviations of a difference in voltage over a flight whose start and resistance are left free."""
    whitened = found.noise.whitened(difference[None, :])[0]
    level = found.noise.whitened(np.vstack([np.ones(whitened.size), data.current_a]))
    free = np.linalg.lstsq(level.T, whitened, rcond=None)[0]
    return float(np.sqrt(np.sum((whitened - free @ level) ** 2)))


def _said(fitted: Fitted[Joint], data: FlightData, manoeuvre: Manoeuvre) -> Array:
    """A new flight by a fit: what all flights share as found, what differs between them at its mean."""
    members: tuple[Candidate, ...] = tuple(
        replace(c, fixed={key: [told[-1]] for key, told in c.fixed.items()}) for c in fitted.joint.members
    )
    joint = Joint(fitted.joint.lab, (data,), members)
    x = joint.unknowns.start.copy()
    for block in fitted.joint.unknowns.blocks:
        values = fitted.x[fitted.joint.unknowns.slice_of(block.name)]
        shared = block.name not in fitted.joint.per_flight
        x[joint.unknowns.slice_of(block.name)] = values if shared else values.mean()
    if manoeuvre.soaked_k is not None and _AIR in joint.places:
        x[joint.places[_AIR]], x[joint.places[_START]] = manoeuvre.soaked_k, 0.0
    return np.asarray(joint.predicted(x[None, :], 0, forms=False).voltage[0])
