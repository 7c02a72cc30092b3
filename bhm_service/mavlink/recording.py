"""A log as arrays: what the analysis of whole recordings works on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bhm_service.errors import BadInputError
from bhm_service.mavlink.log import Log
from bhm_service.messages import Air, BatterySample, BatteryStatus, Message, Motion, ParameterValue, Wind
from bhm_service.telemetry import (
    PackWatch,
    PhaseDetector,
    SampleMerger,
    default_airborne_a,
    resting_a,
)
from bhm_service.units import SECONDS_PER_HOUR, Array

# Since its boot: until then a board is about as warm as what is around it. Later it is its own warmth, 15 to 25 K.
_COLD_S = 120.0


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight of a recording: from ``begin`` up to, not including, ``end`` (indices of samples)."""

    begin: int
    end: int
    because: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """One battery of one log. All arrays have one entry per sample; NaN where a quantity was not recorded."""

    label: str
    battery_id: int
    time_s: Array
    voltage_v: Array
    current_a: Array  # positive while discharging
    temperature_k: Array
    remaining: Array  # the autopilot's own fraction
    relative_altitude_m: Array
    ground_speed_mps: Array
    air_speed_mps: Array
    climb_mps: Array
    throttle: Array
    pressure_pa: Array
    wind_mps: Array
    board_k: Array  # of the barometer's board
    cells_v: Array | None = None  # of each cell (.., series); None where no log tells
    flights: tuple[Flight, ...]
    pack_changes: tuple[tuple[float, str], ...]  # time and reason
    parameters: dict[str, float]
    cold_board_k: float | None = None  # what the barometer's board was at soon after boot; None where no log tells

    @property
    def charge_c(self) -> Array:
        """Charge taken out since the first sample; where current is not known, none is counted. [C]"""
        amps = np.nan_to_num(self.current_a)
        steps = 0.5 * (amps[1:] + amps[:-1]) * np.diff(self.time_s)
        return np.concatenate([[0.0], np.cumsum(steps)])


_MOTION = ("relative_altitude_m", "ground_speed_mps", "air_speed_mps", "climb_mps", "throttle")
_AROUND = ("pressure_pa", "wind_mps", "board_k")


def battery_ids(messages: Iterable[Message]) -> set[int]:
    """Batteries that a log speaks of; SYS_STATUS alone counts as battery 0."""
    merger = SampleMerger(battery_id=0)
    heard = False
    for message in messages:
        heard = merger.add(message) is not None or heard
    return merger.ids | ({0} if heard else set())


def record(log: Log, battery_id: int, series: int, capacity_c: float, airborne_a: float | None = None) -> Recording:
    """The followed battery of a log as arrays.

    ``series`` and ``capacity_c`` [C] scale what counts as flying, resting and another pack. Raises BadInputError when
    the log has nothing of that battery.
    """
    capacity_a = capacity_c / SECONDS_PER_HOUR
    merger = SampleMerger(battery_id)
    phases = PhaseDetector(airborne_a if airborne_a is not None else default_airborne_a(capacity_a))
    watch = PackWatch(series, rest_a=resting_a(capacity_a))
    now = dict.fromkeys((*_MOTION, *_AROUND), np.nan)
    rows: list[tuple[float, ...]] = []
    times: list[float] = []
    edges: list[tuple[float, bool, str]] = []
    changes: list[tuple[float, str]] = []
    parameters: dict[str, float] = {}
    cells: list[tuple[float, ...]] = []  # since the last sample
    of_cells: list[Array | None] = []
    air: Air | None = None  # the first that was told: a board that booted again later is a warm one
    for _, message in log.messages:
        if isinstance(message, Motion):
            for name in _MOTION:
                value = getattr(message, name)
                if value is not None:
                    now[name] = value
        elif isinstance(message, Air):
            if message.pressure_pa is not None:
                now["pressure_pa"] = message.pressure_pa
            if message.board_temperature_k is not None:
                now["board_k"] = message.board_temperature_k
            air = air or message
        elif isinstance(message, Wind):
            now["wind_mps"] = message.speed_mps
        elif isinstance(message, ParameterValue):
            parameters[message.name] = message.value
        elif isinstance(message, BatteryStatus) and message.battery_id == battery_id:
            # Of another number of cells than the pack has some are not connected, or none of them is one.
            cells += [message.cells_v] if message.cells_v is not None and len(message.cells_v) == series else []
        sample = merger.add(message)
        for item in (message, sample):
            if item is None:
                continue
            phase = phases.add(item)
            if phase is not None:
                edges.append((phase.time_s, phase.airborne, phase.because))
            change = watch.add(item, phases.airborne)
            if change is not None:
                changes.append((change.time_s, change.because))
        if sample is not None and (not times or sample.time_s > times[-1]):
            times.append(sample.time_s)
            rows.append(_row(sample, now))
            of_cells.append(np.mean(cells, axis=0) if cells else None)
            cells = []
    if not rows:
        there = ", ".join(str(i) for i in sorted(battery_ids(m for _, m in log.messages))) or "none"
        raise BadInputError(str(log.path), f"battery id {battery_id}: no sample of it; ids in this log: {there}")
    table = np.array(rows)
    columns = dict(zip(_COLUMNS, table.T, strict=True))
    return Recording(
        label=log.path.stem,
        battery_id=battery_id,
        flights=_flights(np.array(times), edges),
        pack_changes=tuple(changes),
        parameters=parameters,
        cold_board_k=_cold_board_k(air),
        cells_v=_cells_v(of_cells, series),
        **columns,
    )


def _cells_v(rows: list[Array | None], series: int) -> Array | None:
    if all(row is None for row in rows):
        return None
    return np.array([np.full(series, np.nan) if row is None else row for row in rows])


def _cold_board_k(first: Air | None) -> float | None:
    if first is None or first.boot_s is None or first.boot_s > _COLD_S:
        return None
    return first.board_temperature_k


_COLUMNS = (
    "time_s",
    "voltage_v",
    "current_a",
    "temperature_k",
    "remaining",
    *_MOTION,
    *_AROUND,
)


def _row(sample: BatterySample, now: dict[str, float]) -> tuple[float, ...]:
    def known(value: float | None) -> float:
        return np.nan if value is None else value

    return (
        sample.time_s,
        known(sample.voltage_v),
        known(sample.current_a),
        known(sample.temperature_k),
        known(sample.remaining),
        *(now[name] for name in (*_MOTION, *_AROUND)),
    )


def _flights(times: Array, edges: list[tuple[float, bool, str]]) -> tuple[Flight, ...]:
    flights: list[Flight] = []
    began: tuple[float, str] | None = None
    for time_s, airborne, because in edges:
        if airborne:
            began = (time_s, because)
        elif began is not None:
            flights.append(_flight(times, began, time_s))
            began = None
    if began is not None:
        flights.append(_flight(times, began, float(times[-1]) + 1.0))
    return tuple(flight for flight in flights if flight.end > flight.begin)


def _flight(times: Array, began: tuple[float, str], ended_s: float) -> Flight:
    return Flight(int(np.searchsorted(times, began[0])), int(np.searchsorted(times, ended_s)), began[1])
