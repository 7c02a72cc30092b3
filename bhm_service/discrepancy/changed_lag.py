"""From some flight on the voltage is read through another filter: it follows the load later, or sooner, than before.

No effect of the catalogue begins with a flight and acts within a second: firmware does, or another power module. What
a model is off by within seconds is much the same in all flights of one pack, so a change is held against how much the
flights before it, and those after it, differ among themselves, and by their own errors should.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from bhm_service.battery.dynamics import Follower
from bhm_service.discrepancy.fitting import Fitted, weights
from bhm_service.discrepancy.flights import FlightData, usual_step_s
from bhm_service.discrepancy.slow import SLOW_S, running_mean
from bhm_service.units import Array, Flags

_CHANCE = 1e-3  # over all flights with which it may have begun
_FEWEST = 2  # flights to either side: one alone is an odd flight
_LAG_S = 1.0  # of the filter by which any is told: one of half as much shows 0.7 of it, one of three times 0.85
_ALIKE = 0.1  # of that filter: flights of one pack differ by as much beside their own errors, by clocks and by models
_LEAST = 0.5  # of that filter and of a sample: less is a matter of when within it the sensors are read
_SETTLED_S = (20.0, 15.0)  # after take-off and before landing, when the load jumps by more than any model follows
_FEWEST_SAMPLES = 60
_OFF = 0.2  # of a change within those seconds: what a model is off by beside noise
_FAR = 2.0  # standard deviations, from where on a sample is doubted
_REWEIGHED = 5
_COLOURED = 4  # samples over which errors are alike


@dataclass(frozen=True, slots=True)
class ChangedLag:
    """A lag of the voltage that begins with a flight."""

    flight: str  # that it begins with
    change: float  # of what a filter of one second does to the voltage; above zero the voltage came later than before
    nats: float  # of evidence


def changed_lag(fitted: Fitted, flights: Sequence[FlightData]) -> ChangedLag | None:
    """The change of lag that chance would not make; ``flights`` at their logs' own rate. None where none is."""
    joint = replace(fitted.joint, flights=tuple(flights))
    voltages = [modelled.voltage[0] for modelled in joint.all_predicted(fitted.x[None, :])]
    told = [_lag(data, volts) for data, volts in zip(flights, voltages, strict=True)]
    known = [k for k, lag in enumerate(told) if lag is not None]
    sizes, sds = np.array([lag for lag in told if lag is not None]).reshape(-1, 2).T
    found: list[tuple[float, ChangedLag]] = []
    for first in range(_FEWEST, len(known) - _FEWEST + 1):
        before, after = sizes[:first], sizes[first:]
        freedom = sizes.size - 2
        among = float(np.sum((before - before.mean()) ** 2) + np.sum((after - after.mean()) ** 2)) / freedom
        own = float(np.mean(sds**2)) + _ALIKE**2
        # What flights differ by is told by few of them: what they should differ by counts for as much.
        share = 1.0 / before.size + 1.0 / after.size
        change = float(after.mean() - before.mean())
        beyond = abs(change) / float(np.sqrt(0.5 * (among + own) * share))
        odds = 2.0 * float(stdtr(2 * freedom, -beyond))
        found.append((odds, ChangedLag(flights[known[first]].label, change, 0.5 * beyond**2)))
    if not found:
        return None
    odds, best = min(found, key=lambda f: f[0])
    least = _LEAST * max(usual_step_s(flights) / _LAG_S, 1.0)
    return best if odds * len(found) < _CHANCE and abs(best.change) > least else None


def _lag(data: FlightData, modelled_v: Array) -> tuple[float, float] | None:
    """How much of what a filter would change is found in a flight, and its standard deviation; None of a short one.

    Beside it the quick part of the voltage may be off by a share.
    """
    usable = _settled(data) & np.isfinite(data.voltage_v)
    if usable.sum() < _FEWEST_SAMPLES:
        return None
    steps = np.diff(data.time_s)
    follow = Follower(steps, _LAG_S)
    late = follow(modelled_v - modelled_v[0]) + modelled_v[0] - modelled_v
    width = max(round(SLOW_S / max(float(np.median(steps)), 1e-3)), 3)

    def quick(series: Array) -> Array:
        return np.asarray((series - running_mean(series, usable, width))[usable])

    off, jumps = quick(data.voltage_v - modelled_v), quick(modelled_v)
    columns = np.column_stack([quick(late), jumps])
    spread = max(1.4826 * float(np.median(np.abs(off))), 1e-6)
    usual = 1.0 / (spread**2 + (_OFF * jumps) ** 2)
    weighed = usual
    for _ in range(_REWEIGHED):
        inverse = np.linalg.pinv(columns.T @ (columns * weighed[:, None]))
        sizes = inverse @ (columns.T @ (weighed * off))
        left = off - columns @ sizes
        weighed = usual * weights(left * np.sqrt(usual), _FAR)
    scores = columns * (weighed * left)[:, None]
    power = scores.T @ scores
    for lag in range(1, _COLOURED + 1):
        across = scores[lag:].T @ scores[:-lag]
        power += (1.0 - lag / (_COLOURED + 1)) * (across + across.T)
    return float(sizes[0]), float(np.sqrt((inverse @ power @ inverse)[0, 0]))


def _settled(data: FlightData) -> Flags:
    """In the air, away from take-off and landing."""
    if not data.airborne.any():
        return data.airborne
    in_air = data.time_s[data.airborne]
    after, before = _SETTLED_S
    return np.asarray(data.airborne & (data.time_s > in_air[0] + after) & (data.time_s < in_air[-1] - before))
