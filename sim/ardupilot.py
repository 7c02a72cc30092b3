"""An autopilot that speaks as ArduCopter 4.x does."""

from __future__ import annotations

from typing import Any, ClassVar

from bhm_service.mavlink.dialect import ENUM
from bhm_service.mavlink.frames import WireFrame
from sim import telemetry
from sim.firmware import Firmware
from sim.multirotor import State

_MOST_CA = 32767


class ArduPilot(Firmware):
    """A fresh link carries heartbeats only; two batteries take turns in the one slot of BATTERY_STATUS."""

    kind = ENUM.MAV_AUTOPILOT_ARDUPILOTMEGA
    rates_hz: ClassVar = {ENUM.MAVLINK_MSG_ID_HEARTBEAT: 1.0}
    wind_id = ENUM.MAVLINK_MSG_ID_WIND
    streams: ClassVar = {
        ENUM.MAV_DATA_STREAM_EXTENDED_STATUS: (
            ENUM.MAVLINK_MSG_ID_SYS_STATUS,
            ENUM.MAVLINK_MSG_ID_MISSION_CURRENT,
        ),
        ENUM.MAV_DATA_STREAM_POSITION: (ENUM.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,),
        ENUM.MAV_DATA_STREAM_EXTRA2: (ENUM.MAVLINK_MSG_ID_VFR_HUD,),
        ENUM.MAV_DATA_STREAM_EXTRA3: (
            ENUM.MAVLINK_MSG_ID_SYSTEM_TIME,
            ENUM.MAVLINK_MSG_ID_WIND,
            ENUM.MAVLINK_MSG_ID_BATTERY_STATUS,
        ),
        ENUM.MAV_DATA_STREAM_RAW_SENSORS: (ENUM.MAVLINK_MSG_ID_SCALED_PRESSURE,),
    }

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        self.parameters = {
            "BATT_MONITOR": 4.0,
            "BATT_CAPACITY": self.capacity_ah * 1000.0,
            "BATT_OPTIONS": 0.0,
            "BATT2_OPTIONS": 0.0,
            "SYSID_THISMAV": float(self.system),
        }
        self._turn = 0

    def batteries(self, state: State) -> list[Any]:
        first, other = self.counted_ah(state)
        self._turn += 1
        if state.other is not None and self._turn % 2 == 0:
            return [self._battery(1, state.other.voltage_v, state.other.current_a, other)]
        return [self._battery(0, state.voltage_v, state.current_a, first)]

    def _battery(self, number: int, volts: float, amps: float, counted_ah: float) -> Any:
        centiamperes = min(round(amps * 100), _MOST_CA)
        used, left = round(counted_ah * 1000), self.left_percent(counted_ah)
        return telemetry.battery(number, [round(volts * 1000)], centiamperes, used, left, telemetry.UNKNOWN_C)

    def system_status(self, state: State) -> Any:
        return telemetry.system_status(state.voltage_v, state.current_a, self.left_percent(self.counted_ah(state)[0]))

    def hears(self, frame: WireFrame, now_s: float) -> None:
        return  # it forwards what others say, and makes nothing of it

    def wind(self, state: State) -> Any:
        return ENUM.MAVLink_wind_message(state.wind_from_deg, state.wind_mps, 0.0)
