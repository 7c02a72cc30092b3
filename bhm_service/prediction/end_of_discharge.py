"""Algorithm 1 of the paper: run every sample of the pack's state forward until the first event ends its flight.

The paper steps one second at a time. Here a sample's steps are equal pieces of the charge that it has left, so every
sample is through after the same number of them, the curve is resolved where it bends, and the last step ends on the
threshold exactly. Within a step the current runs straight towards where it is heading; the models' own solution is
exact for that. Where the voltage ends the flight, that step is taken again up to there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bhm_service.battery.pack import PackModel
from bhm_service.messages import Ending
from bhm_service.units import Array, Flags

# The first steps are short: the pack may still be settling under the load.
_FIRST_STEPS_S = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0)
_PIECE_S = 45.0  # about how long the pieces are
_FEWEST, _MOST = 10, 40
_BENDS = 2e-3  # share of the current by which it may miss where it was heading
_REFINEMENTS = 4  # of the step in which the voltage ends the flight, by false position
_HORIZON_S = 24.0 * 3600.0

_SOC, _VOLTAGE, _POWER, _HORIZON = range(4)
ENDINGS = (Ending.SOC, Ending.VOLTAGE, Ending.POWER, Ending.HORIZON)


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What ends a flight."""

    threshold_soc: float
    cutoff_v: float  # of the pack, under load, if all its cells are like the lowest


def end_of_discharge(
    pack: PackModel,
    states: Array,
    power_w: Array,
    limits: Limits,
    temperature_k: float | None = None,
    pieces: int | None = None,
) -> tuple[Array, NDArray[np.int_]]:
    """Time until the first event for every sample.

    Parameters
    ----------
    states : array (M, n_states)   one state per sample.
    power_w : array (M,)           the load that each meets, held. [W]
    temperature_k : float          of the pack, held, unless the pack carries its temperature as a state. [K]
    pieces : int                   steps that the charge left is divided into; by its duration if not given.

    Returns
    -------
    time : array (M,)              [s], at most a day.
    ending : int array (M,)        index into `ENDINGS`.

    Source: NASA/TM-20230012868, eqs. (4), (5), Algorithm 1.
    """
    if pack.carries_temperature:  # the states know it, and how it goes on
        temperature_k = None
    count = states.shape[0]
    elapsed = np.zeros(count)
    ended_at = np.full(count, np.inf)
    ending = np.full(count, _HORIZON)
    power = np.maximum(power_w, 1e-3)

    current, deliverable = pack.current_at_power(states, power, power / _nominal_v(pack), temperature_k)
    voltage = power / current - pack.below_average(states, current, temperature_k)
    _mark(ended_at, ending, ~deliverable, elapsed, _POWER)
    _mark(ended_at, ending, voltage <= limits.cutoff_v, elapsed, _VOLTAGE)
    _mark(ended_at, ending, states[:, 0] <= limits.threshold_soc, elapsed, _SOC)

    drawn = pack.true_current(current)
    by = pack.modifiers(tuple(states.T), temperature_k, drawn)
    capacity_c = pack.capacity_c * by.capacity * by.area
    if pieces is None:
        longest_s = float(np.max((states[:, 0] - limits.threshold_soc) * capacity_c / drawn))
        pieces = int(min(max(longest_s / _PIECE_S, _FEWEST), _MOST))
    slope = np.zeros(count)  # [A/s] of the current over the last step
    crossing: _Crossing | None = None
    for k in range(len(_FIRST_STEPS_S) + pieces):
        left = np.maximum(states[:, 0] - limits.threshold_soc, 0.0) * capacity_c / pack.true_current(current)
        if k < len(_FIRST_STEPS_S):
            dt = np.minimum(_FIRST_STEPS_S[k], left / pieces)
        else:
            dt = left / (len(_FIRST_STEPS_S) + pieces - k)
        dt = np.minimum(dt, _HORIZON_S / pieces)
        heading = np.clip(current + slope * dt, 0.7 * current, 1.5 * current)
        moved = pack.step(states, dt, current, heading, temperature_k)
        now, deliverable = pack.current_at_power(moved, power, heading, temperature_k)
        if np.max(np.abs(now - heading) / current) > _BENDS:  # take the step again, towards what it came to
            heading = now
            moved = pack.step(states, dt, current, heading, temperature_k)
            now, deliverable = pack.current_at_power(moved, power, heading, temperature_k)
        falls_to = power / now - pack.below_average(moved, now, temperature_k)

        fell = (falls_to <= limits.cutoff_v) & (voltage > limits.cutoff_v)
        fell &= elapsed < ended_at
        if np.any(fell):
            step = _Crossing(fell, states, current, slope, elapsed, dt, voltage, falls_to)
            crossing = step if crossing is None else crossing.joined(step)
            _mark(ended_at, ending, fell, elapsed, _VOLTAGE)  # when exactly is found below
        _mark(ended_at, ending, ~deliverable, elapsed, _POWER)
        slope = (now - current) / np.maximum(dt, 1e-6)
        states, current, voltage, elapsed = moved, now, falls_to, elapsed + dt

    # What the last step left of the charge, or overshot, at the current it ended with.
    elapsed = elapsed + (states[:, 0] - limits.threshold_soc) * capacity_c / pack.true_current(current)
    if crossing is not None:
        refined = crossing.refined(pack, power, limits.cutoff_v, temperature_k)
        ended_at = np.where(crossing.known & (ending == _VOLTAGE), refined, ended_at)
    _mark(ended_at, ending, elapsed < _HORIZON_S, elapsed, _SOC)
    return np.clip(ended_at, 0.0, _HORIZON_S), ending


