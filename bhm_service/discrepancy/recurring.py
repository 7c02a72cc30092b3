"""What comes back with a period in all flights and is in nothing that was recorded: a heater that switches, say.

No effect of the catalogue keeps time by itself. What a fit leaves of every flight is compared, frequency by frequency,
with what it leaves at the frequencies beside, whatever the noise's colour; noise alone is there exponential, and the
sum over flights a gamma variable. A line has to be in both halves of the flights, which a bump at one state of charge
is not, and not in the current, which manoeuvres that come back are. A load past the sensor is heard there as well: it
lowers the voltage, and rotors that take their power all the same draw more; by far too little for what a model makes of
that current to be off by as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc, gammaln

from bhm_service.discrepancy.fitting import Fitted
from bhm_service.units import Array

_PERIODS_S = (20.0, 240.0)  # faster is noise, slower is a course
_FINER = 4.0  # than the frequencies that the longest flight tells apart
_LEAST_CYCLES = 4.0  # in a flight
_BESIDE = 24  # frequencies on which the noise beside a line is taken
_CLIP = 4.0  # standard deviations beyond which a residual counts no more
# [nats] that an explanation by chance is unlikely by, over all frequencies: what the ratio to a level that is itself
# taken from few frequencies lacks to an exponential variable, and flights that are alike, are far below.
_TELLING = 30.0
_HALF = float(np.log(1e3))  # [nats] at that one frequency, in each half, and in the current
_OFF = 1.0 / 3.0  # of the drop that a current makes: no model is off by more of it


@dataclass(frozen=True, slots=True)
class Recurring:
    """A line in what is left of all flights."""

    period_s: float
    nats: float  # minus the log of the odds that noise has such a line anywhere


def recurring(fitted: Fitted) -> Recurring | None:
    """The period that what a fit leaves comes back with; None where chance would do."""
    flights = fitted.joint.flights
    times = [f.time_s for f in flights]
    longest = max(float(t[-1] - t[0]) for t in times)
    least, most = 1.0 / _PERIODS_S[1], 1.0 / _PERIODS_S[0]
    frequencies = np.arange(least, most, 1.0 / (_FINER * longest))
    left = [row[: t.size] for row, t in zip(fitted.rows, times, strict=True)]
    nats = _nats(left, times, frequencies, _LEAST_CYCLES) - np.log((most - least) * longest)
    best = int(np.argmax(nats))
    if nats[best] < _TELLING:
        return None
    there = frequencies[best : best + 1]
    halves = [[slice(0, t.size // 2) for t in times], [slice(t.size // 2, None) for t in times]]
    for parts in halves:
        own = [row[p] for row, p in zip(left, parts, strict=True)]
        if _nats(own, [t[p] for t, p in zip(times, parts, strict=True)], there, _LEAST_CYCLES / 2.0)[0] < _HALF:
            return None
    steps = [np.diff(f.current_a, prepend=f.current_a[0]) for f in flights]
    if _nats(steps, times, there, _LEAST_CYCLES)[0] > _HALF and _models_own(fitted, left, times, float(there[0])):
        return None
    return Recurring(1.0 / float(there[0]), float(nats[best]))


def _models_own(fitted: Fitted, left: Sequence[Array], times: Sequence[Array], frequency: float) -> bool:
    """Whether what is left at a frequency may be what a model is off by of the drop that the current makes there."""
    joint = fitted.joint
    ohm = joint.lab.pack_ohm
    drops = [joint.whitened(ohm * f.current_a[None, :], k, fitted.noise)[0] for k, f in enumerate(joint.flights)]
    return _swing(left, times, frequency) < _OFF * _swing(drops, times, frequency)


def _swing(series: Sequence[Array], times: Sequence[Array], frequency: float) -> float:
    """How far all series swing at a frequency, in a measure that is the same for all."""
    at = np.array([frequency])
    return float(np.sqrt(sum(float(_power(_tapered(v), t, at)[0]) for v, t in zip(series, times, strict=True))))


def _nats(series: Sequence[Array], times: Sequence[Array], frequencies: Array, cycles: float) -> Array:
    """Minus the log of the odds that noise has as much at each frequency, over all series that are long enough."""
    ratios, count = np.zeros(frequencies.size), np.zeros(frequencies.size)
    for values, time_s in zip(series, times, strict=True):
        lasts = float(time_s[-1] - time_s[0])
        known = frequencies * lasts >= cycles
        if known.any():
            ratios[known] += _over_beside(values, time_s, frequencies[known])
            count += known
    shape, most = np.maximum(count, 1.0), np.maximum(ratios, 1.0)
    odds = gammaincc(shape, ratios)
    # Odds too small for a number lie so far out that the first term of their series is all there is of them.
    far = most - (shape - 1.0) * np.log(most) + gammaln(shape)
    nats = np.where(odds > 0.0, -np.log(np.maximum(odds, np.finfo(float).tiny)), far)
    return np.asarray(np.where(count > 0, nats, 0.0))


def _over_beside(values: Array, time_s: Array, frequencies: Array) -> Array:
    """Power at frequencies over that of the frequencies beside; of mean one in noise of a smooth spectrum."""
    spread = max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-9)
    clipped = np.clip(values / spread, -_CLIP, _CLIP)
    tapered = _tapered(clipped)
    width = 1.0 / float(time_s[-1] - time_s[0])
    grid = np.arange(1.5 * width, 1.5 / _PERIODS_S[0], width)
    levels = _power(tapered, time_s, grid)
    beside = np.empty(frequencies.size)
    for k, frequency in enumerate(frequencies.tolist()):
        away = np.abs(grid - frequency)
        order = np.argsort(away)
        near = order[away[order] > 2.0 * width][:_BESIDE]  # past the taper's own width
        beside[k] = np.median(levels[near]) / np.log(2.0)
    return _power(tapered, time_s, frequencies) / np.maximum(beside, 1e-12)


def _tapered(values: Array) -> Array:
    """A series about its mean, fading in and out."""
    return np.asarray((values - values.mean()) * np.hanning(values.size + 2)[1:-1])


def _power(tapered: Array, time_s: Array, frequencies: Array) -> Array:
    """Of a tapered series at some frequencies."""
    return np.asarray(np.abs(np.exp(-2j * np.pi * np.outer(frequencies, time_s)) @ tapered) ** 2)
