"""ArduPilot DataFlash logs (.bin) to the same messages as a tlog.

A log is a run of packets: two head bytes, a type, then a fixed number of bytes that a FMT packet has described.
The reader is our own because pymavlink's tells of damage with one printed line per byte, which nobody can catch.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bhm_service.mavlink.decode import measured_cells
from bhm_service.mavlink.tlog import Skipped
from bhm_service.messages import (
    Air,
    AutopilotClock,
    AutopilotKind,
    BatteryStatus,
    Heartbeat,
    Landed,
    LandedState,
    Message,
    MissionItem,
    Motion,
    ParameterValue,
)
from bhm_service.units import kelvin

HEAD = b"\xa3\x95"
_FMT = 128
_FMT_BODY = struct.Struct("<BB4s16s64s")
# Letters of a format (ArduPilot, libraries/AP_Logger/README.md): how each is packed, and what it is multiplied by.
_LETTERS: dict[str, tuple[str, float | None]] = {
    "a": ("64s", None), "n": ("4s", None), "N": ("16s", None), "Z": ("64s", None),
    "b": ("b", None), "B": ("B", None), "M": ("B", None), "h": ("h", None), "H": ("H", None),
    "i": ("i", None), "I": ("I", None), "q": ("q", None), "Q": ("Q", None),
    "f": ("f", None), "d": ("d", None), "g": ("e", None),
    "c": ("h", 0.01), "C": ("H", 0.01), "e": ("i", 0.01), "E": ("I", 0.01), "L": ("i", 1e-7),
}  # fmt: skip
_WANTED = frozenset({"BAT", "BCL", "BCL2", "CURR", "EV", "ARM", "PARM", "BARO", "CTUN", "GPS", "CMD"})
_FIRST_CELLS, _OTHER_CELLS = "BCL", "BCL2"  # up to the twelfth, and beyond
_ARMED, _DISARMED, _LANDED, _NOT_LANDED = 10, 11, 18, 28  # LogEvent numbers
_CENTIVOLTS_ABOVE = 80.0  # before ArduCopter 3.3 CURR counts in cV and cA: no pack has more volts than this
_GPS_EPOCH_S = 315_964_800.0  # Unix time of 1980-01-06
_WEEK_S = 604_800.0
_LEAP_S = 18.0  # GPS ahead of UTC; two seconds less in the oldest logs, which nothing here depends on


@dataclass(frozen=True, slots=True)
class _Format:
    name: str
    unpacker: struct.Struct
    scales: tuple[float | None, ...]
    columns: tuple[str, ...]
    length: int

    def fields(self, data: bytes, at: int) -> dict[str, Any]:
        numbers = self.unpacker.unpack_from(data, at + 3)
        scaled = (n if s is None else n * s for n, s in zip(numbers, self.scales, strict=True))
        return dict(zip(self.columns, scaled, strict=False))


def _format(body: tuple[int, int, bytes, bytes, bytes]) -> _Format | None:
    """The format that a FMT packet describes; None if its letters do not add up to its length."""
    _, length, name, letters, columns = body
    code, scales = "<", []
    for letter in letters.rstrip(b"\0").decode("ascii", "replace"):
        known = _LETTERS.get(letter)
        if known is None:
            return None
        code += known[0]
        scales.append(known[1])
    unpacker = struct.Struct(code)
    if unpacker.size != length - 3:
        return None
    return _Format(
        name.rstrip(b"\0").decode("ascii", "replace"),
        unpacker,
        tuple(scales),
        tuple(columns.rstrip(b"\0").decode("ascii", "replace").split(",")),
        length,
    )


class DataFlashReader:
    """Messages of a DataFlash log; times are Unix seconds where the log has GPS time, else seconds since boot."""

    def __init__(self, path: Path) -> None:
        self.data = path.read_bytes()
        self.skipped = Skipped()

    def __iter__(self) -> Iterator[Message]:
        offset_s, first_s = self._boot_to_unix()
        now, armed = first_s + offset_s, None
        cells: dict[int, tuple[float, ...]] = {}
        for kind, f in self._packets():
            boot_s = _boot_s(kind, f)
            if boot_s is not None:
                now = boot_s + offset_s
            if kind in (_FIRST_CELLS, _OTHER_CELLS):
                battery = int(f.get("Instance", 0))
                cells[battery] = (() if kind == _FIRST_CELLS else cells.get(battery, ())) + _cells(f)
            for message in _decoded(kind, f, now, boot_s):
                if isinstance(message, BatteryStatus) and message.battery_id in cells:
                    # They are logged after their battery, and are its next sample's.
                    message = replace(message, cells_v=measured_cells(cells.pop(message.battery_id)))
                if isinstance(message, Heartbeat):
                    armed = message.armed
                elif armed is None and isinstance(message, BatteryStatus):
                    # Logging begins on arming unless it is told otherwise, and says so only from Copter 4.0 on.
                    armed = True
                    yield _heartbeat(now, True)
                yield message

    def _packets(self, count: bool = True) -> Iterator[tuple[str, dict[str, Any]]]:
        data, size = self.data, len(self.data)
        formats: dict[int, _Format] = {}
        at = 0
        while at + 3 <= size:
            if data[at : at + 2] != HEAD or (data[at + 2] != _FMT and data[at + 2] not in formats):
                again = self._find_again(at + 1, formats)
                if count:
                    self.skipped.places += 1
                    self.skipped.bytes += again - at
                at = again
                continue
            if data[at + 2] == _FMT:
                end = at + 3 + _FMT_BODY.size
                if end > size:
                    break
                body = _FMT_BODY.unpack_from(data, at + 3)
                described = _format(body)
                if described is not None:
                    formats[body[0]] = described
            else:
                form = formats[data[at + 2]]
                end = at + form.length
                if end > size:
                    break
                if form.name in _WANTED:
                    yield form.name, form.fields(data, at)
            at = end
        if at < size and count:
            self.skipped.truncated = True
            self.skipped.bytes += size - at

    def _find_again(self, at: int, formats: dict[int, _Format]) -> int:
        """Where the next packet of a known kind begins that another one (or the end) follows."""
        data, size = self.data, len(self.data)
        while True:
            at = data.find(HEAD, at)
            if at < 0 or at + 3 > size:
                return size
            kind = data[at + 2]
            length = 3 + _FMT_BODY.size if kind == _FMT else formats[kind].length if kind in formats else 0
            if length and (at + length >= size or data[at + length : at + length + 2] == HEAD):
                return at
            at += 1

    def _boot_to_unix(self) -> tuple[float, float]:
        """What to add to a time since boot, and the first such time in the log."""
        first: float | None = None
        for kind, f in self._packets(count=False):
            boot = _boot_s(kind, f)
            if boot is None:
                continue
            first = boot if first is None else first
            week, milliseconds = f.get("GWk", f.get("Week")), f.get("GMS", f.get("TimeMS"))
            if kind == "GPS" and f.get("Status", 0) >= 3 and week and milliseconds is not None:
                return float(_GPS_EPOCH_S + week * _WEEK_S + milliseconds / 1e3 - _LEAP_S - boot), first
        return 0.0, first or 0.0


def _boot_s(kind: str, f: dict[str, Any]) -> float | None:
    if "TimeUS" in f:
        return float(f["TimeUS"]) / 1e6
    if kind == "GPS":  # its TimeMS is GPS time
        return float(f["T"]) / 1e3 if "T" in f else None
    return float(f["TimeMS"]) / 1e3 if "TimeMS" in f else None


def _heartbeat(time_s: float, armed: bool) -> Heartbeat:
    return Heartbeat(time_s=time_s, system=1, component=1, kind=AutopilotKind.ARDUPILOT, armed=armed)


def _decoded(kind: str, f: dict[str, Any], time_s: float, boot_s: float | None) -> list[Message]:
    if kind in ("BAT", "CURR"):
        battery = _battery(f, time_s)
        return [battery] if boot_s is None else [AutopilotClock(time_s=time_s, boot_s=boot_s), battery]
    if kind == "EV":
        return _event(f.get("Id"), time_s)
    if kind == "ARM":
        return [_heartbeat(time_s, bool(f.get("ArmState")))]
    if kind == "PARM":
        value = _number(f.get("Value"))
        name = f["Name"].rstrip(b"\0").decode("ascii", "replace")
        return [] if value is None else [ParameterValue(time_s=time_s, name=name, value=value)]
    if kind == "BARO" and f.get("I", 0) == 0:
        celsius = _number(f.get("Temp"))
        return [
            Air(
                time_s=time_s,
                pressure_pa=_number(f.get("Press")),
                board_temperature_k=None if celsius is None else kelvin(celsius),
                boot_s=boot_s,
            )
        ]
    if kind == "CTUN":
        return [Motion(time_s=time_s, relative_altitude_m=_number(f.get("Alt")), throttle=_number(f.get("ThO")))]
    if kind == "GPS" and f.get("I", 0) == 0:
        return [
            Motion(
                time_s=time_s,
                altitude_m=_number(f.get("Alt")),
                ground_speed_mps=_number(f.get("Spd")),
                latitude_deg=_number(f.get("Lat")),
                longitude_deg=_number(f.get("Lng")),
            )
        ]
    if kind == "CMD":
        return [
            MissionItem(
                time_s=time_s,
                sequence=int(f["CNum"]),
                command=int(f["CId"]),
                latitude_deg=_number(f.get("Lat")),
                longitude_deg=_number(f.get("Lng")),
                altitude_m=_number(f.get("Alt")),
                hold_s=_number(f.get("Prm1")),
            )
        ]
    return []


def _battery(f: dict[str, Any], time_s: float) -> BatteryStatus:
    volts, amps = _number(f.get("Volt")), _number(f.get("Curr"))
    if volts is not None and volts > _CENTIVOLTS_ABOVE:
        volts, amps = volts / 100.0, None if amps is None else amps / 100.0
    celsius = _number(f.get("Temp"))
    percent = _number(f.get("RemPct"))
    consumed = _number(f.get("CurrTot"))
    return BatteryStatus(
        time_s=time_s,
        battery_id=int(f.get("Inst", f.get("Instance", 0))),
        voltage_v=volts if volts else None,
        cells_v=None,
        current_a=amps,
        temperature_k=kelvin(celsius) if celsius else None,  # exactly 0 is "no sensor" here
        consumed_c=None if consumed is None else consumed * 3.6,
        remaining=None if percent is None or not 0.0 <= percent <= 100.0 else percent / 100.0,
    )


def _cells(f: dict[str, Any]) -> tuple[float, ...]:
    """Cells [V] of a packet; they are logged as a millivolt more, so that nothing is what was not measured."""
    columns = [name for name in f if name[:1] == "V" and name[1:].isdigit()]
    return tuple((f[name] - 1) / 1000.0 for name in columns if f[name])


def _event(number: int | None, time_s: float) -> list[Message]:
    if number in (_ARMED, _DISARMED):
        return [_heartbeat(time_s, number == _ARMED)]
    if number in (_LANDED, _NOT_LANDED):
        return [LandedState(time_s=time_s, state=Landed.ON_GROUND if number == _LANDED else Landed.IN_AIR)]
    return []


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
