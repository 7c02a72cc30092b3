"""A flight recorder's segment as messages: what came in, where the apps began, and what they said to the ground."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias, get_args

from bhm_service.codec import NotThisKindError, unpacked
from bhm_service.flight_recorder import Lost, SegmentReader
from bhm_service.messages import Event, Input, NamedValue, StatusText

Sent: TypeAlias = tuple[int, int, int]
"""System, component and number of the first frame of one message to the ground."""

_INPUTS: dict[str, type] = {kind.__name__: kind for kind in get_args(Input)}
_SAID: dict[str, type] = {kind.__name__: kind for kind in (NamedValue, StatusText)}
_OUTSIDE = ("links", "service")  # whose events no app makes again


@dataclass(frozen=True, slots=True)
class Recorded:
    """One segment."""

    head: dict[str, Any]
    messages: tuple[Input | Event, ...]
    states: tuple[tuple[int, dict[str, Any]], ...]  # before which message the apps were given what they remember
    said: tuple[NamedValue | StatusText, ...]
    sent: tuple[Sent | None, ...]  # of each of these; None where nobody was there to hear it
    lost: Lost


def read_recorded(path: Path) -> Recorded:
    """Read a segment as far as it can be read."""
    reader = SegmentReader(path.read_bytes())
    head: dict[str, Any] = {}
    messages: list[Input | Event] = []
    states: list[tuple[int, dict[str, Any]]] = []
    said: list[NamedValue | StatusText] = []
    sent: list[Sent | None] = []
    for kind, data in reader:
        try:
            if kind in _INPUTS:
                messages.append(unpacked(_INPUTS[kind], data))
            elif kind in _SAID:
                said.append(unpacked(_SAID[kind], data))
            elif kind == "sent":
                sent.append(unpacked(Sent | None, data))  # type: ignore[arg-type]
            elif kind == "Event":
                event = unpacked(Event, data)
                messages += [event] if event.app in _OUTSIDE else []
            elif kind == "states":
                states.append((len(messages), unpacked(dict[str, Any], data)))
            elif kind == "head":
                head = unpacked(dict[str, Any], data)
        except NotThisKindError:
            reader.lost.rows += 1
    return Recorded(head, tuple(messages), tuple(states), tuple(said), tuple(sent), reader.lost)
