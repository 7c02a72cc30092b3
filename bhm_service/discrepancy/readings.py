"""Which readings are of the pack, and what lies between them.

Not of it are voltages that jump away and back, those of a part of it, or after a load that came to an end while nothing
was recorded.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from bhm_service.units import Array, Flags

_SPIKE_SHARE = 0.08  # of the voltage: no load makes a pack jump so far and back within a sample
# Times what is usual, and of the voltage: a reading that stands so far alone, while the current does not, tells nothing
# of the pack, and squared in a mean it would be all that is seen of its flight.
_LONE, _LONE_SHARE = 25.0, 0.01
_BUSY = 0.75  # of a recording's samples have less current than its usual load
# Of that load: what is under load, and what is so little that no contact which carries the load drops a twentieth.
_LOADED, _IDLE = 0.5, 0.1
_ABOVE = 0.95  # of a later voltage under load: less is not what a pack rests at
_LASTS = 5  # samples of which the middle one counts
# Between samples, and times what nineteen in twenty are within, which in a log that is written on change is far beyond
# the usual: a load may have ended anywhere in it.
_GAP_S, _GAP, _ORDINARY = 5.0, 3.0, 0.95


def without_spikes(voltage: Array, current: Array) -> Array:
    """Single readings that jump away and back are no measurements: further than any load does, or than the sensor's
    noise and with no load that does.
    """
    clean = voltage.copy()
    if clean.size < 3:
        return clean
    away, moved = _away(clean), _away(current)
    usual = np.nanmedian(clean)
    alone = (away > max(_LONE * _scatter(away), _LONE_SHARE * usual)) & (moved <= _LONE * _scatter(moved))
    clean[1:-1][(away > _SPIKE_SHARE * usual) | alone] = np.nan
    return clean


def of_a_part(voltage: Array, current: Array) -> Flags:
    """Readings at rest that are below what the same pack reads under load later: a cell was not connected.

    A discharge takes a pack's voltage down and never up, so what it reads under load it rests above before.
    """
    flown = np.nan_to_num(current)
    load = _load(flown)
    busy = np.flatnonzero((flown > _LOADED * load) & np.isfinite(voltage))
    if busy.size == 0:
        return np.zeros(voltage.size, dtype=bool)
    highest = np.maximum.accumulate(median_filter(voltage[busy], _LASTS)[::-1])[::-1]
    later = np.append(highest, -np.inf)[np.searchsorted(busy, np.arange(voltage.size))]
    return np.asarray((flown < _IDLE * load) & (voltage < _ABOVE * later))


def before_unseen_landing(time_s: Array, current: Array) -> int:
    """Samples until a gap in which the load ended for good; all of them where it was seen to end, or did not.

    Half of such a gap's charge may have been taken or not, and what relaxes after it began to at no known time.
    """
    idle = current < _IDLE * _load(current)
    flown = np.flatnonzero(current > _LOADED * _load(current))
    apart = np.diff(time_s)
    last = int(flown[-1]) if flown.size else current.size - 1
    rests = last + 1 < current.size and bool(idle[last + 1])
    unseen = rests and apart[last] > max(_GAP_S, _GAP * float(np.quantile(apart, _ORDINARY)))
    return last + 1 if unseen else current.size


def _load(current: Array) -> float:
    return float(np.quantile(current, _BUSY))


def _away(series: Array) -> Array:
    """How far each sample inside a series is from both its neighbours, beyond what they are from each other."""
    middle = 0.5 * (series[:-2] + series[2:])
    return np.asarray(np.abs(series[1:-1] - middle) - np.abs(series[2:] - series[:-2]))


def _scatter(away: Array) -> float:
    """The size of what is usual."""
    return float(np.nanmedian(np.abs(away)))


def bridged(series: Array, known: Flags) -> Array:
    """A series (T,) with straight lines over what is not known, level at its ends."""
    at = np.arange(series.size)
    return np.interp(at, at[known], series[known])
