"""MAVLink payloads to messages in SI units. Sentinels end here: past this file unknown is None."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from bhm_service.mavlink.dialect import ENUM, unpack
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
    MissionProgress,
    Motion,
    ParameterValue,
    SystemStatus,
    Wind,
)
from bhm_service.units import kelvin

_UINT16_MAX = 65535
_INT16_MAX = 32767
_SATURATED_CA = 32766  # ArduPilot clips at 327.67 A
_PX4_NO_SENSOR_CA = -100  # PX4 says -1.00 A without a current sensor
_PLAUSIBLE_C = (-60.0, 120.0)

_KINDS = {
    ENUM.MAV_AUTOPILOT_ARDUPILOTMEGA: AutopilotKind.ARDUPILOT,
    ENUM.MAV_AUTOPILOT_PX4: AutopilotKind.PX4,
}


def current_a(centiamperes: int, kind: AutopilotKind) -> float | None:
    """A current field [cA]: -1 is unknown, PX4 without a sensor says -100, a clipped reading is not one."""
    if centiamperes == -1 or abs(centiamperes) >= _SATURATED_CA:
        return None
    if kind is AutopilotKind.PX4 and centiamperes == _PX4_NO_SENSOR_CA:
        return None
    return centiamperes / 100.0


def pack_voltage(
    voltages: tuple[int, ...], voltages_ext: tuple[int, ...]
) -> tuple[float | None, tuple[float, ...] | None]:
    """Pack voltage [V], and the cells where they were measured one by one.

    A pack voltage without cells sits in the first slot and spills into the next above 65.534 V: the sum is right
    either way. Absent cells are 65535, in the extension 0 (or 65535 from PX4 1.13-1.14).
    """
    present = [v for v in voltages if v not in (_UINT16_MAX, 0)]
    extended = [v for v in voltages_ext if v not in (_UINT16_MAX, 0)]
    if not present:
        return None, None
    cells = [*present, *extended] if len(present) == len(voltages) else present
    total = sum(cells) / 1000.0
    spilled = present[0] == _UINT16_MAX - 1
    return total, None if spilled else measured_cells(tuple(v / 1000.0 for v in cells))


def measured_cells(cells_v: tuple[float, ...]) -> tuple[float, ...] | None:
    """Cells [V] where they were measured one by one: all equal they are an average dealt out, no proof of balance."""
    return cells_v if len(set(cells_v)) > 1 else None


def temperature_k(centicelsius: int) -> float | None:
    """A temperature field [c degC]; 32767 is unknown, and so is what no pack survives."""
    celsius = centicelsius / 100.0
    if centicelsius == _INT16_MAX or not _PLAUSIBLE_C[0] <= celsius <= _PLAUSIBLE_C[1]:
        return None
    return kelvin(celsius)


def _fraction(percent: int) -> float | None:
    return percent / 100.0 if 0 <= percent <= 100 else None


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _heartbeat(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    # Ground stations and companions have no autopilot; gimbals and cameras may claim one, but are not component 1.
    if f["autopilot"] == ENUM.MAV_AUTOPILOT_INVALID or source[1] != ENUM.MAV_COMP_ID_AUTOPILOT1:
        return []
    armed = bool(f["base_mode"] & ENUM.MAV_MODE_FLAG_SAFETY_ARMED)
    said = _KINDS.get(f["autopilot"], AutopilotKind.OTHER)
    return [Heartbeat(time_s=time_s, system=source[0], component=source[1], kind=said, armed=armed)]


def _system_status(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    millivolts = f["voltage_battery"]
    return [
        SystemStatus(
            time_s=time_s,
            voltage_v=None if millivolts in (0, _UINT16_MAX) else millivolts / 1000.0,
            current_a=current_a(f["current_battery"], kind),
            remaining=_fraction(f["battery_remaining"]),
        )
    ]


def _battery_status(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    voltage, cells = pack_voltage(f["voltages"], f["voltages_ext"])
    consumed = f["current_consumed"]
    return [
        BatteryStatus(
            time_s=time_s,
            battery_id=f["id"],
            voltage_v=voltage,
            cells_v=cells,
            current_a=current_a(f["current_battery"], kind),
            temperature_k=temperature_k(f["temperature"]),
            consumed_c=None if consumed < 0 else consumed * 3.6,
            remaining=_fraction(f["battery_remaining"]),
        )
    ]


def _battery2(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    millivolts = f["voltage"]
    return [
        BatteryStatus(
            time_s=time_s,
            battery_id=1,
            voltage_v=None if millivolts in (0, _UINT16_MAX) else millivolts / 1000.0,
            cells_v=None,
            current_a=current_a(f["current_battery"], kind),
            temperature_k=None,
            consumed_c=None,
            remaining=None,
        )
    ]


def _landed(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    try:
        return [LandedState(time_s=time_s, state=Landed(f["landed_state"]))]
    except ValueError:
        return []  # undefined


def _position(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    placed = f["lat"] != 0 or f["lon"] != 0
    return [
        AutopilotClock(time_s=time_s, boot_s=f["time_boot_ms"] / 1000.0),
        Motion(
            time_s=time_s,
            relative_altitude_m=f["relative_alt"] / 1000.0,
            altitude_m=f["alt"] / 1000.0,
            ground_speed_mps=math.hypot(f["vx"], f["vy"]) / 100.0,
            climb_mps=-f["vz"] / 100.0,
            latitude_deg=f["lat"] / 1e7 if placed else None,
            longitude_deg=f["lon"] / 1e7 if placed else None,
        ),
    ]


def _vfr_hud(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    return [
        Motion(
            time_s=time_s,
            altitude_m=_finite(f["alt"]),
            ground_speed_mps=_finite(f["groundspeed"]),
            air_speed_mps=_finite(f["airspeed"]),
            climb_mps=_finite(f["climb"]),
            throttle=f["throttle"] / 100.0,
        )
    ]


def _pressure(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    hectopascal = _finite(f["press_abs"])
    return [
        Air(
            time_s=time_s,
            pressure_pa=None if hectopascal is None or hectopascal <= 0.0 else hectopascal * 100.0,
            board_temperature_k=temperature_k(f["temperature"]),
            boot_s=f["time_boot_ms"] / 1000.0,
        )
    ]


def _system_time(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    micros = f["time_unix_usec"]
    return [
        AutopilotClock(
            time_s=time_s,
            boot_s=f["time_boot_ms"] / 1000.0,
            unix_s=micros / 1e6 if micros > 10**15 else None,
        )
    ]


def _parameter(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    name = f["param_id"].split(b"\0")[0].decode("ascii", "replace")
    value = float(f["param_value"])
    if kind is AutopilotKind.PX4 and f["param_type"] == ENUM.MAV_PARAM_TYPE_INT32:
        # PX4 sends the bits of an integer in the float's place; ArduPilot its value.
        value = float(struct.unpack("<i", struct.pack("<f", f["param_value"]))[0])
    return [ParameterValue(time_s=time_s, name=name, value=value)] if math.isfinite(value) else []


def _mission_item(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    if f.get("mission_type", 0) != ENUM.MAV_MISSION_TYPE_MISSION:
        return []
    scale = 1e7 if isinstance(f["x"], int) else 1.0
    placed = (f["x"] != 0 or f["y"] != 0) and math.isfinite(f["x"]) and math.isfinite(f["y"])
    return [
        MissionItem(
            time_s=time_s,
            sequence=f["seq"],
            command=f["command"],
            latitude_deg=f["x"] / scale if placed else None,
            longitude_deg=f["y"] / scale if placed else None,
            altitude_m=_finite(f["z"]),
            hold_s=_finite(f["param1"]),
        )
    ]


def _mission_current(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    return [MissionProgress(time_s=time_s, sequence=f["seq"])]


def _wind(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    if not (math.isfinite(f["speed"]) and math.isfinite(f["direction"])):
        return []
    return [Wind(time_s=time_s, speed_mps=f["speed"], direction_deg=f["direction"])]


def _wind_cov(f: dict[str, Any], time_s: float, source: tuple[int, int], kind: AutopilotKind) -> list[Message]:
    north, east = f["wind_x"], f["wind_y"]
    if not (math.isfinite(north) and math.isfinite(east)):
        return []
    # The vector points where the air goes; a wind is named after where it comes from.
    comes_from = math.degrees(math.atan2(-east, -north)) % 360.0
    return [Wind(time_s=time_s, speed_mps=math.hypot(north, east), direction_deg=comes_from)]


_Decoder = Callable[[dict[str, Any], float, tuple[int, int], AutopilotKind], list[Message]]
_DECODERS: dict[int, _Decoder] = {
    ENUM.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    ENUM.MAVLINK_MSG_ID_SYS_STATUS: _system_status,
    ENUM.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
    ENUM.MAVLINK_MSG_ID_PARAM_VALUE: _parameter,
    ENUM.MAVLINK_MSG_ID_SCALED_PRESSURE: _pressure,
    ENUM.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _position,
    ENUM.MAVLINK_MSG_ID_MISSION_ITEM: _mission_item,
    ENUM.MAVLINK_MSG_ID_MISSION_CURRENT: _mission_current,
    ENUM.MAVLINK_MSG_ID_MISSION_ITEM_INT: _mission_item,
    ENUM.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    ENUM.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    ENUM.MAVLINK_MSG_ID_WIND: _wind,
    ENUM.MAVLINK_MSG_ID_BATTERY2: _battery2,
    ENUM.MAVLINK_MSG_ID_WIND_COV: _wind_cov,
    ENUM.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _landed,
}

WANTED = frozenset(_DECODERS)
_MISSION_ITEMS = (ENUM.MAVLINK_MSG_ID_MISSION_ITEM, ENUM.MAVLINK_MSG_ID_MISSION_ITEM_INT)


class VehicleDecoder:
    """Frames of one vehicle's autopilot to messages; everything else on the link is passed over.

    The vehicle is ``system`` where given, else the first whose autopilot sends a heartbeat. Before that heartbeat
    nothing is believed.
    """

    def __init__(self, system: int | None = None) -> None:
        self.system = system
        self.component: int | None = None
        self.kind = AutopilotKind.OTHER
        self.others: set[int] = set()  # systems of other autopilots on the link

    def decode(self, message_id: int, payload: bytes, source: tuple[int, int], time_s: float) -> list[Message]:
        """Messages in one frame: mostly one, sometimes none or two. Never raises for what came over the wire."""
        decoder = _DECODERS.get(message_id)
        if decoder is None:
            return []
        if message_id == ENUM.MAVLINK_MSG_ID_HEARTBEAT:
            return self._learn(decoder(unpack(message_id, payload), time_s, source, self.kind))
        if self.component is None:
            return []
        if source != (self.system, self.component):
            # A mission is uploaded by a ground station: its items tell the plan as well as the autopilot's own do.
            if message_id not in _MISSION_ITEMS:
                return []
            fields = unpack(message_id, payload)
            return decoder(fields, time_s, source, self.kind) if fields["target_system"] == self.system else []
        return decoder(unpack(message_id, payload), time_s, source, self.kind)

    def _learn(self, found: list[Message]) -> list[Message]:
        for message in found:
            assert isinstance(message, Heartbeat)
            if self.system is None:
                self.system = message.system
            if message.system != self.system:
                self.others.add(message.system)
                return []
            self.component, self.kind = message.component, message.kind
        return found
