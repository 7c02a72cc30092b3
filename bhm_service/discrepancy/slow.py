"""What of a misfit is slow: its mean over a quarter of a minute. What is faster is noise."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from bhm_service.discrepancy.flights import FlightData
from bhm_service.units import Array, Flags

SLOW_S = 15.0
_STRAYS = 2  # samples: one reading that is off, and its echo where the next one was lost


def slow(misfit: Array, data: FlightData) -> Array:
    """A flight's misfit (T,) averaged over a quarter of a minute; nan is unknown."""
    return running_mean(misfit, np.isfinite(misfit), slow_samples(data))


def without_strays(misfit: Array) -> Array:
    """A misfit (T,) without single readings that are off: its running median; nan is unknown and stays so."""
    width = 2 * _STRAYS + 1
    around = sliding_window_view(np.pad(misfit, _STRAYS, mode="reflect"), width)
    found = np.full(misfit.size, np.nan)
    known = np.isfinite(misfit)
    found[known] = np.nanmedian(around[known], axis=-1)
    return found


def slow_samples(data: FlightData) -> int:
    """How many of a flight's samples a quarter of a minute has."""
    return max(int(SLOW_S / max(float(np.median(np.diff(data.time_s))), 0.1)), 1)


def running_mean(series: Array, known: Flags, samples: int) -> Array:
    """Mean of a series (T,) over so many samples about each, of those that are ``known``; zero where none is."""
    kernel = np.ones(samples)
    above = np.convolve(np.where(known, series, 0.0), kernel, mode="same")
    return np.asarray(above / np.maximum(np.convolve(known.astype(float), kernel, mode="same"), 1.0))
