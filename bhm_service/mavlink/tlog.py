"""Telemetry logs (.tlog): 8 bytes of big-endian microseconds before every frame.

The reader walks the headers and decodes only what is wanted; a frame's checksum is tested when the frame is wanted or
when the walk has lost its footing. Damage costs the frames that it hit, never the rest, and is counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from fastcrc.crc16 import mcrf4xx

from bhm_service.mavlink.dialect import layout

_STAMP = 8
_V1, _V2 = 0xFE, 0xFD
_SIGNED = 0x01
_LINK_BITS = 3  # MAVProxy keeps a link number in the stamp's low two bits
# Stamps are of this century: what lies outside is no stamp, so the file is no tlog (or lost its footing there).
_EARLIEST_US, _LATEST_US = 0, 4_102_444_800_000_000


class Frame(NamedTuple):
    """One frame of a log."""

    stamp_us: int
    message_id: int
    source: tuple[int, int]  # system, component
    payload: bytes
    begin: int  # where its stamp stands in the file
    end: int  # where the next one begins


@dataclass(slots=True)
class Skipped:
    """What a reader had to leave out."""

    bytes: int = 0
    places: int = 0
    bad_checksums: int = 0
    rows: int = 0  # of a table, without a time; of a flight recording, not understood
    truncated: bool = False

    def __bool__(self) -> bool:
        return self.places > 0 or self.bad_checksums > 0 or self.rows > 0 or self.truncated

    def __str__(self) -> str:
        parts = []
        if self.places:
            parts.append(f"{self.bytes} bytes in {self.places} places")
        if self.bad_checksums:
            parts.append(f"{self.bad_checksums} frames with a wrong checksum")
        if self.rows:
            parts.append(f"{self.rows} rows that say nothing")
        if self.truncated:
            parts.append("the last frame is cut off")
        return ", ".join(parts) if parts else "nothing"


class TlogReader:
    """Frames of a tlog that are wanted, in order."""

    def __init__(self, data: bytes, wanted: frozenset[int]) -> None:
        self.data = data
        self.wanted = wanted
        self.skipped = Skipped()

    @classmethod
    def open(cls, path: Path, wanted: frozenset[int]) -> TlogReader:
        """Read a file."""
        return cls(path.read_bytes(), wanted)

    def __iter__(self) -> Iterator[Frame]:
        data, wanted, size = self.data, self.wanted, len(self.data)
        at = previous = 0
        while at < size:
            start = at + _STAMP
            if start + 8 > size:
                break
            magic = data[start]
            if magic == _V2:
                end = start + 12 + data[start + 1]
                if data[start + 2] & _SIGNED:
                    end += 13
                if start + 10 > size:
                    break
                message_id = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
                source_at, body = start + 5, start + 10
            elif magic == _V1:
                end = start + 8 + data[start + 1]
                message_id = data[start + 5]
                source_at, body = start + 3, start + 6
            else:
                at = previous = self._find_again(at, previous)
                continue
            if end > size:
                if previous != at and not self._sound(previous):
                    at = previous = self._find_again(at, previous)
                    continue
                break
            if message_id in wanted:
                if not checksum_holds(data, start, message_id):
                    if self._stands(end):
                        self.skipped.bad_checksums += 1
                        previous, at = at, end
                    else:
                        at = previous = self._find_again(at, at)
                    continue
                length = data[start + 1]
                yield Frame(
                    int.from_bytes(data[at:start], "big") & ~_LINK_BITS,
                    message_id,
                    (data[source_at], data[source_at + 1]),
                    data[body : body + length],
                    at,
                    end,
                )
            previous, at = at, end
        if at < size:
            self.skipped.truncated = True
            self.skipped.bytes += size - at

    def _sound(self, at: int) -> bool:
        """Whether a frame of a known kind with a right checksum stands here."""
        data, start = self.data, at + _STAMP
        if start + 12 > len(data):
            return False
        if data[start] == _V2:
            message_id = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
        elif data[start] == _V1:
            message_id = data[start + 5]
        else:
            return False
        return checksum_holds(data, start, message_id)

    def _stands(self, at: int) -> bool:
        """Whether a frame seems to begin here, or the file ends."""
        data, start = self.data, at + _STAMP
        return at == len(data) or (start < len(data) and data[start] in (_V1, _V2))

    def _find_again(self, at: int, previous: int) -> int:
        """Where the next sound frame begins. The frame before may have lied about its length: look inside it too."""
        begin = at if previous == at or self._sound(previous) else previous
        place = begin + 1
        data, size = self.data, len(self.data)
        while place + _STAMP < size:
            magic = data[place + _STAMP]
            if magic in (_V1, _V2) and self._sound(place):
                break
            place += 1
        else:
            place = size
        self.skipped.places += 1
        self.skipped.bytes += place - begin
        return place


def checksum_holds(data: bytes, start: int, message_id: int) -> bool:
    """Whether the frame that begins at ``start`` has a right checksum; False for kinds that are not known."""
    shape = layout(message_id)
    if shape is None:
        return False
    end = start + data[start + 1] + (10 if data[start] == _V2 else 6)
    if end + 2 > len(data):
        return False
    checksum = mcrf4xx(shape.extra, mcrf4xx(data[start + 1 : end]))
    return bool(data[end] == checksum & 0xFF and data[end + 1] == checksum >> 8)


def looks_like_tlog(head: bytes) -> bool:
    """Whether a file that begins with ``head`` is a tlog: a plausible stamp, then a frame."""
    for place in range(max(min(len(head) - 12, 2048), 0)):
        stamp = int.from_bytes(head[place : place + _STAMP], "big")
        if head[place + _STAMP] in (_V1, _V2) and _EARLIEST_US <= stamp <= _LATEST_US:
            return True
    return False
