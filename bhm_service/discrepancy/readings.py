"""Which readings of a voltage are of the pack: not those that jump away and back, nor those of a part of it."""

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
    load = float(np.quantile(flown, _BUSY))
    busy = np.flatnonzero((flown > _LOADED * load) & np.isfinite(voltage))
    if busy.size == 0:
        return np.zeros(voltage.size, dtype=bool)
    highest = np.maximum.accumulate(median_filter(voltage[busy], _LASTS)[::-1])[::-1]
    later = np.append(highest, -np.inf)[np.searchsorted(busy, np.arange(voltage.size))]
    return np.asarray((flown < _IDLE * load) & (voltage < _ABOVE * later))


def _away(series: Array) -> Array:
    """How far each sample inside a series is from both its neighbours, beyond what they are from each other."""
    middle = 0.5 * (series[:-2] + series[2:])
    return np.asarray(np.abs(series[1:-1] - middle) - np.abs(series[2:] - series[:-2]))


def _scatter(away: Array) -> float:
    """The size of what is usual."""
    return float(np.nanmedian(np.abs(away)))
