"""A recording as a telemetry log of an ArduCopter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bhm_service.mavlink.dialect import ENUM
from bhm_service.mavlink.encode import stamped
from sim.concealed.sensors import Recording

_EPOCH_S = 1_760_000_000.0
_PLACE = (473977000, 85456000)  # [1e-7 deg]
_UNKNOWN_MV, _UNKNOWN_C = 65535, 32767


class _Writer:
    def __init__(self) -> None:
        self.out = bytearray()
        self._mavlink: Any = ENUM.MAVLink(None, srcSystem=1, srcComponent=ENUM.MAV_COMP_ID_AUTOPILOT1)

    def write(self, time_s: float, message: Any) -> None:
        self.out += stamped(_EPOCH_S + time_s, bytes(message.pack(self._mavlink)))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256


def _battery(recording: Recording, k: int, millivolts: int, centiamperes: int) -> Any:
    if recording.cells_v is None:
        slots = [millivolts] + [_UNKNOWN_MV] * 9
    else:
        cells = np.round(recording.cells_v[k] * 1000.0).astype(int).tolist()
        slots = cells + [_UNKNOWN_MV] * (10 - len(cells))
    warm = _UNKNOWN_C if recording.temperature_c is None else round(float(recording.temperature_c[k]) * 100)
    return ENUM.MAVLink_battery_status_message(
        0,
        ENUM.MAV_BATTERY_FUNCTION_ALL,
        ENUM.MAV_BATTERY_TYPE_LIPO,
        warm,
        slots,
        centiamperes,
        round(float(recording.used_ah[k]) * 1000),
        -1,
        -1,
    )


def tlog(recording: Recording, day: int) -> bytes:
    """The log's bytes; ``day`` sets flights apart."""
    writer, r = _Writer(), recording
    pressure_hpa = 1013.25 * np.exp(-9.80665 * 0.0289644 * (r.field_m + r.height_m) / (8.314462618 * 283.0))
    base = ENUM.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    for k in np.flatnonzero(r.kept).tolist():
        at, boot_ms = float(r.time_s[k]) + 86400.0 * day, round(float(r.boot_s[k]) * 1000)
        armed, flying = bool(r.armed[k]), bool(r.airborne[k])
        millivolts = round(float(r.voltage_v[k]) * 1000)
        centiamperes = max(min(round(float(r.current_a[k]) * 100), 32765), -32765)
        centiamperes = 0 if centiamperes == -1 else centiamperes  # the wire's word for unknown
        ground, climb = float(r.ground_mps[k]), float(r.climb_mps[k])
        height = float(r.height_m[k])
        state = ENUM.MAV_STATE_ACTIVE if armed else ENUM.MAV_STATE_STANDBY
        mode = base | (ENUM.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
        landed = ENUM.MAV_LANDED_STATE_IN_AIR if flying else ENUM.MAV_LANDED_STATE_ON_GROUND
        writer.write(
            at,
            ENUM.MAVLink_heartbeat_message(
                ENUM.MAV_TYPE_QUADROTOR, ENUM.MAV_AUTOPILOT_ARDUPILOTMEGA, mode, 5, state, 3
            ),
        )
        if k % 5 == 0:
            unix_us = round((_EPOCH_S + 86400.0 * day + boot_ms / 1000.0) * 1e6)
            writer.write(at, ENUM.MAVLink_system_time_message(unix_us, boot_ms))
            writer.write(at, ENUM.MAVLink_wind_message(270.0, r.wind_mps, 0.0))
        writer.write(at, ENUM.MAVLink_sys_status_message(0, 0, 0, 300, millivolts, centiamperes, -1, 0, 0, 0, 0, 0, 0))
        writer.write(at, _battery(r, k, millivolts, centiamperes))
        writer.write(at, ENUM.MAVLink_extended_sys_state_message(0, landed))
        writer.write(
            at,
            ENUM.MAVLink_global_position_int_message(
                boot_ms,
                *_PLACE,
                round((r.field_m + height) * 1000),
                round(height * 1000),
                round(ground * 100),
                0,
                -round(climb * 100),
                9000,
            ),
        )
        throttle = math.ceil(float(r.throttle[k]) * 100)
        writer.write(
            at,
            ENUM.MAVLink_vfr_hud_message(float(r.air_mps[k]), ground, 90, throttle, r.field_m + height, climb),
        )
        writer.write(
            at,
            ENUM.MAVLink_scaled_pressure_message(
                boot_ms, float(pressure_hpa[k]), 0.0, round(float(r.board_c[k]) * 100)
            ),
        )
    return bytes(writer.out)
