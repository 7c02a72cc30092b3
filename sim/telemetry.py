"""Messages of an autopilot about a state of its vehicle, as both firmwares send them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bhm_service.mavlink.dialect import ENUM
from sim.multirotor import State

UNKNOWN_MV = 65535
UNKNOWN_C = 32767
_HOME = (473977000, 85456000)  # [1e-7 deg]
_HOME_ALTITUDE_M = 400.0


def battery(
    battery: int, slots: list[int], centiamperes: int, milliamperehours: int, percent: int, centicelsius: int
) -> Any:
    """BATTERY_STATUS of a LiPo."""
    return ENUM.MAVLink_battery_status_message(
        battery,
        ENUM.MAV_BATTERY_FUNCTION_ALL,
        ENUM.MAV_BATTERY_TYPE_LIPO,
        centicelsius,
        slots + [UNKNOWN_MV] * (10 - len(slots)),
        centiamperes,
        milliamperehours,
        -1,
        percent,
    )


def system_status(volts: float, amps: float, percent: int) -> Any:
    """SYS_STATUS."""
    return ENUM.MAVLink_sys_status_message(
        0, 0, 0, 300, round(volts * 1000), round(amps * 100), percent, 0, 0, 0, 0, 0, 0
    )


def east_of_home(metres: float) -> tuple[int, int]:
    """Latitude and longitude. [1e-7 deg]"""
    return _HOME[0], _HOME[1] + round(metres / 111_320.0 / 0.676 * 1e7)  # at 47.4 degrees north


def heartbeat(kind: int, state: State) -> Any:
    """HEARTBEAT of a quadrotor, ``kind`` a MAV_AUTOPILOT."""
    mode = ENUM.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (ENUM.MAV_MODE_FLAG_SAFETY_ARMED if state.armed else 0)
    status = ENUM.MAV_STATE_ACTIVE if state.armed else ENUM.MAV_STATE_STANDBY
    return ENUM.MAVLink_heartbeat_message(ENUM.MAV_TYPE_QUADROTOR, kind, mode, 5, status, 3)


def _time(state: State, boot_ms: int, unix_s: float) -> Any:
    return ENUM.MAVLink_system_time_message(round(unix_s * 1e6), boot_ms)


def _landed(state: State, boot_ms: int, unix_s: float) -> Any:
    landed = ENUM.MAV_LANDED_STATE_ON_GROUND
    if state.airborne:
        landed = ENUM.MAV_LANDED_STATE_IN_AIR
        if state.climb_mps and state.height_m < 5.0:
            landed = ENUM.MAV_LANDED_STATE_TAKEOFF if state.climb_mps > 0 else ENUM.MAV_LANDED_STATE_LANDING
    return ENUM.MAVLink_extended_sys_state_message(0, landed)


def _position(state: State, boot_ms: int, unix_s: float) -> Any:
    altitude, height = round((_HOME_ALTITUDE_M + state.height_m) * 1000), round(state.height_m * 1000)
    speed, down = round(state.speed_mps * 100), -round(state.climb_mps * 100)
    place = east_of_home(state.distance_m)
    return ENUM.MAVLink_global_position_int_message(boot_ms, *place, altitude, height, 0, speed, down, 9000)


def _hud(state: State, boot_ms: int, unix_s: float) -> Any:
    throttle, altitude = (45 if state.airborne else 0), _HOME_ALTITUDE_M + state.height_m
    return ENUM.MAVLink_vfr_hud_message(state.speed_mps, state.speed_mps, 90, throttle, altitude, state.climb_mps)


def _pressure(state: State, boot_ms: int, unix_s: float) -> Any:
    hectopascal = 1013.25 * (1.0 - 2.25577e-5 * (_HOME_ALTITUDE_M + state.height_m)) ** 5.25588
    return ENUM.MAVLink_scaled_pressure_message(boot_ms, hectopascal, 0.0, 3800)


def _item(state: State, boot_ms: int, unix_s: float) -> Any:
    return ENUM.MAVLink_mission_current_message(state.item)


BUILDERS: dict[int, Callable[[State, int, float], Any]] = {  # of a state, boot time [ms] and Unix time [s]
    ENUM.MAVLINK_MSG_ID_SYSTEM_TIME: _time,
    ENUM.MAVLINK_MSG_ID_SCALED_PRESSURE: _pressure,
    ENUM.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _position,
    ENUM.MAVLINK_MSG_ID_MISSION_CURRENT: _item,
    ENUM.MAVLINK_MSG_ID_VFR_HUD: _hud,
    ENUM.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _landed,
}
STREAMED = frozenset(BUILDERS) | {
    ENUM.MAVLINK_MSG_ID_HEARTBEAT,
    ENUM.MAVLINK_MSG_ID_SYS_STATUS,
    ENUM.MAVLINK_MSG_ID_BATTERY_STATUS,
}
