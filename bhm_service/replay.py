"""The onboard loop over a recorded log: the same apps, the same order, the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from bhm_service.assembly import Equipment, assemble
from bhm_service.bus import Bus
from bhm_service.codec import NotThisKindError
from bhm_service.config import Service
from bhm_service.errors import BadInputError
from bhm_service.executive import restore
from bhm_service.mavlink.log import NOWHERE, Log, Place
from bhm_service.mavlink.recording import battery_ids
from bhm_service.messages import (
    BatterySample,
    EndOfDischarge,
    Event,
    FlightPhase,
    Housekeeping,
    Message,
    Model,
    NamedValue,
    PackChange,
    RemainingTime,
    StateEstimate,
    StatusText,
    Tick,
)

_TICK_S = 1.0
_LONGEST_SILENCE_S = 3600.0  # a gap in a log is not ticked through for longer

Tag = TypeVar("Tag")


@dataclass(slots=True)
class Replay:
    """Everything that the apps said of a log, in order."""

    samples: list[BatterySample] = field(default_factory=list)
    estimates: dict[Model, list[StateEstimate]] = field(default_factory=dict)
    predictions: dict[Model, list[EndOfDischarge]] = field(default_factory=dict)
    remaining: list[RemainingTime] = field(default_factory=list)
    phases: list[FlightPhase] = field(default_factory=list)
    changes: list[PackChange] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    outgoing: list[tuple[Place, NamedValue | StatusText]] = field(default_factory=list)  # with the frame they follow
    housekeeping: dict[str, Housekeeping] = field(default_factory=dict)  # the last of every app

    @property
    def values(self) -> list[tuple[Place, NamedValue]]:
        """The numbers among what goes out."""
        return [(place, said) for place, said in self.outgoing if isinstance(said, NamedValue)]


class _Notebook:
    """The sink of a replay: writes down what it hears."""

    name = "notebook"
    hears = (
        BatterySample,
        StateEstimate,
        EndOfDischarge,
        RemainingTime,
        FlightPhase,
        PackChange,
        Event,
        NamedValue,
        StatusText,
        Housekeeping,
    )
    says: tuple[type, ...] = ()

    def __init__(self, pages: Replay) -> None:
        self.pages = pages
        self.place: Place = NOWHERE

    def on_message(self, message: Message) -> Sequence[Message]:
        pages = self.pages
        match message:
            case BatterySample():
                pages.samples.append(message)
            case StateEstimate():
                pages.estimates.setdefault(message.model, []).append(message)
            case EndOfDischarge():
                pages.predictions.setdefault(message.model, []).append(message)
            case RemainingTime():
                pages.remaining.append(message)
            case FlightPhase():
                pages.phases.append(message)
            case PackChange():
                pages.changes.append(message)
            case Event():
                pages.events.append(message)
            case NamedValue() | StatusText():
                pages.outgoing.append((self.place, message))
            case Housekeeping():
                pages.housekeeping[message.app] = message
            case _:
                pass
        return []


def replay(
    log: Log,
    equipment: Equipment,
    service: Service,
    progress: Callable[[float], None] | None = None,
    as_recorded: bool = False,
) -> Replay:
    """Run the apps over a log. Raises BadInputError when it has nothing of the battery that is to be followed.

    ``as_recorded`` a flight recording's apps begin with what they remembered then; ``equipment`` must be its own.
    """
    _check_battery(log, equipment.vehicle.battery.id)
    pages = Replay()
    notebook = _Notebook(pages)
    bus = assemble(equipment, service, sinks=[notebook])
    total = max(len(log.messages), 1)
    remembered = dict(log.recorded.states) if log.recorded is not None and as_recorded else {}
    # A flight recording has the ticks of its own run.
    messages = with_ticks(log.messages) if log.recorded is None else log.messages
    for count, (place, message) in enumerate(messages):
        if count in remembered:
            _restore(bus, remembered[count], log)
        notebook.place = place
        bus.publish(message)
        if progress is not None and count % 500 == 0:
            progress(min(count / total, 1.0))
    return pages


def _restore(bus: Bus, remembered: dict[str, Any], log: Log) -> None:
    try:
        restore(bus.apps, remembered)
    except NotThisKindError as why:
        raise BadInputError(
            str(log.path), f"is of another version of the service: {why}", "replay it with the version that recorded it"
        ) from None


def reproduced(log: Log, pages: Replay) -> str:
    """Whether the replay of a flight recording said to the ground what was said in flight, in words."""
    recorded = log.recorded
    assert recorded is not None
    ours = [said for _, said in pages.outgoing]
    if list(recorded.said) == ours:
        return f"all {len(ours)} messages to the ground are reproduced exactly"
    same = sum(a == b for a, b in zip(recorded.said, ours, strict=False))
    return f"{len(recorded.said)} messages to the ground were recorded, {len(ours)} replayed, {same} are equal"


def _check_battery(log: Log, wanted: int) -> None:
    ids = battery_ids(message for _, message in log.messages)
    if not ids:
        raise BadInputError(
            str(log.path),
            "holds no battery message (BATTERY_STATUS, SYS_STATUS): nothing to estimate from",
            "on ArduPilot set SRx_EXTRA3 and SRx_EXT_STAT to 1 or more, or record with `bhm run`, which asks for them",
        )
    if wanted not in ids:
        raise BadInputError(
            str(log.path), f"battery.id = {wanted}: not in this log, which has {', '.join(map(str, sorted(ids)))}"
        )


def with_ticks(messages: Iterable[tuple[Tag, Message]]) -> Iterator[tuple[Tag, Message]]:
    """The messages with a `Tick` before the first one of every further second."""
    due: float | None = None
    for tag, message in messages:
        now = message.time_s
        if due is None or now < due - _TICK_S - 1.0 or now > due + _LONGEST_SILENCE_S:
            due = now + _TICK_S
        while now >= due:
            yield tag, Tick(time_s=due)
            due += _TICK_S
        yield tag, message
