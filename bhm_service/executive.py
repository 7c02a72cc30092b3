"""The executive: an app that raises is started again from what it last remembered, and costs the others nothing."""

from __future__ import annotations

import copy
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from bhm_service.bus import App, Counters
from bhm_service.codec import NotThisKindError, packed, unpacked
from bhm_service.messages import Event, EventCode, Message, Severity, StatusText, Tick

_TWICE_WITHIN_S = 60.0


@runtime_checkable
class Remembering(Protocol):
    """An app that remembers something from one message to the next."""

    keeps: type

    def state(self) -> Any:
        """What it remembers: a ``keeps``."""
        ...

    def restore(self, state: Any) -> None:
        """Go on from a ``keeps``."""
        ...


class Supervised:
    """One app behind an `except Exception`, which stands nowhere else in the service.

    A copy of what the app remembers is taken at every Tick. When the app raises, the message is dropped, a new app is
    made and given that copy; when it raises again within a minute it stays down and is not served any more.
    """

    def __init__(self, make: Callable[[], App], counters: Counters) -> None:
        self._make = make
        self._app = make()
        self._counters = counters
        self._memory: Any = None
        self._crashed_s: float | None = None
        self.name = self._app.name
        self.hears = tuple(dict.fromkeys((*self._app.hears, Tick)))
        self.says = tuple(dict.fromkeys((*self._app.says, Event, StatusText)))

    def on_message(self, message: Message) -> Sequence[Message]:
        if self._counters.down:
            return []
        try:
            if isinstance(message, Tick):
                if isinstance(self._app, Remembering):
                    self._memory = copy.deepcopy(self._app.state())
                if Tick not in self._app.hears:
                    return []
            return self._app.on_message(message)
        except Exception as why:
            return self._fault(message, why)

    def state(self) -> Any:
        """What the app remembers now, as JSON can hold it; None for an app that remembers nothing or is down."""
        if self._counters.down or not isinstance(self._app, Remembering):
            return None
        return packed(self._app.state())

    def read(self, data: Any) -> Any:
        """What `state` gave, for `restore`. Raises NotThisKindError for anything else."""
        if data is None or not isinstance(self._app, Remembering):
            return None
        return unpacked(self._app.keeps, data)

    def restore(self, state: Any) -> None:
        """Go on from what `read` gave."""
        if state is not None and isinstance(self._app, Remembering):
            self._memory = copy.deepcopy(state)
            self._app.restore(state)

    def _fault(self, message: Message, why: Exception) -> list[Message]:
        now = message.time_s
        again = self._crashed_s is not None and 0.0 <= now - self._crashed_s < _TWICE_WITHIN_S
        self._crashed_s = now
        self._counters.crashes += 1
        what = f"{_place(why)}, on a {type(message).__name__}"
        if again:
            return self._stay_down(now, f"failed twice within a minute and stays down: {what}")
        try:
            self._app = self._make()
            self.restore(self._memory)
        except Exception as worse:
            return self._stay_down(now, f"failed and cannot be started again: {what}; then {_place(worse)}")
        return [self._event(now, EventCode.APP_RESTARTED, Severity.WARNING, f"failed and was started again: {what}")]

    def _stay_down(self, now: float, what: str) -> list[Message]:
        self._counters.down = True
        text = f"Battery service: {self.name} is down"
        return [
            self._event(now, EventCode.APP_DOWN, Severity.CRITICAL, what),
            StatusText(time_s=now, severity=Severity.WARNING, text=text),
        ]

    def _event(self, now: float, code: EventCode, severity: Severity, what: str) -> Event:
        return Event(time_s=now, app=self.name, code=code, severity=severity, text=f"{self.name} {what}")


def _place(why: Exception) -> str:
    frames = traceback.extract_tb(why.__traceback__)
    where = f" in {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    return f"{type(why).__name__}: {why}{where}"


def states(apps: Iterable[App]) -> dict[str, Any]:
    """What every app remembers, by name."""
    return {app.name: app.state() for app in apps if isinstance(app, Supervised)}


def restore(apps: Iterable[App], remembered: Mapping[str, Any]) -> None:
    """Give every app what it remembered: all of them, or with NotThisKindError none."""
    ready: list[tuple[Supervised, Any]] = []
    for app in apps:
        if isinstance(app, Supervised):
            try:
                ready.append((app, app.read(remembered.get(app.name))))
            except NotThisKindError as why:
                raise NotThisKindError(f"{app.name}: {why}") from None
    for app, state in ready:
        app.restore(state)


def reader_state(remembered: Mapping[str, Any]) -> Any:
    """What the reader remembers, also that of the old physics where two chains fly."""
    duel = remembered.get("duel")
    return (remembered if duel is None else duel["old"]).get("reader")


def is_airborne(remembered: Mapping[str, Any]) -> bool:
    """Whether the vehicle flies, as far as the reader knows."""
    reader = reader_state(remembered)
    return reader is not None and bool(reader["phases"]["airborne"])
