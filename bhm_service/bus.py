"""The software bus: one thread, typed messages, bounded pipes, an order that is the same every time (after cFE SB).

An app says what it hears and what it says, and returns messages from `on_message`. The bus puts each message into the
pipe of every app that hears its type; apps are served in the order of the wiring, the oldest message first, until all
pipes are empty. A full pipe drops its oldest message and counts it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from bhm_service.messages import Event, EventCode, Message

PIPE_DEPTH = 64


class App(Protocol):
    """A room of the service."""

    @property
    def name(self) -> str:
        """Name in housekeeping and events."""
        ...

    @property
    def hears(self) -> tuple[type, ...]:
        """Types of message that it wants."""
        ...

    @property
    def says(self) -> tuple[type, ...]:
        """Types of message that it may return."""
        ...

    def on_message(self, message: Message) -> Sequence[Message]:
        """Take one message in; the messages that follow from it."""
        ...


@dataclass(slots=True)
class Counters:
    """What housekeeping tells of one app."""

    heard: int = 0
    said: int = 0
    dropped: int = 0
    resets: int = 0
    worst_step_s: float | None = None
    crashes: int = 0
    down: bool = False


class Bus:
    """Delivers messages between apps.

    ``stopwatch`` returns seconds of some clock and is only used to time the apps; a replay has none, so that nothing
    in it depends on the machine.
    """

    def __init__(
        self,
        apps: Iterable[App],
        counters: dict[str, Counters] | None = None,
        stopwatch: Callable[[], float] | None = None,
        depth: int = PIPE_DEPTH,
    ) -> None:
        self.apps = tuple(apps)
        names = [app.name for app in self.apps]
        if len(set(names)) != len(names):
            raise ValueError(f"two apps have the same name: {names}")
        self.counters = counters if counters is not None else {}
        for name in names:
            self.counters.setdefault(name, Counters())
        self._stopwatch = stopwatch
        self._depth = depth
        self._pipes: dict[str, deque[Message]] = {name: deque() for name in names}
        self._hearers: dict[type, list[App]] = {}
        for app in self.apps:
            for kind in app.hears:
                self._hearers.setdefault(kind, []).append(app)

    def publish(self, message: Message, tell: Callable[[Message], object] | None = None) -> None:
        """Deliver a message from outside, and everything that follows from it; ``tell`` gets all of that."""
        self._deliver(message)
        busy = True
        while busy:
            busy = False
            for app in self.apps:
                pipe = self._pipes[app.name]
                while pipe:
                    busy = True
                    for answer in self._serve(app, pipe.popleft()):
                        self._deliver(answer)
                        if tell is not None:
                            tell(answer)

    def _serve(self, app: App, message: Message) -> Sequence[Message]:
        counters = self.counters[app.name]
        counters.heard += 1
        if self._stopwatch is None:
            answers = app.on_message(message)
        else:
            before = self._stopwatch()
            answers = app.on_message(message)
            counters.worst_step_s = max(counters.worst_step_s or 0.0, self._stopwatch() - before)
        counters.said += len(answers)
        for answer in answers:
            if type(answer) not in app.says:
                raise TypeError(f"app {app.name!r} said a {type(answer).__name__}, which it does not declare")
            if isinstance(answer, Event) and answer.code is EventCode.FILTER_RESTARTED:
                counters.resets += 1
        return answers

    def _deliver(self, message: Message) -> None:
        for app in self._hearers.get(type(message), ()):
            pipe = self._pipes[app.name]
            if len(pipe) == self._depth:
                pipe.popleft()
                self.counters[app.name].dropped += 1
            pipe.append(message)
