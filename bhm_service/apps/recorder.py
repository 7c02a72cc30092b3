"""Recorder: every message of the bus to the flight recorder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, get_args

from bhm_service.codec import packed
from bhm_service.messages import Message


class RecorderApp:
    """Hears everything. The large fields of what the apps said are left out: a replay makes them anew."""

    name = "recorder"
    hears: tuple[type, ...] = get_args(Message)
    says: tuple[type, ...] = ()

    def __init__(self, write: Callable[[str, Any], None]) -> None:
        self._write = write

    def on_message(self, message: Message) -> Sequence[Message]:
        self._write(type(message).__name__, packed(message, bulk=False))
        return []
