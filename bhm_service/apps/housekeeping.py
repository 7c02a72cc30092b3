"""Housekeeping: once a second, how every app is doing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bhm_service.bus import Counters
from bhm_service.messages import Housekeeping, Message, Tick


class HousekeepingApp:
    """Tells the bus's own counters."""

    name = "housekeeping"
    hears = (Tick,)
    says = (Housekeeping,)

    def __init__(self, counters: Mapping[str, Counters], period_s: float = 1.0) -> None:
        self._counters = counters
        self._period_s = period_s
        self._last_s: float | None = None

    def on_message(self, message: Message) -> Sequence[Message]:
        now = message.time_s
        if self._last_s is not None and 0.0 <= now - self._last_s < self._period_s:
            return []
        self._last_s = now
        return [
            Housekeeping(
                time_s=now,
                app=name,
                heard=c.heard,
                said=c.said,
                dropped=c.dropped,
                resets=c.resets,
                worst_step_s=c.worst_step_s,
                crashes=c.crashes,
                down=c.down,
            )
            for name, c in self._counters.items()
        ]
