"""Time of a log's messages, when the clock that stamped them jumps.

A tlog is stamped by the receiver's wall clock, which may be set while it records. The autopilot's own clock goes on
undisturbed, so where the two disagree about how much time passed the stamps are moved until they agree. A pause in the
log, or an autopilot that rebooted, is not a jump.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TypeVar

from bhm_service.messages import AutopilotClock, Message

_BACKWARD_S = 0.5  # stamps may swap places by this much without anybody having set a clock
_FORWARD_S = 5.0  # a longer silence is looked at before it is believed
_DISAGREE_S = 2.0
_WAIT_MESSAGES = 400  # for the autopilot's clock after a suspicious stamp

Tag = TypeVar("Tag")


@dataclass(slots=True)
class SteadyClock:
    """Moves the times of messages so that they follow the autopilot's clock across jumps of the receiver's."""

    jumps: list[tuple[float, float]] = field(default_factory=list)  # (time of the message, seconds taken out)
    _shift_s: float = 0.0
    _last_s: float | None = None  # as stamped
    _clock: tuple[float, float] | None = None  # stamp and boot time of the last AutopilotClock

    def steady(self, messages: Iterable[tuple[Tag, Message]]) -> Iterator[tuple[Tag, Message]]:
        """The same messages with times that do not jump. ``Tag`` passes through."""
        waiting: list[tuple[Tag, Message]] = []
        for tag, message in messages:
            stamp = message.time_s
            suspicious = self._last_s is not None and not (-_BACKWARD_S <= stamp - self._last_s <= _FORWARD_S)
            self._last_s = stamp
            if suspicious or waiting:
                waiting.append((tag, message))
                if isinstance(message, AutopilotClock) or len(waiting) >= _WAIT_MESSAGES:
                    yield from self._settle(waiting)
                    waiting = []
                continue
            if isinstance(message, AutopilotClock):
                self._clock = (stamp, message.boot_s)
            yield tag, self._shifted(message)
        yield from self._settle(waiting)

    def _settle(self, waiting: list[tuple[Tag, Message]]) -> Iterator[tuple[Tag, Message]]:
        if not waiting:
            return
        last = waiting[-1][1]
        if isinstance(last, AutopilotClock):
            if self._clock is not None:
                by_stamp, by_boot = last.time_s - self._clock[0], last.boot_s - self._clock[1]
                if by_boot >= 0.0 and abs(by_stamp - by_boot) > _DISAGREE_S:
                    self._jump(waiting[0][1].time_s, by_stamp - by_boot)
            self._clock = (last.time_s, last.boot_s)
        elif self._clock is not None and waiting[0][1].time_s < self._clock[0]:
            # The stamps went back and no other clock says by how much: go on from where they were.
            self._jump(waiting[0][1].time_s, waiting[0][1].time_s - self._clock[0])
            self._clock = None
        for tag, message in waiting:
            yield tag, self._shifted(message)

    def _jump(self, at_s: float, by_s: float) -> None:
        self._shift_s -= by_s
        self.jumps.append((at_s, by_s))

    def _shifted(self, message: Message) -> Message:
        return message if self._shift_s == 0.0 else replace(message, time_s=message.time_s + self._shift_s)