@dataclass(frozen=True, slots=True)
class _Crossing:
    """The step in which each sample's voltage fell through the cut-off: from where, and how long it was."""

    known: Flags
    states: Array
    current: Array
    slope: Array
    begin: Array
    dt: Array
    voltage: Array  # at its beginning
    falls_to: Array  # at its end

    def joined(self, later: _Crossing) -> _Crossing:
        """The same with the samples that crossed in a later step."""
        new = later.known
        return _Crossing(
            self.known | new,
            np.where(new[:, None], later.states, self.states),
            np.where(new, later.current, self.current),
            np.where(new, later.slope, self.slope),
            np.where(new, later.begin, self.begin),
            np.where(new, later.dt, self.dt),
            np.where(new, later.voltage, self.voltage),
            np.where(new, later.falls_to, self.falls_to),
        )

    def refined(self, pack: PackModel, power: Array, cutoff_v: float, temperature_k: float | None) -> Array:
        """When within the step it happened: the voltage bends, so the step is taken again until it ends there."""
        low, high = np.zeros_like(self.dt), self.dt
        at_low, at_high = self.voltage - cutoff_v, self.falls_to - cutoff_v
        share = low
        for _ in range(_REFINEMENTS):
            share = low + (high - low) * np.clip(at_low / np.maximum(at_low - at_high, 1e-9), 0.0, 1.0)
            now = np.clip(self.current + self.slope * share, 0.7 * self.current, 1.5 * self.current)
            for _ in range(2):
                moved = pack.step(self.states, share, self.current, now, temperature_k)
                now, _ = pack.current_at_power(moved, power, now, temperature_k)
            at_share = power / now - pack.below_average(moved, now, temperature_k) - cutoff_v
            above = at_share > 0.0
            low, at_low = np.where(above, share, low), np.where(above, at_share, at_low)
            high, at_high = np.where(above, high, share), np.where(above, at_high, at_share)
        return self.begin + share


def _nominal_v(pack: PackModel) -> float:
    return 3.7 * pack.series


def _mark(ended_at: Array, ending: NDArray[np.int_], event: Flags, when: Array, kind: int) -> None:
    """Note an event for the samples that have not ended before it."""
    first = event & (when < ended_at)
    ended_at[first] = when[first]
    ending[first] = kind
