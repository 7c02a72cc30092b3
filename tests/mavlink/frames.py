"""Frames and tlogs for tests, made by pymavlink itself."""

from __future__ import annotations

import os

os.environ.setdefault("MAVLINK20", "1")
from pymavlink.dialects.v20 import ardupilotmega as mav

UNKNOWN = 65535
EPOCH_US = 1_700_000_000_000_000


class Sender:
    """Packs messages of one system and component."""

    def __init__(self, system=1, component=1, v1=False):
        self.mav = mav.MAVLink(None, srcSystem=system, srcComponent=component)
        self.v1 = v1

    def __call__(self, message):
        frame = bytes(message.pack(self.mav, force_mavlink1=self.v1))
        self.mav.seq = (self.mav.seq + 1) % 256
        return frame


def heartbeat(autopilot=mav.MAV_AUTOPILOT_ARDUPILOTMEGA, armed=False, kind=mav.MAV_TYPE_QUADROTOR):
    return mav.MAVLink_heartbeat_message(
        kind, autopilot, mav.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0, 0, mav.MAV_STATE_ACTIVE, 3
    )


def battery_status(
    voltages=(16000,), current=1200, temperature=32767, battery_id=0, consumed=-1, remaining=-1, ext=(0, 0, 0, 0)
):
    slots = list(voltages) + [UNKNOWN] * (10 - len(voltages))
    return mav.MAVLink_battery_status_message(
        battery_id, 0, 1, temperature, slots, current, consumed, -1, remaining, 0, 0, list(ext), 0, 0
    )


def sys_status(millivolts=16000, current=1200, remaining=-1):
    return mav.MAVLink_sys_status_message(0, 0, 0, 300, millivolts, current, remaining, 0, 0, 0, 0, 0, 0)


def system_time(boot_ms, unix_us=0):
    return mav.MAVLink_system_time_message(unix_us, boot_ms)


def stamped(frame, seconds, link=0):
    return ((EPOCH_US + round(seconds * 1e6)) // 4 * 4 | link).to_bytes(8, "big") + frame


def tlog(messages, sender=None):
    """A tlog of (seconds, message) pairs."""
    send = sender or Sender()
    return b"".join(stamped(send(message), seconds) for seconds, message in messages)
