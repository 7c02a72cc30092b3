"""States that act on what moves them: a recording is swept until they stand still."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bhm_service.battery.dynamics import Course, Solver, Step, recurrence
from bhm_service.battery.effects.base import Effect, Interval
from bhm_service.units import Array, Value

States = tuple[Value, ...]
# A recording is swept window by window; windows grow while that is quick.
_WINDOW_S = 1200.0
_FEW_SWEEPS, _MOST_SWEEPS = 4, 14
_TOLERANCE = 1e-10  # of a state's size: with temperatures 3e-8 K, which is below a nanovolt
# Likewise of what is only compared with a run that it hardly differs from: a thousandth of what a step of differences
# does to a temperature.
_NEAR_TOLERANCE = 1e-6
_NEAR_SAMPLES = 240  # of a window of many such runs: what is swept should fit a processor's cache
# Added to the beginnings of intervals to see what is left of it at their ends; a power of two, so nothing is rounded.
_PROBE = 1024.0
_LEAST_MOVE = 1e-6  # of a state between two sweeps, from which on they tell a slope


class Apart:
    """Moves what feeds back over every interval by itself, from its own beginning."""

    __slots__ = ("_step", "left")

    def __init__(self, dt: Array, probing: bool) -> None:
        self._step = Step(dt)
        self.left: list[Value] | None = [] if probing else None  # at each end, of what was added at the beginning

    def advance(self, effect: Effect, before: States, interval: Interval) -> States:
        """States of an effect at the ends of the intervals that begin with ``before``."""
        ends = effect.advance(self._step, before, interval)
        if self.left is not None:
            more = effect.advance(self._step, tuple(state + _PROBE for state in before), interval)
            self.left += [(m - end) / _PROBE for m, end in zip(more, ends, strict=True)]
        return ends


# Moves all states of a pack, what feeds back by `Apart`: solver, start, before, begin, end, temperature, apart.
Advance = Callable[[Solver, States, States, Value, Value, Value | None, Apart | None], States]


class Swept(NamedTuple):
    """A pack's states along a recording (..., T), and how what feeds back follows its own beginnings."""

    states: tuple[Array, ...]
    following: tuple[Array, ...]  # of each such state, the slope of every interval's end by its beginning (..., T - 1)


