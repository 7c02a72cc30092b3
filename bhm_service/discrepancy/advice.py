"""What to fly next, so that the recordings can tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.findings import Verdict
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.search import Names, Search
from bhm_service.discrepancy.selection import Selection
from bhm_service.units import ZERO_CELSIUS_K, Array

_ENOUGH = 5.0  # standard deviations by which two explanations have to part
_COLD_K = ZERO_CELSIUS_K + 5.0


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """Something that a pilot can do, the cheap first."""

    words: str
    flown: Callable[[FlightData, float], FlightData]  # (an ordinary flight, capacity [C]) -> the same with it


def advice(found: Search, chosen: Selection, verdict: Verdict) -> list[str]:
    """The cheapest manoeuvre that would settle each rivalry, by simulation; for other verdicts what would show more."""
    if verdict == "ambiguous":
        said = [line for names in chosen.alternatives[:3] for line in _settling(found, chosen.names, names)]
        return list(dict.fromkeys(said))
    if verdict == "not-excited":
        dull = sorted(found.snr, key=lambda name: found.snr[name])[:3]
        return [f"{EFFECTS[name].title}: {EFFECTS[name].manoeuvre}." for name in dull]
    return []


def _settling(found: Search, names: Names, rival: Names) -> list[str]:
    one, other = found.fitted(names), found.fitted(rival)
    title = " and ".join(sorted(rival - names) or sorted(rival))
    for manoeuvre in MENU:
        parted = _parted(found, one, other, manoeuvre)
        if parted > _ENOUGH:
            return [f"Against {title}: {manoeuvre.words} (would part the two by {parted:.0f} sigma)."]
    special = next((EFFECTS[n].manoeuvre for n in sorted(names - rival)), "")
    return [f"Against {title}: no flight tells the two apart; {special}."] if special else []


def _parted(found: Search, one: Fitted, other: Fitted, manoeuvre: Manoeuvre) -> float:
    """Standard deviations between what two explanations say of a flight with the manoeuvre, its start left free."""
    usual = max(found.base.flights, key=lambda f: f.time_s[-1])
    data = manoeuvre.flown(replace(usual, voltage_v=np.zeros_like(usual.voltage_v)), found.base.lab.capacity_c)
    data = replace(data, notes=replace(data.notes, rest_voltage_v=None))
    difference = found.noise.whitened((_said(one, data) - _said(other, data))[None, :])[0]
    level = found.noise.whitened(np.vstack([np.ones(difference.size), data.current_a]))
    free = np.linalg.lstsq(level.T, difference, rcond=None)[0]
    return float(np.sqrt(np.sum((difference - free @ level) ** 2)))


def _said(fitted: Fitted, data: FlightData) -> Array:
    """A new flight by a fit: what all flights share as found, what differs between them at its mean."""
    members: tuple[Candidate, ...] = tuple(
        replace(c, fixed={key: [told[-1]] for key, told in c.fixed.items()}) for c in fitted.joint.members
    )
    joint = Joint(fitted.joint.lab, (data,), members)
    x = joint.unknowns.start.copy()
    for block in fitted.joint.unknowns.blocks:
        values = fitted.x[fitted.joint.unknowns.slice_of(block.name)]
        shared = block.name not in fitted.joint.per_flight
        x[joint.unknowns.slice_of(block.name)] = values if shared else values.mean()
    return np.asarray(joint.predicted(x[None, :], 0, forms=False).voltage[0])


def _extended(data: FlightData, seconds: float, current: float, before: bool) -> FlightData:
    step = float(np.median(np.diff(data.time_s)))
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
    pulses = np.repeat([2.0 * hover, hover] * 3, 5)
    current = data.current_a.copy()
    first = int(np.argmax(data.airborne)) + 30
    stop = min(first + pulses.size, current.size)
    current[first:stop] = pulses[: stop - first]
    return replace(data, current_a=current, shifts_a=None)


def _deep(data: FlightData, capacity_c: float) -> FlightData:
    hover = float(np.mean(data.current_a[data.airborne])) if data.airborne.any() else float(data.current_a.mean())
    left = 0.85 * capacity_c - float(data.charge_c[-1])
    return data if left <= 0.0 else _extended(data, left / max(hover, 1e-3), hover, before=False)


def _cold(data: FlightData, _: float) -> FlightData:
    if data.temperature_k is None:
        return data
    return replace(data, temperature_k=data.temperature_k - data.temperature_k[0] + _COLD_K)


MENU = (
    Manoeuvre("record a minute of rest before arming", lambda d, _: _extended(d, 60.0, 0.0, before=True)),
    Manoeuvre("three throttle steps of 5 s to full", _steps),
    Manoeuvre(
        "keep recording for 10 minutes of rest after landing", lambda d, _: _extended(d, 600.0, 0.0, before=False)
    ),
    Manoeuvre("hover down to 15 % of charge", _deep),
    Manoeuvre("start with the pack soaked at 5 degC", _cold),
)
