"""An autopilot that speaks as PX4 1.15 and later does."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from bhm_service.mavlink.dialect import ENUM, unpack
from bhm_service.mavlink.frames import WireFrame
from sim import telemetry
from sim.firmware import Channel, Firmware
from sim.multirotor import State

_COMPANION_GONE_S = 3.0


class Px4(Firmware):
    """Streams by itself, shares the pack voltage out over its cells, echoes named values, watches its companion."""

    kind = ENUM.MAV_AUTOPILOT_PX4
    wind_id = ENUM.MAVLINK_MSG_ID_WIND_COV
    rates_hz: ClassVar = {
        ENUM.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        ENUM.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        ENUM.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
        ENUM.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
        ENUM.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
        ENUM.MAVLINK_MSG_ID_VFR_HUD: 4.0,
        ENUM.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    }

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        self.parameters = {
            "BAT1_CAPACITY": self.capacity_ah * 1000.0,
            "BAT1_N_CELLS": float(self.series),
            "MAV_SYS_ID": float(self.system),
        }
        self._value: tuple[bytes, float] | None = None
        self._companion_s: float | None = None

    def batteries(self, state: State) -> list[Any]:
        first, other = self.counted_ah(state)
        said = [self._battery(0, state.voltage_v, state.current_a, first)]
        if state.other is not None:
            said.append(self._battery(1, state.other.voltage_v, state.other.current_a, other))
        return said

    def _battery(self, number: int, volts: float, amps: float, counted_ah: float) -> Any:
        cells = [round(volts * 1000 / self.series)] * self.series
        used, left = round(counted_ah * 1000), self.left_percent(counted_ah)
        return telemetry.battery(number, cells, round(amps * 100), used, left, telemetry.UNKNOWN_C)

    def system_status(self, state: State) -> Any:
        first, other = self.counted_ah(state)
        left, volts, amps = self.left_percent(first), state.voltage_v, state.current_a
        if state.other is not None and self.left_percent(other) < left:
            left, volts, amps = self.left_percent(other), state.other.voltage_v, state.other.current_a
        return telemetry.system_status(volts, amps, left)

    def wind(self, state: State) -> Any:
        goes_to = math.radians(state.wind_from_deg + 180.0)
        north, east = state.wind_mps * math.cos(goes_to), state.wind_mps * math.sin(goes_to)
        return ENUM.MAVLink_wind_cov_message(
            round(state.time_s * 1e6), north, east, math.nan, math.nan, math.nan, 0.0, math.nan, math.nan
        )

    def hears(self, frame: WireFrame, now_s: float) -> None:
        if frame.message_id == ENUM.MAVLINK_MSG_ID_HEARTBEAT and frame.source[0] == self.system:
            self._companion_s = now_s
        elif frame.message_id == ENUM.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT:
            said = unpack(frame.message_id, frame.payload)
            self._value = (said["name"].split(b"\0")[0][:9], said["value"])  # the echo has no tenth character

    def send_due(self, channel: Channel, state: State) -> list[bytes]:
        if self._value is not None:
            name, value = self._value
            channel.answers.append(ENUM.MAVLink_named_value_float_message(self.boot_ms(state), name, value))
            self._value = None
        if self._companion_s is not None and state.time_s - self._companion_s > _COMPANION_GONE_S:
            self._companion_s = None
            text = b"Connection to mission computer lost"
            channel.answers.append(ENUM.MAVLink_statustext_message(ENUM.MAV_SEVERITY_CRITICAL, text))
        return super().send_due(channel, state)
