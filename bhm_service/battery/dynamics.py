"""The two kinds of state, and the two ways to solve them.

Every state is a charge counter (its rate is a current) or a first-order lag towards a target.
A model declares its states once, in terms of a `Solver`; with `Step` it moves any number of sigma points or
samples over one interval, with `Course` it runs along a whole recording without a Python loop over time.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Protocol

import numpy as np

from bhm_service.units import Array, Value

# Beyond this a lag has forgotten its start to the last bit of a double (e^-40 = 4e-18).
_FORGOTTEN = 40.0
# Largest decay that one block of a recurrence spans: e^600 is still a double.
_BLOCK_DECAY = 600.0
# A block costs about as much as this many rows of the bidiagonal system.
_ROWS_PER_BLOCK = 200


class Solver(Protocol):
    """How a declared state moves: over one interval for many points, or over every interval of a recording.

    ``start`` is the state before the first interval. Rates and targets are given for the beginning and the end of
    each interval and run straight in between, so a sampled current acts in full at its own instant.
    """

    def counter(self, start: Value, rate_begin: Value, rate_end: Value) -> Value:
        """A counter at the end of each interval."""
        ...

    def lag(self, start: Value, target_begin: Value, target_end: Value, tau: Value) -> Value:
        """A lag at the end of each interval; ``tau`` [s] holds for the interval."""
        ...

    def begin(self, start: Value, ends: Value) -> Value:
        """A state at the beginning of each interval, from its start and its values at the ends."""
        ...


class Step:
    """One interval of ``dt`` seconds (a number, or one per sample)."""

    __slots__ = ("dt",)

    def __init__(self, dt: Value) -> None:
        self.dt = dt

    def counter(self, start: Value, rate_begin: Value, rate_end: Value) -> Value:
        return start + (0.5 * self.dt) * (rate_begin + rate_end)

    def lag(self, start: Value, target_begin: Value, target_end: Value, tau: Value) -> Value:
        ratio = self.dt / tau
        decay = np.exp(-ratio)
        if target_begin is target_end:
            return target_end + (start - target_end) * decay
        return target_end + (start - target_begin) * decay - (target_end - target_begin) * _trail(ratio)

    def begin(self, start: Value, ends: Value) -> Value:
        return start


class Course:
    """All intervals of a recording at once.

    ``dt`` has shape (..., T) [s]; starts have shape (..., 1) or are numbers, everything else (..., T).
    """

    __slots__ = ("dt",)

    def __init__(self, dt: Array) -> None:
        self.dt = dt

    def counter(self, start: Value, rate_begin: Value, rate_end: Value) -> Value:
        change = (rate_begin + rate_end) * (0.5 * self.dt)
        return start + np.cumsum(change, axis=-1)

    def lag(self, start: Value, target_begin: Value, target_end: Value, tau: Value) -> Value:
        ratio = self.dt / tau
        gain = target_end - target_begin * np.exp(-ratio) - (target_end - target_begin) * _trail(ratio)
        return recurrence(np.minimum(ratio, _FORGOTTEN), gain, start)

    def begin(self, start: Value, ends: Value) -> Array:
        ends = np.asarray(ends)
        shape, own = ends.shape[:-1], np.shape(start)[:-1]
        if own and own != shape:
            shape = np.broadcast_shapes(shape, own)
        shifted = np.empty((*shape, self.dt.shape[-1]))
        shifted[..., :1] = start
        shifted[..., 1:] = ends[..., :-1]
        return shifted


class Follower:
    """A lag of one time constant from zero along a recording, made once and asked often; as `Course.lag`.

    ``dt`` has shape (..., T) [s], the series that it follows (..., T + 1).
    """

    __slots__ = ("_begin", "_blocks", "_end", "_ratio")

    def __init__(self, dt: Array, tau: float) -> None:
        self._ratio = np.minimum(dt / tau, _FORGOTTEN)
        keep, trail = np.exp(-dt / tau), _trail(dt / tau)
        self._begin, self._end = np.asarray(trail - keep), np.asarray(1.0 - trail)
        self._blocks: list[tuple[slice, Array, Array]] | None = None
        elapsed = np.cumsum(self._ratio, axis=-1)
        edges = _edges(self._ratio, elapsed, elapsed.size)
        if edges is not None:
            self._blocks = []
            for low, high in pairwise(edges):
                before = elapsed[..., low : low + 1] - self._ratio[..., low : low + 1]
                growth = np.exp(elapsed[..., low:high] - before)
                self._blocks.append((slice(low, high), growth, 1.0 / growth))

    def __call__(self, series: Array) -> Array:
        """What follows it, at every sample (..., T + 1)."""
        gain = series[..., 1:] * self._end
        gain += series[..., :-1] * self._begin
        found = np.zeros(np.broadcast_shapes(series.shape, (*self._ratio.shape[:-1], series.shape[-1])))
        if self._blocks is None:
            found[..., 1:] = recurrence(self._ratio, gain, 0.0)
            return found
        ends = found[..., 1:]
        start: Value = 0.0
        for where, growth, shrink in self._blocks:
            sums = np.cumsum(gain[..., where] * growth, axis=-1)
            sums += start
            np.multiply(sums, shrink, out=ends[..., where])
            start = ends[..., where.stop - 1 : where.stop]
        return found


def _edges(ratio: Array, elapsed: Array, size: int) -> list[int] | None:
    """Where the blocks of a recurrence of ``size`` numbers begin, and its end; None where there would be too many."""
    length, total = ratio.shape[-1], float(elapsed.max(initial=0.0))
    if total <= _BLOCK_DECAY:
        return [0, length]
    # Recordings side by side do not decay at the same time: each block is short enough for all of them.
    fastest = elapsed if ratio.ndim == 1 else np.cumsum(ratio.max(axis=tuple(range(ratio.ndim - 1))))
    total = float(fastest[-1])
    if total / _BLOCK_DECAY > size / _ROWS_PER_BLOCK:
        return None
    starts = np.unique(np.searchsorted(fastest, np.arange(0.0, total, 0.5 * _BLOCK_DECAY), side="left"))
    return [*map(int, starts), length]


def _trail(ratio: Value) -> Value:
    """Share of a ramp by which a lag trails its end: (1 - e^-r) / r, finite at r = 0."""
    safe = np.maximum(ratio, 1e-12)
    share: Value = -np.expm1(-safe) / safe
    return share


def recurrence(ratio: Value, gain: Array, start: Value) -> Array:
    """Solve x[k] = exp(-ratio[k]) x[k-1] + gain[k] along the last axis.

    Parameters
    ----------
    ratio : array (..., T) or (T,)   dt / tau of each interval, not negative. [-]
    gain : array (..., T)            what each interval adds.
    start : array (..., 1) or float  x before the first interval.

    Returns
    -------
    array (..., T)                   x at the end of each interval.

    In exponents the recurrence is a cumulative sum: x[k] = A[k] (x0 + sum gain[j] / A[j]). That overflows where
    the decay is long, so it is taken in blocks; where there would be many blocks, as a bidiagonal linear system.
    """
    if gain.shape[-1] == 0:
        return gain
    elapsed = np.cumsum(ratio, axis=-1)
    ratio = np.asarray(ratio)
    edges = _edges(ratio, elapsed, gain.size)
    if edges is None:
        return _bidiagonal(ratio, gain, start)
    if len(edges) == 2:
        return _block(elapsed, gain, start)
    result = np.empty(np.broadcast_shapes(gain.shape, (*np.shape(start)[:-1], 1)))
    for low, high in pairwise(edges):
        before = elapsed[..., low : low + 1] - ratio[..., low : low + 1]
        block = _block(elapsed[..., low:high] - before, gain[..., low:high], start)
        result[..., low:high] = block
        start = block[..., -1:]
    return result


def _block(elapsed: Array, gain: Array, start: Value) -> Array:
    growth = np.exp(elapsed)
    solved: Array = (start + np.cumsum(gain * growth, axis=-1)) / growth
    return solved


def _bidiagonal(ratio: Value, gain: Array, start: Value) -> Array:
    from scipy.linalg import lapack  # a third of the service's start, which never needs it

    shape = np.broadcast_shapes(gain.shape, (*np.shape(start)[:-1], 1))
    length = shape[-1]
    decay = np.broadcast_to(np.exp(-ratio), shape).reshape(-1, length).copy()
    right = np.broadcast_to(gain, shape).reshape(-1, length).copy()
    right[:, 0] += decay[:, 0] * np.broadcast_to(start, (*shape[:-1], 1)).reshape(-1)
    decay[:, 0] = 0.0  # rows follow each other in one long system: nothing crosses from row to row
    size = right.size
    solved = lapack.dgtsv(-decay.ravel()[1:], np.ones(size), np.zeros(size - 1), right.ravel())[3]
    return np.asarray(solved, dtype=float).reshape(shape)
