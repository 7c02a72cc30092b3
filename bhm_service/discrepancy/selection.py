"""Which of the fitted sets is the explanation, and which others the recordings cannot tell from it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.search import NATS, NEAR, STRUCTURAL, Names, Search, needed

_RIVALLED = 2  # of the best sets, whose members are held against their mimics
LEAST_V = 0.001  # [V] of a cell: what adds less than this to the voltage changes nothing that anybody flies by
_STRUCTURAL_V = 0.004  # [V] of a cell: the same for what looks like an error of the model's structure
_LEAST_SHARE = 0.33  # of the largest member's, a tenth in power: thrice what that one's own equation may be off by
_REACH = 0.995  # of the way to a bound of what is physical
_ORDER = {name: place for place, name in enumerate(EFFECTS)}  # the commoner first


@dataclass(frozen=True, slots=True)
class Selection:
    """The chosen set and its rivals."""

    names: Names
    alternatives: tuple[Names, ...]
    earned: dict[str, float]  # [nats] of evidence that each member adds to the others
    added_v: dict[str, float]  # [V] RMS that each member adds to the pack's voltage


def select(found: Search, refuted: Collection[Names] = ()) -> Selection:
    """The best of the sets whose every member earns its place; among equals the simplest, then the commonest."""
    for names in found.ranked()[:_RIVALLED]:
        _swaps(found, names)
    valid = [names for names in found.ranked() if names and names not in refuted and _stands(found, names)]
    best = max((found.evidence(names) for names in valid), default=0.0)
    if best < NATS:
        return Selection(frozenset(), (), {}, {})
    near = [names for names in valid if found.evidence(names) > best - NEAR]
    chosen = min(near, key=lambda names: (_size(found, names), _order(names), -found.evidence(names)))
    return Selection(
        chosen,
        tuple(names for names in near if names != chosen and len(names) <= len(chosen)),
        found.earned(chosen),
        added(found.fitted(chosen)),
    )


def _swaps(found: Search, names: Names) -> None:
    """Each member against its mimics."""
    there = {c.id for c in found.candidates}
    for member in names:
        for other in EFFECTS[member].mimics:
            if other in there and other not in names:
                found.fitted(names - {member} | {other}, found.fitted(names))


def _stands(found: Search, names: Names) -> bool:
    if not _separable(found, names):
        return False
    volts = added(found.fitted(names))
    series = found.base.lab.series
    if min(volts.values()) < _LEAST_SHARE * max(volts.values()):
        return False
    small = any(v < series * (_STRUCTURAL_V if name in STRUCTURAL else LEAST_V) for name, v in volts.items())
    if small or not _physical(found.fitted(names)):
        return False
    return all(earned >= needed(name) for name, earned in found.earned(names).items())


def _separable(found: Search, names: Names) -> bool:
    """Where a driver was not measured, no mimic of what it drives can stand beside it, nor a second such effect."""
    hidden = {c.id for c in found.candidates if c.id in names and c.inferred}
    return len(hidden) <= 1 and not any(set(EFFECTS[h].mimics) & names for h in hidden)


def added(fitted: Fitted) -> dict[str, float]:
    """RMS of what each member adds to the pack's voltage over all flights. [V]"""
    flights = range(len(fitted.joint.flights))
    parts = np.concatenate([fitted.joint.predicted(fitted.x[None, :], k).members for k in flights], axis=1)
    return {member.id: float(np.sqrt(np.mean(parts[k] ** 2))) for k, member in enumerate(fitted.joint.members)}


def _physical(fitted: Fitted) -> bool:
    """No number of an effect that makes it vanish stands at the end of its physical range."""
    unknowns = fitted.joint.unknowns
    for member in fitted.joint.members:
        for u in member.amplitudes():
            where = unknowns.slice_of(u.name)
            low, high, x = unknowns.low[where], unknowns.high[where], fitted.x[where]
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            absent = u.declared.absent
            assert absent is not None
            if np.any((np.abs(x - middle) > _REACH * half) & (np.abs(x - absent) > 0.01 * half)):
                return False
    return True


def _size(found: Search, names: Names) -> int:
    return sum(len(c.unknowns) for c in found.candidates if c.id in names)


def _order(names: Names) -> tuple[int, ...]:
    return tuple(sorted(_ORDER[name] for name in names))
