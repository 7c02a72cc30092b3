"""The flight recorder's files: rows of JSON in small compressed chunks, each with its checksum, in rotating segments.

A segment begins with a head and with what every app remembered, so that it can be replayed by itself. Chunks share one
compressor for half a minute: a damaged one costs no more than the rest of that half minute.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

Row: TypeAlias = list[Any]
"""What kind of row, and what it holds."""

FILE_HEAD = b"bhm flight recorder 1\n"
SUFFIX = ".bhmlog"
_CHUNK = struct.Struct("<2sBII")  # mark, whether the compressor begins anew, length, checksum of the rest
_MARK = b"\xb4\xe1"
_CHUNKS_TOGETHER = 30
_SEGMENTS = 8
_LARGEST = 1 << 24  # bytes of a chunk, compressed or not


class Segments:
    """Writes rows into numbered files of one folder, and keeps them together below a size.

    Every method but `close` may raise OSError: a full disk, a folder that is not ours. What was begun is then cut off
    where it was whole, and `begin` may be tried again.
    """

    def __init__(self, folder: Path, limit_bytes: int) -> None:
        self._folder = folder
        self._limit = limit_bytes
        self._segment_limit = max(limit_bytes // _SEGMENTS, 1)
        self._file: int | None = None
        self._size = 0
        self._chunks = 0
        self._compressor = zlib.compressobj(9)
        self._rows: list[str] = []

    @property
    def fullness(self) -> float:
        """Share of the current segment that is used; 1 and more where there is none."""
        return 1.0 if self._file is None else self._size / self._segment_limit

    def begin(self, head: dict[str, Any]) -> None:
        """Start the next segment; the oldest ones make room."""
        self.close()
        self._folder.mkdir(parents=True, exist_ok=True)
        old = segments_of(self._folder)
        sizes = [path.stat().st_size for path in old]
        while old and sum(sizes) + self._segment_limit > self._limit:
            old.pop(0).unlink()
            sizes.pop(0)
        number = 1 + max((int(path.stem) for path in segments_of(self._folder)), default=0)
        path = self._folder / f"{number:06d}{SUFFIX}"
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640)
        self._size = self._chunks = 0
        self._put(FILE_HEAD)
        self.add("head", head)

    def add(self, kind: str, data: Any) -> None:
        """One row more; it is written with the next `flush`. Without a segment it is forgotten."""
        if self._file is not None:
            self._rows.append(json.dumps([kind, data], separators=(",", ":")))

    def flush(self) -> None:
        """Write the rows that wait, as one chunk."""
        if not self._rows or self._file is None:
            return
        fresh = self._chunks % _CHUNKS_TOGETHER == 0
        if fresh:
            self._compressor = zlib.compressobj(9)
        text = ("\n".join(self._rows) + "\n").encode()
        self._rows.clear()
        body = self._compressor.compress(text) + self._compressor.flush(zlib.Z_SYNC_FLUSH)
        self._put(_CHUNK.pack(_MARK, fresh, len(body), zlib.crc32(body, fresh)) + body)
        self._chunks += 1

    def close(self) -> None:
        """End the segment; what waits is written if it can be."""
        if self._file is None:
            return
        with contextlib.suppress(OSError):
            self.flush()
        if self._file is not None:
            os.close(self._file)
        self._file = None
        self._rows.clear()

    def _put(self, data: bytes) -> None:
        assert self._file is not None
        try:
            if os.write(self._file, data) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._size)
            os.close(self._file)
            self._file = None
            self._rows.clear()
            raise
        self._size += len(data)


def segments_of(folder: Path) -> list[Path]:
    """The segments of a folder, oldest first."""
    return sorted((p for p in folder.glob(f"*{SUFFIX}") if p.stem.isdigit()), key=lambda p: int(p.stem))


@dataclass(slots=True)
class Lost:
    """What could not be read."""

    bytes: int = 0
    places: int = 0
    rows: int = 0
    truncated: bool = False


class SegmentReader:
    """Rows of one segment, as far as they can be read; `lost` counts what cannot."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.lost = Lost()

    def __iter__(self) -> Iterator[Row]:
        at, size = len(FILE_HEAD), len(self._data)
        stream: Any = None
        while at < size:
            fresh, body, end = self._chunk(at)
            if body is None:
                found = self._next(at)
                self.lost.bytes += found - at
                if found == size:
                    self.lost.truncated = True
                    return
                self.lost.places += 1
                at, stream = found, None
                continue
            at = end
            if fresh:
                stream = zlib.decompressobj()
            if stream is None:
                self.lost.bytes += _CHUNK.size + len(body)
                continue
            yield from self._rows(stream, body)

    def _chunk(self, at: int) -> tuple[bool, bytes | None, int]:
        if at + _CHUNK.size > len(self._data):
            return False, None, at
        mark, fresh, length, crc = _CHUNK.unpack_from(self._data, at)
        end = at + _CHUNK.size + length
        if mark != _MARK or fresh > 1 or length > _LARGEST or end > len(self._data):
            return False, None, end
        body = self._data[end - length : end]
        return bool(fresh), body if zlib.crc32(body, fresh) == crc else None, end

    def _next(self, at: int) -> int:
        """Where the next whole chunk begins."""
        while True:
            at = self._data.find(_MARK, at + 1)
            if at < 0:
                return len(self._data)
            if self._chunk(at)[1] is not None:
                return at

    def _rows(self, stream: Any, body: bytes) -> Iterator[Row]:
        try:
            text = stream.decompress(body, _LARGEST)
        except zlib.error:
            self.lost.places += 1
            self.lost.bytes += len(body)
            return
        for line in text.split(b"\n"):
            if not line:
                continue
            try:
                row = json.loads(line)
            except (ValueError, RecursionError):
                row = None
            if isinstance(row, list) and len(row) == 2 and isinstance(row[0], str):
                yield row
            else:
                self.lost.rows += 1