@dataclass(frozen=True, slots=True)
class Feedback:
    """The states of a pack of which some act on what moves them."""

    advance: Advance
    n_cell: int  # states of the cell, which come first, its state of charge before all
    fed: Sequence[int]  # columns of the states that are moved by what they act on
    per_ampere: Value  # [1/As] by which a cell's state of charge moves, effects aside

    def swept(
        self, dt: Array, start: States, begin: Array, end: Array, temperature: Array | None, near: Swept | None
    ) -> tuple[States, tuple[Array, ...]]:
        """States at the ends of all intervals, and `Swept.following`.

        Parameters
        ----------
        dt : array (..., T - 1)             lengths of the intervals. [s]
        start : states (..., 1)             before the first of them.
        begin, end : array (..., T - 1)     measured pack current. [A]
        temperature : array (..., T - 1) or None   of the pack. [K]
        near : Swept (..., T)               of runs that these differ from by steps of differences.
        """
        longest = dt.max(axis=tuple(range(dt.ndim - 1)))
        elapsed = np.cumsum(longest)
        pieces: list[States] = []
        slopes: list[States] = []
        low, width = 0, _WINDOW_S if near is None else _NEAR_SAMPLES * float(np.median(longest))
        while low < elapsed.size:
            since = elapsed[low] - longest[low]
            high = max(int(np.searchsorted(elapsed, since + width, side="right")), low + 1)
            window = slice(low, high)
            solver = Course(dt[..., window])
            flows = begin[..., window], end[..., window]
            known = None if temperature is None else temperature[..., window]
            before, following = self._first(solver, start, *flows, window, near)
            tolerance = _TOLERANCE if near is None else _NEAR_TOLERANCE
            ends, following, sweeps = self._settled(solver, start, before, *flows, known, following, tolerance)
            if sweeps > _MOST_SWEEPS and high - low > 1:
                width *= 0.5
                continue
            pieces.append(ends)
            slopes.append(following)
            start = tuple(np.asarray(e)[..., -1:] for e in ends)
            low = high
            if sweeps <= _FEW_SWEEPS and near is None:
                width *= 2.0
        return _joined(pieces), _joined(slopes)

    def _first(
        self, solver: Course, start: States, begin: Array, end: Array, window: slice, near: Swept | None
    ) -> tuple[States, States]:
        """Where the intervals of a window are taken to begin at first, and `following` where it is known."""
        if near is None:
            counted = solver.counter(start[0], begin * self.per_ampere, end * self.per_ampere)
            return (solver.begin(start[0], counted), *start[1:]), ()
        beside = [np.asarray(state)[..., window] for state in near.states]
        # As far from the other run all along as at the window's start; the cell's own lags are not asked for.
        before = tuple(
            state if 0 < k < self.n_cell else state + (own - state[..., :1])
            for k, (own, state) in enumerate(zip(start, beside, strict=True))
        )
        return before, tuple(f[..., window] for f in near.following)

    def _settled(
        self,
        solver: Course,
        start: States,
        before: States,
        begin: Array,
        end: Array,
        temperature: Array | None,
        following: States,
        tolerance: float,
    ) -> tuple[States, States, int]:
        """States at the ends of a window's intervals, `following`, and the sweeps it took; one too many: not settled.

        What feeds back is moved over every interval by itself, and the intervals are then joined by how the end of
        each follows its beginning, which is what the last two sweeps differ by (a secant for each interval).
        """
        acting = (0, *range(self.n_cell, len(start)))  # what modifiers and heat are taken from
        alone: States = ()
        previous, sweeps, settled = before, 0, False
        while not settled and sweeps < _MOST_SWEEPS:
            sweeps += 1
            apart = Apart(solver.dt, probing=not following)
            ends = list(self.advance(solver, start, before, begin, end, temperature, apart))
            was, alone = alone, tuple(ends[k] for k in self.fed)
            if was:
                moved = zip(self.fed, following, alone, was, strict=True)
                following = tuple(_secant(now - then, before[k] - previous[k], last) for k, last, now, then in moved)
            elif apart.left:
                following = tuple(apart.left)
            for k, slope in zip(self.fed, following, strict=True):
                ends[k] = recurrence(np.asarray(slope), np.asarray(ends[k] - slope * before[k]), start[k])
            previous, before = before, tuple(map(solver.begin, start, ends))
            settled = all(_close(previous[k], before[k], tolerance) for k in acting)
        shaped = tuple(np.broadcast_to(f, np.shape(ends[k])) for k, f in zip(self.fed, following, strict=True))
        return tuple(ends), shaped, sweeps if settled else _MOST_SWEEPS + 1


def _close(previous: Value, now: Value, tolerance: float) -> bool:
    off = np.abs(previous - now) > tolerance * (1.0 + np.abs(now))  # not a number counts as settled
    return not np.any(off)


def _secant(change: Value, moved: Value, last: Value) -> Value:
    """How the ends of intervals follow their beginnings, where these have moved; else as it was known."""
    if not np.any(moved):
        return last
    shape = np.broadcast_shapes(np.shape(change), np.shape(moved), np.shape(last))
    found = np.array(np.broadcast_to(last, shape))
    np.divide(change, moved, out=found, where=np.abs(moved) > _LEAST_MOVE)
    return np.clip(found, 0.0, 1.0, out=found)


def _joined(pieces: list[States]) -> tuple[Array, ...]:
    return tuple(np.concatenate(state, axis=-1) for state in zip(*pieces, strict=True))
