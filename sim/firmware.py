"""What every simulated autopilot does alike: streams on request per link, parameters, missions, reboots.

Built from the conventions of the real ones (`ardupilot.py`, `px4.py`), not from what the service expects.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from bhm_service.mavlink.dialect import ENUM, unpack
from bhm_service.mavlink.frames import WireFrame
from bhm_service.mavlink.signing import Signer
from sim import telemetry
from sim.multirotor import Phase, State

_BOOT_S = 3.0
_EPOCH_S = 1_790_000_000.0


@dataclass(slots=True)
class Channel:
    """One link of the autopilot: what is streamed on it, and whether its other end signs."""

    number: int
    mavlink: Any  # numbers the frames
    interval_s: dict[int, float]
    due_s: dict[int, float] = field(default_factory=dict)
    answers: list[Any] = field(default_factory=list)
    forwarded: list[bytes] = field(default_factory=list)
    spoken: bool = False  # somebody has transmitted here
    signs: bool = False


class Firmware(ABC):
    """One autopilot. Messages are pymavlink's; frames are bytes. ``now_s`` is the vehicle's time."""

    kind: ClassVar[int]  # MAV_AUTOPILOT
    wind_id: ClassVar[int]
    rates_hz: ClassVar[Mapping[int, float]]  # of a link that nobody has asked for anything
    streams: ClassVar[Mapping[int, tuple[int, ...]]] = {}  # of REQUEST_DATA_STREAM
    parameters: dict[str, float]

    def __init__(self, plan: Iterable[Phase], series: int, capacity_ah: float, system: int = 1) -> None:
        self.plan, self.series, self.capacity_ah, self.system = tuple(plan), series, capacity_ah, system
        self.signer: Signer | None = None
        self.epoch_s = _EPOCH_S  # Unix time at which the vehicle was switched on
        self.channels: list[Channel] = []
        self.hurry = 1.0  # factor on every rate: a flood
        self._booted_s = 0.0
        self._up_s = 0.0
        self._counted_from: tuple[float, float] = (0.0, 0.0)

    # ---- what differs between firmwares -------------------------------------------------------------------------

    @abstractmethod
    def batteries(self, state: State) -> list[Any]:
        """BATTERY_STATUS of one slot of its stream."""

    @abstractmethod
    def system_status(self, state: State) -> Any:
        """SYS_STATUS."""

    @abstractmethod
    def wind(self, state: State) -> Any:
        """The message that tells the wind, of id `wind_id`."""

    @abstractmethod
    def hears(self, frame: WireFrame, now_s: float) -> None:
        """Something that a companion said, beyond requests."""

    # ---- links -------------------------------------------------------------------------------------------------

    def channel(self) -> Channel:
        """A fresh link."""
        numbering = ENUM.MAVLink(None, srcSystem=self.system, srcComponent=ENUM.MAV_COMP_ID_AUTOPILOT1)
        made = Channel(len(self.channels), numbering, self._fresh_rates())
        self.channels.append(made)
        return made

    def _fresh_rates(self) -> dict[int, float]:
        return {message_id: 1.0 / hertz for message_id, hertz in self.rates_hz.items()}

    def reboot(self, state: State) -> None:
        """Silence for a while; then the clock, the counted charge and every rate start anew."""
        self._up_s = state.time_s + _BOOT_S
        self._booted_s = self._up_s
        self._counted_from = (state.consumed_ah, state.other.consumed_ah if state.other else 0.0)
        for channel in self.channels:
            channel.interval_s, channel.signs = self._fresh_rates(), False
            channel.mavlink.seq = 0
            channel.due_s.clear()
            channel.answers.clear()
            channel.forwarded.clear()
            channel.spoken = False

    def send_due(self, channel: Channel, state: State) -> list[bytes]:
        """Frames that this link is owed now: answers first, then its streams."""
        if state.time_s < self._up_s:
            return []
        messages, channel.answers = channel.answers, []
        forwarded, channel.forwarded = channel.forwarded, []
        for message_id, interval in list(channel.interval_s.items()):
            interval /= self.hurry
            due = channel.due_s.setdefault(message_id, state.time_s)
            while due <= state.time_s + 1e-6:
                messages += self.messages(message_id, state)
                due += interval
            channel.due_s[message_id] = due
        return forwarded + [self._frame(message, channel, state.time_s) for message in messages]

    def _frame(self, message: Any, channel: Channel, now_s: float) -> bytes:
        frame = bytes(message.pack(channel.mavlink))
        channel.mavlink.seq = (channel.mavlink.seq + 1) % 256
        if self.signer is not None and channel.signs:
            return self.signer.sign(frame, channel.number, self.epoch_s + now_s)
        return frame

    # ---- what is heard -----------------------------------------------------------------------------------------

    def take(self, channel: Channel, frame: WireFrame, now_s: float) -> None:
        """Answer one frame of a companion or a ground station."""
        ours = frame.source == (self.system, ENUM.MAV_COMP_ID_AUTOPILOT1)
        if now_s < self._up_s or ours or not self._admits(channel, frame, now_s):
            return
        self.hears(frame, now_s)
        channel.spoken = True
        asked = unpack(frame.message_id, frame.payload)
        if asked.get("target_system", 0) == 0:
            for other in self.channels:
                if other is not channel and other.spoken:
                    other.forwarded.append(frame.raw)
        answer = _ANSWERS.get(frame.message_id)
        if answer is not None and asked.get("target_system", self.system) in (0, self.system):
            channel.answers += answer(self, channel, asked, frame.source)

    def _admits(self, channel: Channel, frame: WireFrame, now_s: float) -> bool:
        if self.signer is None:
            return True
        signed = self.signer.check(frame.raw, frame.message_id, self.epoch_s + now_s) is None
        channel.signs = channel.signs or signed
        return signed

    def command(self, channel: Channel, asked: dict[str, Any], source: tuple[int, int]) -> list[Any]:
        """COMMAND_LONG: message intervals, and messages once."""
        result = ENUM.MAV_RESULT_UNSUPPORTED
        message_id = round(asked["param1"])
        if asked["command"] == ENUM.MAV_CMD_SET_MESSAGE_INTERVAL:
            result = self._set_interval(channel, message_id, asked["param2"])
        return [ENUM.MAVLink_command_ack_message(asked["command"], result, 0, 0, *source)]

    def _set_interval(self, channel: Channel, message_id: int, micros: float) -> int:
        if message_id not in self.known():
            return int(ENUM.MAV_RESULT_FAILED)
        if micros > 0.0:
            channel.interval_s[message_id] = micros / 1e6
        elif micros < 0.0:
            channel.interval_s.pop(message_id, None)
        channel.due_s.pop(message_id, None)
        return int(ENUM.MAV_RESULT_ACCEPTED)

    def stream(self, channel: Channel, asked: dict[str, Any], source: tuple[int, int]) -> list[Any]:
        """REQUEST_DATA_STREAM: a whole group at one rate, over what was set before."""
        everything = asked["req_stream_id"] == ENUM.MAV_DATA_STREAM_ALL
        groups = self.streams.values() if everything else [self.streams.get(asked["req_stream_id"], ())]
        for message_id in (one for group in groups for one in group):
            if asked["start_stop"] and asked["req_message_rate"] > 0:
                channel.interval_s[message_id] = 1.0 / asked["req_message_rate"]
            else:
                channel.interval_s.pop(message_id, None)
        return []

    def parameter(self, channel: Channel, asked: dict[str, Any], source: tuple[int, int]) -> list[Any]:
        """PARAM_REQUEST_READ by name; a parameter that is not there is not answered."""
        name = asked["param_id"].split(b"\0")[0].decode("ascii", "replace")
        return [self._parameter(name)] if name in self.parameters else []

    def all_parameters(self, channel: Channel, asked: dict[str, Any], source: tuple[int, int]) -> list[Any]:
        """PARAM_REQUEST_LIST."""
        return [self._parameter(name) for name in self.parameters]

    def _parameter(self, name: str) -> Any:
        names = list(self.parameters)
        return ENUM.MAVLink_param_value_message(
            name.encode("ascii"),
            self.parameters[name],
            ENUM.MAV_PARAM_TYPE_REAL32,
            len(names),
            names.index(name),
        )

    def mission_count(self, channel: Channel, asked: dict[str, Any], source: tuple[int, int]) -> list[Any]:
        """MISSION_REQUEST_LIST."""
        count = len(self.plan) if asked["mission_type"] == ENUM.MAV_MISSION_TYPE_MISSION else 0
        return [ENUM.MAVLink_mission_count_message(*source, count, asked["mission_type"])]

    def mission_item(self, channel: Channel, asked: dict[str, Any], source: tuple[int, int]) -> list[Any]:
        """MISSION_REQUEST_INT, and MISSION_REQUEST answered in the same way."""
        at = asked["seq"]
        if at >= len(self.plan):
            refused = ENUM.MAV_MISSION_INVALID_SEQUENCE
            return [ENUM.MAVLink_mission_ack_message(*source, refused, asked["mission_type"])]
        climbed = sum(max(phase.climb_mps, 0.0) * phase.seconds for phase in self.plan[: at + 1])
        flown = sum(phase.speed_mps * phase.seconds for phase in self.plan[: at + 1])
        phase, last = self.plan[at], at >= len(self.plan) - 2
        command = ENUM.MAV_CMD_NAV_WAYPOINT
        if phase.climb_mps > 0.0:
            command = ENUM.MAV_CMD_NAV_TAKEOFF
        elif last:
            command = ENUM.MAV_CMD_NAV_LAND
        place = telemetry.east_of_home(flown)
        hold = phase.seconds if phase.speed_mps == 0.0 and phase.power_w > 0.0 else 0.0
        frame = ENUM.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        item = (frame, command, 0, 1, hold, 0.0, 0.0, 0.0, *place, 0.0 if last else climbed)
        return [ENUM.MAVLink_mission_item_int_message(*source, at, *item, asked["mission_type"])]

    # ---- what is said ------------------------------------------------------------------------------------------

    def known(self) -> frozenset[int]:
        """Ids of the messages that it can stream."""
        return telemetry.STREAMED | {self.wind_id}

    def messages(self, message_id: int, state: State) -> list[Any]:
        """The messages of one stream at one time."""
        if message_id == self.wind_id:
            return [self.wind(state)]
        match message_id:
            case ENUM.MAVLINK_MSG_ID_BATTERY_STATUS:
                return self.batteries(state)
            case ENUM.MAVLINK_MSG_ID_SYS_STATUS:
                return [self.system_status(state)]
            case ENUM.MAVLINK_MSG_ID_HEARTBEAT:
                return [telemetry.heartbeat(self.kind, state)]
            case _:
                boot_ms, unix_s = self.boot_ms(state), self.epoch_s + state.time_s
                return [telemetry.BUILDERS[message_id](state, boot_ms, unix_s)]

    def boot_ms(self, state: State) -> int:
        """Its own clock."""
        return max(round((state.time_s - self._booted_s) * 1000.0), 0)

    def counted_ah(self, state: State) -> tuple[float, float]:
        """Charge counted since its boot, of both packs."""
        first, other = self._counted_from
        return state.consumed_ah - first, (state.other.consumed_ah if state.other else 0.0) - other

    def left_percent(self, counted_ah: float) -> int:
        """What it believes to be left: it assumes a full pack at boot."""
        return round(100.0 * min(max(1.0 - counted_ah / self.capacity_ah, 0.0), 1.0))


_ANSWERS = {
    ENUM.MAVLINK_MSG_ID_COMMAND_LONG: Firmware.command,
    ENUM.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: Firmware.stream,
    ENUM.MAVLINK_MSG_ID_PARAM_REQUEST_READ: Firmware.parameter,
    ENUM.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: Firmware.all_parameters,
    ENUM.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: Firmware.mission_count,
    ENUM.MAVLINK_MSG_ID_MISSION_REQUEST: Firmware.mission_item,
    ENUM.MAVLINK_MSG_ID_MISSION_REQUEST_INT: Firmware.mission_item,
}
