"""What an ArduPilot-like autopilot sends of a state: real MAVLink frames."""

from __future__ import annotations

from typing import Any

from bhm_service.mavlink.dialect import ENUM
from sim.multirotor import State

_UNKNOWN = 65535
_PLACE = (473977000, 85456000)  # [1e-7 deg]


class Autopilot:
    """Encodes states as the messages of one vehicle."""

    def __init__(self, system: int = 1, temperature_c: float | None = None) -> None:
        self._mavlink: Any = ENUM.MAVLink(None, srcSystem=system, srcComponent=ENUM.MAV_COMP_ID_AUTOPILOT1)
        self._temperature_c = temperature_c

    def frames(self, state: State) -> list[bytes]:
        """One second's frames."""
        boot_ms = int(state.time_s * 1000)
        mode = ENUM.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (ENUM.MAV_MODE_FLAG_SAFETY_ARMED if state.armed else 0)
        millivolts, centiamperes = round(state.voltage_v * 1000), round(state.current_a * 100)
        landed = ENUM.MAV_LANDED_STATE_IN_AIR if state.airborne else ENUM.MAV_LANDED_STATE_ON_GROUND
        lat, lon = _PLACE
        speed, climb = round(state.speed_mps * 100), round(state.climb_mps * 100)
        messages = [
            ENUM.MAVLink_heartbeat_message(
                ENUM.MAV_TYPE_QUADROTOR, ENUM.MAV_AUTOPILOT_ARDUPILOTMEGA, mode, 5, ENUM.MAV_STATE_ACTIVE, 3
            ),
            ENUM.MAVLink_system_time_message(0, boot_ms),
            ENUM.MAVLink_sys_status_message(0, 0, 0, 300, millivolts, centiamperes, -1, 0, 0, 0, 0, 0, 0),
            ENUM.MAVLink_battery_status_message(
                0,
                ENUM.MAV_BATTERY_FUNCTION_ALL,
                ENUM.MAV_BATTERY_TYPE_LIPO,
                32767 if self._temperature_c is None else round(self._temperature_c * 100),
                [millivolts] + [_UNKNOWN] * 9,
                centiamperes,
                round(state.consumed_ah * 1000),
                -1,
                -1,
            ),
            ENUM.MAVLink_extended_sys_state_message(0, landed),
            ENUM.MAVLink_global_position_int_message(
                boot_ms, lat, lon, 400000, round(state.height_m * 1000), speed, 0, -climb, 9000
            ),
            ENUM.MAVLink_vfr_hud_message(
                state.speed_mps, state.speed_mps, 90, 45 if state.airborne else 0, state.height_m, state.climb_mps
            ),
        ]
        frames = []
        for message in messages:
            frames.append(bytes(message.pack(self._mavlink)))
            self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frames
