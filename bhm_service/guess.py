"""A sensible vehicle from a log alone, when none is given; what was guessed, and from what, is said."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from bhm_service.assembly import Equipment
from bhm_service.battery.battery_file import BatteryFile, read_battery
from bhm_service.config import BatterySettings, Vehicle, shipped
from bhm_service.mavlink.log import Log
from bhm_service.mavlink.recording import battery_ids
from bhm_service.messages import AutopilotKind, BatterySample, Message, ParameterValue
from bhm_service.telemetry import SampleMerger
from bhm_service.units import SECONDS_PER_HOUR

GENERIC_BATTERY = "generic-lipo.toml"
GENERIC_LIHV = "generic-lihv.toml"
_FULL_CELL_V = 4.27  # [V] highest resting voltage of a cell charged to 4.20 V, by a meter that is a little off
_FULL_LIHV_V = 4.40  # [V] of one that is charged to 4.35 V
_LANDED_CELL_V = 3.70  # [V] highest resting voltage of a pack that has a fifth of its charge left, where flights end
_SOLD_SERIES = (1, 2, 3, 4, 6, 8, 10, 12, 14)
_CELLS_PARAMETERS = ("BAT{n}_N_CELLS", "BAT_N_CELLS")
_CAPACITY_PARAMETERS = ("BAT{n}_CAPACITY", "BAT_CAPACITY", "BATT{suffix}_CAPACITY")
_HOVER_C = 3.5  # [1/h] a multirotor built for quarter of an hour draws its pack's capacity at this rate
_GUESSED_SD = 0.20  # [-] of such a capacity
_LEAST_CAPACITY_MAH = 50.0  # a parameter below this was never set
_LONGEST_S = 60.0  # [s] that one reading may stand for
_REST_S = 60.0  # [s] after the last load, before a voltage counts as rested
_LEAST_FALL = 0.15  # [-] of state of charge between two rests, to divide by
_REST_SOC_SD = 0.035  # [-] of that fall


@dataclass(frozen=True, slots=True)
class Guess:
    """A vehicle and how it was come by."""

    vehicle: Vehicle
    reasons: tuple[str, ...]
    capacity_told: bool  # by the autopilot's parameters, not out of measurements


def guessed_equipment(log: Log, battery: Path | None, battery_id: int | None) -> tuple[Equipment, list[str]]:
    """A vehicle guessed from a log, and what was guessed; an identified battery says its own cells and capacity."""
    guess = guess_vehicle((message for _, message in log.messages), battery_id, log.path.stem)
    reasons = [f"vehicle guessed: {'; '.join(guess.reasons)}"]
    vehicle = guess.vehicle
    if battery is None:
        return Equipment(vehicle=vehicle, battery=read_battery(Path(vehicle.battery.file))), reasons
    known: BatteryFile = read_battery(battery)
    if known.series is not None:
        own = vehicle.battery.model_copy(update={"file": str(battery), "series": None, "capacity_ah": None})
        vehicle = vehicle.model_copy(update={"battery": own, "name": known.name})
        reasons = [f"cells and capacity from {battery.name}; no vehicle file given"]
    return Equipment(vehicle=vehicle, battery=known), reasons


def guess_vehicle(messages: Iterable[Message], battery_id: int | None, name: str) -> Guess:
    """Cells, capacity and battery id from what the autopilot said: its parameters first, then its measurements."""
    messages = list(messages)
    reasons: list[str] = []
    if battery_id is None:
        ids = battery_ids(messages)
        battery_id = min(ids, default=0)
        if len(ids) > 1:
            reasons.append(f"battery {battery_id}, the first of {', '.join(map(str, sorted(ids)))}")
    merger = SampleMerger(battery_id)
    samples = [sample for sample in map(merger.add, messages) if sample is not None]
    parameters = {m.name: m.value for m in messages if isinstance(m, ParameterValue)}
    high = _highest(samples)
    series, why = _series(high, parameters, battery_id)
    battery = GENERIC_BATTERY
    if high is not None and high > series * _FULL_CELL_V:
        battery, why = GENERIC_LIHV, f"{why}; LiHV cells, by {high / series:.2f} V a cell"
    reasons.append(f"{series} cells in series, from {why}")
    # PX4's percentage follows the voltage under load: it is no measure of charge.
    gauge_measures = merger.kind is not AutopilotKind.PX4
    capacity_ah, why, sd = _capacity(samples, parameters, battery_id, series, gauge_measures, battery)
    reasons.append(f"{capacity_ah:.1f} Ah, from {why}")
    return Guess(
        Vehicle(
            name=name,
            battery=BatterySettings(
                file=str(shipped("batteries", battery)),
                series=series,
                capacity_ah=capacity_ah,
                capacity_sd=min(sd, 0.3),
                id=battery_id,
            ),
        ),
        tuple(reasons),
        capacity_told=_told_capacity_mah(parameters, battery_id) is not None,
    )


def _told_capacity_mah(parameters: dict[str, float], battery_id: int) -> tuple[float, str] | None:
    told = _parameter(parameters, _CAPACITY_PARAMETERS, battery_id)
    return told if told is not None and told[0] >= _LEAST_CAPACITY_MAH else None


def _parameter(parameters: dict[str, float], patterns: Iterable[str], battery_id: int) -> tuple[float, str] | None:
    suffix = "" if battery_id == 0 else str(battery_id + 1)
    for pattern in patterns:
        name = pattern.format(n=battery_id + 1, suffix=suffix)
        if parameters.get(name, 0.0) > 0.0:
            return parameters[name], name
    return None


def _highest(samples: list[BatterySample]) -> float | None:
    """The highest voltage that lasts: single readings may be wrong. [V]"""
    known = [(s.time_s, s.voltage_v) for s in samples if s.voltage_v is not None]
    if not known:
        return None
    times, volts = (np.array(column) for column in zip(*known, strict=True))
    # A log that is written on change says by the next line how long a voltage was there.
    lasted = np.clip(np.diff(times, append=times[-1] + 1.0), 0.0, _LONGEST_S)
    order = np.argsort(volts)[::-1]
    place = int(np.searchsorted(np.cumsum(lasted[order]), 0.02 * lasted.sum(), side="right"))
    return float(volts[order[min(place, order.size - 1)]])


def _series(high: float | None, parameters: dict[str, float], battery_id: int) -> tuple[int, str]:
    told = _parameter(parameters, _CELLS_PARAMETERS, battery_id)
    if told is not None:
        return max(int(told[0]), 1), told[1]
    # A pack is seldom flown far below full.
    if high is None:
        return 4, "no voltage at all (a quad's usual number)"
    series, fewer = (_sold(high / volts) for volts in (_FULL_CELL_V, _FULL_LIHV_V))
    if fewer < series and high < series * _LANDED_CELL_V:
        series = fewer
    return series, f"{high:.1f} V when highest"


def _sold(least: float) -> int:
    """The smallest number of cells that packs are sold with, of those that are not less."""
    return next((n for n in _SOLD_SERIES if n >= least), math.ceil(least))


def _capacity(
    samples: list[BatterySample],
    parameters: dict[str, float],
    battery_id: int,
    series: int,
    gauge_measures: bool,
    battery: str,
) -> tuple[float, str, float]:
    """Capacity [Ah], what it comes from, and how well it is known."""
    told = _told_capacity_mah(parameters, battery_id)
    if told is not None:
        return told[0] / 1000.0, told[1], 0.05
    by_rest = _capacity_by_rest(samples, series, battery)
    if by_rest is not None:
        capacity_ah, sd = by_rest
        return capacity_ah, "the charge counted between two rests and their voltages", sd
    by_gauge = _capacity_by_gauge(samples) if gauge_measures else None
    if by_gauge is not None:
        return by_gauge, "the charge counted while the battery's own gauge fell", 0.08
    amps = sorted(s.current_a for s in samples if s.current_a is not None and s.current_a > 0.5)
    if not amps:
        return 5.0, "no measurement at all (no current was measured)", _GUESSED_SD
    hover = amps[len(amps) * 3 // 4]
    least = 1.1 * _charge(samples) / SECONDS_PER_HOUR
    capacity_ah = round(max(hover / _HOVER_C, least, 0.3), 1)
    return capacity_ah, f"a hover at {hover:.0f} A; give --vehicle to know better", _GUESSED_SD


def _charge(samples: list[BatterySample]) -> float:
    """Charge that went out over the samples [C]; gaps of more than a minute count as nothing."""
    known = [(s.time_s, s.current_a) for s in samples if s.current_a is not None]
    return sum(0.5 * (i + j) * (t - s) for (s, i), (t, j) in pairwise(known) if 0.0 < t - s < 60.0)


def _capacity_by_rest(samples: list[BatterySample], series: int, battery: str) -> tuple[float, float] | None:
    """Charge between the rest before the first load and the rest after the last, over the fall of the curve."""
    known = [s for s in samples if s.current_a is not None and s.voltage_v is not None]
    if not known:
        return None
    resting = 0.05 * max(abs(s.current_a or 0.0) for s in known)
    loaded = [k for k, s in enumerate(known) if abs(s.current_a or 0.0) > resting]
    if not loaded:
        return None
    first, last = loaded[0], loaded[-1]
    before, after = known[max(0, first - 20) : first], known[last + 1 :][-20:]
    rested_s = known[-1].time_s - known[last].time_s
    if len(before) < 3 or len(after) < 3 or rested_s < _REST_S:
        return None
    cell = read_battery(shipped("batteries", battery)).cell("circ")
    grid = np.linspace(0.0, 1.0, 501)
    curve = np.asarray(cell.open_circuit(grid))
    start, end = (
        float(np.interp(np.median([s.voltage_v or 0.0 for s in rest]) / series, curve, grid))
        for rest in (before, after)
    )
    fell = start - end
    if fell < _LEAST_FALL:
        return None
    return round(_charge(known) / SECONDS_PER_HOUR / fell, 1), max(0.05, _REST_SOC_SD / fell)


def _capacity_by_gauge(samples: list[BatterySample]) -> float | None:
    known = [s for s in samples if s.remaining is not None and s.current_a is not None]
    if len(known) < 10:
        return None
    used = _charge(known)
    fell = (known[0].remaining or 0.0) - (known[-1].remaining or 0.0)
    return round(used / SECONDS_PER_HOUR / fell, 1) if fell >= 0.25 and used > 0.0 else None
