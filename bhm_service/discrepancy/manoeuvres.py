"""What a pilot can do to let the recordings tell more, the cheap first, and what a flight with it looks like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bhm_service.discrepancy.flights import FlightData, usual_step_s
from bhm_service.units import ZERO_CELSIUS_K, Array

_COLD_K = ZERO_CELSIUS_K + 5.0
_PULSE_S, _SETTLED_S = 5.0, 30.0  # each throttle step, and after take-off the first


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """Something that a pilot can do."""

    words: str
    flown: Callable[[FlightData, float], FlightData]  # (an ordinary flight, capacity [C]) -> the same with it
    soaked_k: float | None = None  # temperature of pack and air from the start, where it says one


def _extended(data: FlightData, seconds: float, current: float, before: bool) -> FlightData:
    step = usual_step_s([data])
    count = max(int(seconds / step), 2)
    more = np.full(count, current)

    def with_(series: Array, extra: Array) -> Array:
        return np.concatenate([extra, series] if before else [series, extra])

    def held(series: Array) -> Array:
        return with_(series, np.full(count, series[0 if before else -1]))

    return replace(
        data,
        time_s=step * np.arange(float(data.time_s.size + count)),
        current_a=with_(data.current_a, more),
        shifts_a=None,
        voltage_v=held(data.voltage_v),
        temperature_k=None if data.temperature_k is None else held(data.temperature_k),
        airborne=with_(data.airborne.astype(float), np.zeros(count)) > 0.5,
        altitude_m=held(data.altitude_m),
        climb_mps=held(data.climb_mps),
        speed_mps=held(data.speed_mps),
        pressure_pa=held(data.pressure_pa),
    )


def _steps(data: FlightData, _: float) -> FlightData:
    hover = float(np.mean(data.current_a[data.airborne])) if data.airborne.any() else float(data.current_a.max())
    step = usual_step_s([data])
    pulses = np.repeat([2.0 * hover, hover] * 3, max(round(_PULSE_S / step), 1))
    current = data.current_a.copy()
    first = int(np.argmax(data.airborne)) + round(_SETTLED_S / step)
    stop = min(first + pulses.size, current.size)
    current[first:stop] = pulses[: stop - first]
    return replace(data, current_a=current, shifts_a=None)


def _deep(data: FlightData, capacity_c: float) -> FlightData:
    hover = float(np.mean(data.flown_a))
    left = 0.85 * capacity_c - float(data.charge_c[-1])
    return data if left <= 0.0 else _extended(data, left / max(hover, 1e-3), hover, before=False)


def _cold(data: FlightData, _: float) -> FlightData:
    if data.temperature_k is None:
        return data
    return replace(data, temperature_k=data.temperature_k - data.temperature_k[0] + _COLD_K)


ORDINARY = Manoeuvre("fly as before", lambda d, _: d)
MENU = (
    Manoeuvre("record a minute of rest before arming", lambda d, _: _extended(d, 60.0, 0.0, before=True)),
    Manoeuvre("three throttle steps of 5 s to full", _steps),
    Manoeuvre(
        "keep recording for 10 minutes of rest after landing", lambda d, _: _extended(d, 600.0, 0.0, before=False)
    ),
    Manoeuvre("hover down to 15 % of charge", _deep),
    Manoeuvre("start with the pack soaked at 5 degC", _cold, soaked_k=_COLD_K),
)
