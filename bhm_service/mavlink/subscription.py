"""What an autopilot is asked to send, and asked again when it stops: rates are watched, never assumed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from bhm_service.mavlink.dialect import ENUM
from bhm_service.mavlink.encode import FrameEncoder
from bhm_service.messages import AutopilotKind

RATE_HZ = 1.0
_SILENT_S = 5.0  # nothing at all for so long: the request was lost, or its effect
_WINDOW_S = 10.0  # over which a rate is judged
_ENOUGH = 0.5  # of the rate that was asked for: loss on the way is no reason to ask again
_PATIENCE_S = 60.0  # longest time between two requests for what never comes

_COMMON = (
    ENUM.MAVLINK_MSG_ID_BATTERY_STATUS,
    ENUM.MAVLINK_MSG_ID_SYS_STATUS,
    ENUM.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    ENUM.MAVLINK_MSG_ID_VFR_HUD,
    ENUM.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    ENUM.MAVLINK_MSG_ID_SCALED_PRESSURE,
    ENUM.MAVLINK_MSG_ID_SYSTEM_TIME,
)
_WIND = {AutopilotKind.PX4: ENUM.MAVLINK_MSG_ID_WIND_COV}
# Streams that carry what nothing works without, for autopilots that know no SET_MESSAGE_INTERVAL.
_FALLBACK = {
    ENUM.MAVLINK_MSG_ID_BATTERY_STATUS: ENUM.MAV_DATA_STREAM_EXTRA3,
    ENUM.MAVLINK_MSG_ID_SYS_STATUS: ENUM.MAV_DATA_STREAM_EXTENDED_STATUS,
}
_FALLBACK_AFTER = 2  # requests in vain


def wanted_of(kind: AutopilotKind) -> tuple[int, ...]:
    """Message ids that an autopilot of this kind is asked for."""
    return (*_COMMON, _WIND.get(kind, ENUM.MAVLINK_MSG_ID_WIND))


@dataclass(slots=True)
class _Watch:
    heard: int = 0
    since_s: float = 0.0  # of the window that is counted, or of the last request
    asked: int = 0  # in vain
    wait_s: float = 0.0


@dataclass(slots=True)
class Subscription:
    """The messages that one link is asked for, each with its own patience; has no clock of its own."""

    requests: int = 0
    _watches: dict[int, _Watch] = field(default_factory=dict)

    def start(self, kind: AutopilotKind, now_s: float) -> None:
        """An autopilot appeared or booted: everything is asked for at the next `due`."""
        self._watches = {wanted: _Watch(since_s=now_s) for wanted in wanted_of(kind)}

    def heard(self, message_id: int) -> None:
        """One of the messages came."""
        watch = self._watches.get(message_id)
        if watch is not None:
            watch.heard += 1

    def due(self, now_s: float) -> list[int]:
        """Ids of what has to be asked for now: it comes too rarely, and was not asked for a while."""
        late: list[int] = []
        for message_id, watch in self._watches.items():
            span = now_s - watch.since_s
            asked_before = watch.wait_s > 0.0
            if asked_before and (span < watch.wait_s or (watch.heard > 0 and span < _WINDOW_S)):
                continue
            if asked_before and watch.heard >= _ENOUGH * RATE_HZ * span:
                watch.asked, watch.wait_s = 0, _SILENT_S
            else:
                late.append(message_id)
                watch.asked += 1
                watch.wait_s = min(_SILENT_S * 2.0 ** (watch.asked - 1), _PATIENCE_S)
            watch.heard, watch.since_s = 0, now_s
        return late

    def frames(self, encoder: FrameEncoder, target: tuple[int, int], now_s: float) -> Iterable[bytes]:
        """Requests that are due, to the autopilot ``target`` (system, component)."""
        for message_id in self.due(now_s):
            self.requests += 1
            yield encoder.request_interval(*target, message_id, RATE_HZ)
            stream = _FALLBACK.get(message_id)
            if stream is not None and self._watches[message_id].asked > _FALLBACK_AFTER:
                yield encoder.request_stream(*target, stream, round(RATE_HZ))
