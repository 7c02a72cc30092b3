"""Real recordings in, cases out: columns are read, withheld and written; nothing is copied into the project's tree."""

from __future__ import annotations

import csv
import gzip
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bhm_service.mavlink.dialect import ENUM
from bhm_service.mavlink.encode import stamped

Array: TypeAlias = NDArray[np.float64]
ZERO_CELSIUS_K = 273.15
_FLIGHT = ("t_s", "V", "I", "T_C", "soc_pct", "used_mAh", "alt_m", "speed_mps", "armed")
_BENCH = ("time_s", "current_A", "voltage_V", "temperature_C")
_EPOCH_S = 1_750_000_000.0
_NO_TEMPERATURE, _NO_CELL, _NO_CURRENT = 32767, 65535, -1  # the wire's words for unknown
_WORKS_A = 0.05  # of the largest current: below, a bench rests


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """One recording; NaN where a quantity was not recorded. Current is positive while discharging."""

    name: str
    time_s: Array  # since its first sample
    current_a: Array
    voltage_v: Array
    temperature_c: Array
    gauge_percent: Array
    armed: Array

    @property
    def hidden_temperature(self) -> dict[str, tuple[float, ...]]:
        """What is withheld, as an answer has it."""
        known = np.isfinite(self.temperature_c)
        kelvin = self.temperature_c[known] + ZERO_CELSIUS_K
        return {"time_s": tuple(self.time_s[known].tolist()), "temperature_K": tuple(kelvin.tolist())}

    def part(self, where: NDArray[np.intp]) -> Recording:
        """Some of its samples, from a first one on."""
        chosen = {k: getattr(self, k)[where] for k in ("time_s", "current_a", "voltage_v", "temperature_c")}
        chosen |= {k: getattr(self, k)[where] for k in ("gauge_percent", "armed")}
        chosen["time_s"] = chosen["time_s"] - chosen["time_s"][0]
        return replace(self, **chosen)


def read_flight(path: Path) -> Recording:
    """A flight's table as `../shared/data/flights` has it."""
    columns = _columns(path)
    return Recording(
        name=path.name,
        time_s=columns["t_s"] - columns["t_s"][0],
        current_a=columns["I"],
        voltage_v=columns["V"],
        temperature_c=columns["T_C"],
        gauge_percent=columns["soc_pct"],
        armed=columns["armed"],
    )


def read_bench(path: Path, label: str | None = None) -> Recording:
    """A bench recording of one cell, or one of its labels; armed from the first load on, rests after it included."""
    columns = _columns(path, label)
    time = columns["time_s"]
    forward = np.append(True, np.diff(np.maximum.accumulate(time)) > 0.0)
    current = columns["current_A"][forward]
    nothing = np.full(current.size, np.nan)
    working = np.flatnonzero(np.abs(current) > _WORKS_A * np.max(np.abs(current)))
    armed = np.zeros(current.size)
    armed[working[0] :] = 1.0
    return Recording(
        name=path.name.split(".")[0] + (f"_{label}" if label else ""),
        time_s=time[forward] - time[0],
        current_a=current,
        voltage_v=columns["voltage_V"][forward],
        temperature_c=columns["temperature_C"][forward],
        gauge_percent=nothing,
        armed=armed,
    )


def discharge_of(recording: Recording, rest_s: float = 120.0) -> Recording:
    """Its first discharge with up to ``rest_s`` of rest on either side, and never a charge."""
    loaded = recording.current_a > _WORKS_A * np.max(recording.current_a)
    first = int(np.argmax(loaded))
    charging = np.flatnonzero(recording.current_a[first:] < -_WORKS_A * np.max(recording.current_a))
    stop = first + int(charging[0]) if charging.size else recording.time_s.size
    last = int(np.flatnonzero(loaded[:stop])[-1])
    t = recording.time_s
    keep = (t >= t[first] - rest_s) & (t <= t[last] + rest_s) & (np.arange(t.size) < stop)
    return recording.part(np.flatnonzero(keep))


def write_flight(path: Path, recording: Recording, *, with_temperature: bool) -> None:
    """A table that `bhm replay` reads; what is withheld is blank."""
    r = recording
    kelvin = r.temperature_c if with_temperature else np.full(r.time_s.size, np.nan)
    nothing = np.full(r.time_s.size, np.nan)
    columns = (r.time_s, r.voltage_v, r.current_a, kelvin, r.gauge_percent, nothing, nothing, nothing, r.armed)
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(_FLIGHT)
        writer.writerows([_text(value) for value in row] for row in zip(*columns, strict=True))


def write_log(path: Path, recording: Recording, day: int, *, with_temperature: bool) -> float:
    """A bench recording as a telemetry log; returns its first time stamp. What is withheld is unknown in it.

    A table cannot say that a drive cycle is one flight through all its pauses; a log can, by its landed state.
    """
    r, out, begin_s = recording, bytearray(), _EPOCH_S + 86400.0 * day
    mavlink: Any = ENUM.MAVLink(None, srcSystem=1, srcComponent=ENUM.MAV_COMP_ID_AUTOPILOT1)
    for k in range(r.time_s.size):
        armed = bool(r.armed[k])
        mode = ENUM.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        landed = ENUM.MAV_LANDED_STATE_IN_AIR if armed else ENUM.MAV_LANDED_STATE_ON_GROUND
        warm = r.temperature_c[k] if with_temperature else np.nan
        centiamperes = round(100.0 * float(r.current_a[k]))
        for message in (
            ENUM.MAVLink_heartbeat_message(
                ENUM.MAV_TYPE_QUADROTOR, ENUM.MAV_AUTOPILOT_ARDUPILOTMEGA, mode, 0, ENUM.MAV_STATE_ACTIVE, 3
            ),
            ENUM.MAVLink_extended_sys_state_message(0, landed),
            ENUM.MAVLink_battery_status_message(
                0,
                ENUM.MAV_BATTERY_FUNCTION_ALL,
                ENUM.MAV_BATTERY_TYPE_LION,
                _NO_TEMPERATURE if np.isnan(warm) else round(100.0 * float(warm)),
                [round(1000.0 * float(r.voltage_v[k])), *[_NO_CELL] * 9],
                0 if centiamperes == _NO_CURRENT else centiamperes,
                -1,
                -1,
                -1,
            ),
        ):
            out += stamped(begin_s + float(r.time_s[k]), bytes(message.pack(mavlink)))
            mavlink.seq = (mavlink.seq + 1) % 256
    path.write_bytes(out)
    return begin_s + float(r.time_s[0])


def write_bench(path: Path, recording: Recording) -> None:
    """A bench table (.csv.gz)."""
    r = recording
    with gzip.open(path, "wt", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(_BENCH)
        for row in zip(r.time_s, r.current_a, r.voltage_v, r.temperature_c, strict=True):
            writer.writerow([_text(value) for value in row])


def _columns(path: Path, label: str | None = None) -> dict[str, Array]:
    with gzip.open(path, "rt", newline="") if path.suffix == ".gz" else path.open(newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if label is None or row["label"] == label]
    if not rows:
        raise ValueError(f"{path} has no row of {label}")
    names = [name for name in rows[0] if name != "label"]
    return {name: np.array([float(row[name]) if row[name] else np.nan for row in rows]) for name in names}


def _text(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.10g}"
