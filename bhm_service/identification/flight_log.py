"""Logs of flights as recordings of a cell: cut where the pack was changed or the count of charge was lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bhm_service.errors import BadInputError
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.mavlink.log import Log
from bhm_service.mavlink.recording import Recording, record
from bhm_service.units import SECONDS_PER_HOUR, Flags

_CELL_V = (2.0, 4.5)  # [V] a reading outside is a fault of the link
_GAP_S, _GAP_SAMPLES = 60.0, 6.0  # a longer interruption under load has lost count of the charge
_LOADED = 0.2  # of the largest current
# A log that begins in flight does not tell how long the load had been there, so what relaxes within minutes is between
# rest and settled: for so long, or such a share of a short log, its voltage is left out.
_SETTLES_S, _SETTLING = 120.0, 0.125
_LEAST_OUT = 0.02  # of the capacity: a shorter piece tells nothing
_LEAST_SAMPLES = 10


def read_flights(log: Log, battery_id: int, series: int, capacity_ah: float) -> list[Experiment]:
    """What a log holds of one battery, cut where the pack was changed or the count of charge was lost.

    ``capacity_ah`` only scales what counts as resting and flying. Raises BadInputError where nothing is left.
    """
    recording = record(log, battery_id, series, capacity_ah * SECONDS_PER_HOUR)
    known = np.isfinite(recording.current_a)
    if not known.any():
        raise BadInputError(str(log.path), f"battery {battery_id} reports no current: charge cannot be counted")
    found = [
        _experiment(recording, piece, series)
        for piece in _pieces(recording, known)
        if piece.sum() >= _LEAST_SAMPLES and _out_c(recording, piece) > _LEAST_OUT * capacity_ah * SECONDS_PER_HOUR
    ]
    if not found:
        raise BadInputError(str(log.path), f"holds no flight that takes out {_LEAST_OUT:.0%} of {capacity_ah:.3g} Ah")
    if len(found) == 1:
        return [replace(found[0], label=log.path.name)]
    return [replace(e, label=f"{log.path.name} [{k}]") for k, e in enumerate(found, start=1)]


def _pieces(recording: Recording, known: Flags) -> list[Flags]:
    at = np.flatnonzero(known)
    t, amps = recording.time_s[at], np.abs(recording.current_a[at])
    dt = np.diff(t)
    loaded = amps > _LOADED * amps.max()
    lost = (dt > max(_GAP_S, _GAP_SAMPLES * float(np.median(dt)))) & (loaded[1:] | loaded[:-1])
    cuts = [float(s) for s in t[1:][lost]] + [s for s, _ in recording.pack_changes]
    number = np.searchsorted(np.sort(cuts), recording.time_s, side="right")
    return [known & (number == k) for k in range(len(cuts) + 1)]


def _out_c(recording: Recording, piece: Flags) -> float:
    t, amps = recording.time_s[piece], recording.current_a[piece]
    return float(np.sum(0.5 * (amps[1:] + amps[:-1]) * np.diff(t)))


def _experiment(recording: Recording, piece: Flags, series: int) -> Experiment:
    t, amps, volts = recording.time_s[piece], recording.current_a[piece], recording.voltage_v[piece] / series
    volts = np.where((volts > _CELL_V[0]) & (volts < _CELL_V[1]), volts, np.nan)
    loaded = amps > _LOADED * amps.max()
    # A pack at rest shows more than under load: else the flight controller ran from something else.
    volts[~loaded & (volts < np.nanmedian(volts[loaded]))] = np.nan
    if loaded[0]:
        volts[t - t[0] < min(_SETTLES_S, _SETTLING * (t[-1] - t[0]))] = np.nan
    kelvin = recording.temperature_k[piece]
    warm = np.isfinite(kelvin)
    return Experiment(
        label="",
        kind=Kind.FLIGHT,
        time_s=t - t[0],
        current_a=amps,
        voltage_v=volts,
        temperature_k=np.interp(t, t[warm], kelvin[warm]) if warm.any() else None,
    )
