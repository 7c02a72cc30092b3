"""Any log to messages: what kind it is, what it holds, what had to be left out."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TypeAlias

from bhm_service.errors import BadInputError
from bhm_service.flight_recorder import FILE_HEAD
from bhm_service.mavlink.clock import SteadyClock
from bhm_service.mavlink.dataflash import HEAD as DATAFLASH_HEAD
from bhm_service.mavlink.dataflash import DataFlashReader
from bhm_service.mavlink.decode import WANTED, VehicleDecoder
from bhm_service.mavlink.table import TableReader
from bhm_service.mavlink.tlog import Skipped, TlogReader, looks_like_tlog
from bhm_service.messages import Heartbeat, Message
from bhm_service.recorded import Recorded, read_recorded

Place: TypeAlias = tuple[int, int]
NOWHERE: Place = (0, 0)
_GZIP_HEAD = b"\x1f\x8b"


class LogKind(Enum):
    """What a log file is."""

    TLOG = "telemetry log"
    DATAFLASH = "DataFlash log"
    TABLE = "table"
    RECORDER = "flight recorder"


@dataclass(frozen=True, slots=True)
class Log:
    """A log that was read: its messages, each with the place of its frame in a tlog (begin, end); else (0, 0)."""

    path: Path
    kind: LogKind
    messages: tuple[tuple[Place, Message], ...]
    system: int  # of the vehicle
    skipped: Skipped
    clock_jumps: tuple[tuple[float, float], ...]
    other_systems: tuple[int, ...]
    data: bytes  # of a tlog; empty else
    recorded: Recorded | None = None  # of our own flight recorder

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time."""
        times = [message.time_s for _, message in self.messages]
        return min(times), max(times)

    def remarks(self) -> list[str]:
        """What a person who reads the result should know of the reading."""
        said = [f"skipped {self.skipped}"] if self.skipped else []
        if self.clock_jumps:
            said.append(f"the recorder's clock was set {len(self.clock_jumps)} times; times follow the autopilot's")
        if self.other_systems:
            said.append(f"passed over other vehicles on the link: system {', '.join(map(str, self.other_systems))}")
        return said


def read_log(path: Path, system: int | None = None, progress: Callable[[float], None] | None = None) -> Log:
    """Read a tlog, a DataFlash log or a table; its content tells which, not its name.

    ``progress`` is called with the share that is read. Raises BadInputError for what is no log, is empty or holds no
    message of an autopilot.
    """
    kind = kind_of(path)
    if kind is LogKind.RECORDER:
        return _recorder_log(path)
    clock = SteadyClock()
    others: tuple[int, ...] = ()
    vehicle = 1
    data = b""
    if kind is LogKind.TLOG:
        reader = TlogReader.open(path, WANTED)
        decoder = VehicleDecoder(system)
        messages = tuple(clock.steady(_tlog_messages(reader, decoder, progress)))
        skipped, data, others = reader.skipped, reader.data, tuple(sorted(decoder.others))
        vehicle = decoder.system or 1
    else:
        source = DataFlashReader(path) if kind is LogKind.DATAFLASH else TableReader(path)
        messages = tuple(clock.steady((NOWHERE, message) for message in source))
        skipped = source.skipped
    if not messages:
        raise BadInputError(str(path), f"this {kind.value} holds no message of an autopilot")
    return Log(path, kind, messages, vehicle, skipped, tuple(clock.jumps), others, data)


def _recorder_log(path: Path) -> Log:
    recorded = read_recorded(path)
    lost = recorded.lost
    skipped = Skipped(bytes=lost.bytes, places=lost.places, rows=lost.rows, truncated=lost.truncated)
    messages = tuple((NOWHERE, message) for message in recorded.messages)
    system = next((m.system for m in recorded.messages if isinstance(m, Heartbeat)), None)
    if system is None:
        raise BadInputError(str(path), "this flight recording holds no message of an autopilot")
    return Log(path, LogKind.RECORDER, messages, system, skipped, (), (), b"", recorded)


def _tlog_messages(
    reader: TlogReader, decoder: VehicleDecoder, progress: Callable[[float], None] | None
) -> Iterator[tuple[Place, Message]]:
    size = max(len(reader.data), 1)
    for count, frame in enumerate(reader):
        for message in decoder.decode(frame.message_id, frame.payload, frame.source, frame.stamp_us / 1e6):
            yield (frame.begin, frame.end), message
        if progress is not None and count % 5000 == 0:
            progress(frame.end / size)


def kind_of(path: Path) -> LogKind:
    """What a file is, by its content. Raises BadInputError for what is no log."""
    if not path.exists():
        raise BadInputError(str(path), "no such file")
    if not path.is_file():
        raise BadInputError(str(path), "is not a file")
    with path.open("rb") as stream:
        head = stream.read(4096)
    if not head:
        raise BadInputError(str(path), "is empty")
    if head.startswith(FILE_HEAD):
        return LogKind.RECORDER
    if head.startswith(DATAFLASH_HEAD):
        return LogKind.DATAFLASH
    text = head
    if head.startswith(_GZIP_HEAD):
        try:
            with gzip.open(path, "rb") as stream:
                text = stream.read(256)
        except (OSError, EOFError):
            raise BadInputError(str(path), "is damaged gzip") from None
    first = text.split(b"\n", 1)[0]
    if b"," in first and all(32 <= byte < 127 or byte in (9, 13) for byte in first):
        return LogKind.TABLE
    if looks_like_tlog(head):
        return LogKind.TLOG
    raise BadInputError(
        str(path),
        "is not a log that can be read",
        "known are telemetry logs (.tlog), ArduPilot DataFlash logs (.bin), tables (.csv, .csv.gz) and our own "
        "flight recordings (.bhmlog)",
    )
