"""The two kinds of state, and the two ways to solve them.

Every state is a charge counter (its rate is a current) or a first-order lag towards a target.
A model declares its states once, in terms of a `Solver`; with `Step` it moves any number of sigma points or
samples over one interval, with `Course` it runs along a whole recording without a Python loop over time.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from bhm_service.battery.alike import once
from bhm_service.units import Array, Value

_LEAST_RATIO = 1e-12  # of an interval and a time constant; what is less is taken for that


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
        return once(_lagged, self.dt, start, target_begin, target_end, tau)

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

    __slots__ = ("_begin", "_decay", "_end")

    def __init__(self, dt: Array, tau: float) -> None:
        self._decay, self._begin, self._end = _shares(dt / tau)

    def __call__(self, series: Array) -> Array:
        """What follows it, at every sample (..., T + 1)."""
        gain = series[..., 1:] * self._end
        gain += series[..., :-1] * self._begin
        ends = recurrence(self._decay, gain, 0.0)
        found = np.zeros((*ends.shape[:-1], series.shape[-1]))
        found[..., 1:] = ends
        return found


def _lagged(dt: Array, start: Value, target_begin: Value, target_end: Value, tau: Value) -> Array:
    decay, of_begin, of_end = _shares(dt / tau)
    return recurrence(decay, target_begin * of_begin + target_end * of_end, start)


def _trail(ratio: Value) -> Value:
    """Share of a ramp by which a lag trails its end: (1 - e^-r) / r, finite at r = 0."""
    safe = np.maximum(ratio, _LEAST_RATIO)
    share: Value = -np.expm1(-safe) / safe
    return share


def _shares(ratio: Array) -> tuple[Array, Array, Array]:
    """What is left of a lag after ``ratio`` time constants, and what it takes of a ramp's begin and of its end."""
    safe = np.maximum(ratio, _LEAST_RATIO)
    gone = -np.expm1(-safe)
    trail = gone / safe
    decay = 1.0 - gone
    return decay, trail - decay, 1.0 - trail


def recurrence(decay: Array, gain: Array, start: Value) -> Array:
    """Solve x[k] = decay[k] x[k-1] + gain[k] along the last axis.

    Parameters
    ----------
    decay : array (..., T) or (T,)   what each interval leaves, from 0 to 1. [-]
    gain : array (..., T)            what each interval adds.
    start : array (..., 1) or float  x before the first interval.

    Returns
    -------
    array (..., T)                   x at the end of each interval; all of it undefined where anything is not finite.
    """
    from scipy.linalg import blas  # a third of the service's start, which never needs it

    shape = np.broadcast_shapes(gain.shape, decay.shape, (*np.shape(start)[:-1], 1))
    if 0 in shape:
        return np.zeros(shape)
    solved = np.empty(shape)
    solved[:] = gain
    solved[..., :1] += decay[..., :1] * start
    # A bidiagonal system with ones on its diagonal; the other half of the band is not looked at. Rows that decay each
    # in its own way follow each other in one long system: nothing crosses from row to row.
    band = np.empty((*shape[len(shape) - decay.ndim :], 2))
    np.negative(decay, out=band[..., 0])
    band[..., 0, 0] = 0.0
    system = band.reshape(-1, 2).T
    rows = solved.reshape(-1, system.shape[1])
    for row in rows:
        row[:] = blas.dtbsv(1, system, row, lower=0, trans=1, diag=1, overwrite_x=1)
    return solved
