"""Messages to MAVLink frames, byte for byte the same every time."""

from __future__ import annotations

import math
from typing import Any

from bhm_service.mavlink.dialect import ENUM
from bhm_service.messages import BatteryStatus, Heartbeat, Message, NamedValue, StatusText
from bhm_service.units import celsius

COMPONENT = ENUM.MAV_COMP_ID_ONBOARD_COMPUTER
_NAME_LENGTH = 9  # PX4's echo cuts the tenth
_FLOAT_MAX = 3.4e38
_TEXT_LENGTH = 50
_UINT16_MAX = 65535
_INT16_MAX = 32767


class FrameEncoder:
    """Frames from one system and component, numbered in sequence."""

    def __init__(self, system: int, component: int = COMPONENT) -> None:
        self.system, self.component = system, component
        self._mavlink: Any = ENUM.MAVLink(None, srcSystem=system, srcComponent=component)

    @property
    def sequence(self) -> int:
        """Number of the next frame, 0 to 255."""
        return int(self._mavlink.seq)

    @sequence.setter
    def sequence(self, number: int) -> None:
        self._mavlink.seq = number % 256

    def _pack(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._mavlink))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frame

    def frames(self, message: Message) -> list[bytes]:
        """Frames of what the apps say to the ground; none for what they say to each other."""
        if isinstance(message, NamedValue):
            return [self.named_value(message)]
        return self.status_text(message) if isinstance(message, StatusText) else []

    def named_value(self, value: NamedValue) -> bytes:
        """NAMED_VALUE_FLOAT. Raises ValueError for a name or a number that the wire cannot carry."""
        if not 0 < len(value.name) <= _NAME_LENGTH:
            raise ValueError(f"name {value.name!r}: 1 to {_NAME_LENGTH} characters reach every ground station")
        if not (math.isfinite(value.value) and abs(value.value) < _FLOAT_MAX):
            raise ValueError(f"{value.name} = {value.value}: only finite numbers are sent")
        return self._pack(
            ENUM.MAVLink_named_value_float_message(value.boot_ms, value.name.encode("ascii"), value.value)
        )

    def status_text(self, said: StatusText) -> list[bytes]:
        """STATUSTEXT in chunks of 50 characters; what is not ASCII becomes a question mark."""
        text = said.text.encode("ascii", "replace")
        chunks = [text[at : at + _TEXT_LENGTH] for at in range(0, max(len(text), 1), _TEXT_LENGTH)]
        # Chunks of one text share an id that is not 0; frames are numbered, so texts in a row have different ones.
        one = 0 if len(chunks) == 1 else self._mavlink.seq % 255 + 1
        return [
            self._pack(ENUM.MAVLink_statustext_message(said.severity.value, chunk, one, k))
            for k, chunk in enumerate(chunks)
        ]

    def companion_heartbeat(self) -> bytes:
        """What an onboard computer says once a second."""
        return self._pack(
            ENUM.MAVLink_heartbeat_message(
                ENUM.MAV_TYPE_ONBOARD_CONTROLLER,
                ENUM.MAV_AUTOPILOT_INVALID,
                0,
                0,
                ENUM.MAV_STATE_ACTIVE,
                3,
            )
        )

    def request_interval(self, system: int, component: int, message_id: int, hertz: float) -> bytes:
        """Ask an autopilot for a message so many times a second (MAV_CMD_SET_MESSAGE_INTERVAL)."""
        return self._pack(
            ENUM.MAVLink_command_long_message(
                system, component, ENUM.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, 1e6 / hertz, 0, 0, 0, 0, 0
            )
        )

    def request_stream(self, system: int, component: int, stream: int, hertz: int) -> bytes:
        """Ask for a group of messages in the old way (REQUEST_DATA_STREAM)."""
        return self._pack(ENUM.MAVLink_request_data_stream_message(system, component, stream, hertz, 1))

    def request_parameter(self, system: int, component: int, name: str) -> bytes:
        """Ask an autopilot for one of its settings (PARAM_REQUEST_READ)."""
        return self._pack(ENUM.MAVLink_param_request_read_message(system, component, name.encode("ascii"), -1))

    # ---- an autopilot's messages, for logs that hold none -------------------------------------------------------

    def autopilot_heartbeat(self, heartbeat: Heartbeat) -> bytes:
        """The heartbeat of a generic multirotor's autopilot."""
        mode = ENUM.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if heartbeat.armed:
            mode |= ENUM.MAV_MODE_FLAG_SAFETY_ARMED
        return self._pack(
            ENUM.MAVLink_heartbeat_message(
                ENUM.MAV_TYPE_QUADROTOR, ENUM.MAV_AUTOPILOT_GENERIC, mode, 0, ENUM.MAV_STATE_ACTIVE, 3
            )
        )

    def battery_status(self, status: BatteryStatus) -> bytes:
        """BATTERY_STATUS with the pack voltage in the first slots."""
        millivolts = None if status.voltage_v is None else round(status.voltage_v * 1000.0)
        slots = [_UINT16_MAX] * 10
        for index in range(10):
            if millivolts is None:
                break
            slots[index] = min(millivolts, _UINT16_MAX - 1)
            millivolts = millivolts - slots[index] or None
        current = -1 if status.current_a is None else round(status.current_a * 100.0)
        temperature = _INT16_MAX if status.temperature_k is None else round(celsius(status.temperature_k) * 100.0)
        return self._pack(
            ENUM.MAVLink_battery_status_message(
                status.battery_id,
                ENUM.MAV_BATTERY_FUNCTION_ALL,
                ENUM.MAV_BATTERY_TYPE_LIPO,
                temperature,
                slots,
                min(max(current, -_INT16_MAX), _INT16_MAX),
                -1 if status.consumed_c is None else round(status.consumed_c / 3.6),
                -1,
                -1 if status.remaining is None else round(status.remaining * 100.0),
            )
        )


def stamped(time_s: float, frame: bytes) -> bytes:
    """A frame with the eight bytes that go before it in a tlog."""
    return max(round(time_s * 1e6), 0).to_bytes(8, "big") + frame
