"""Frames out of a stream of bytes: whatever comes over a wire, in pieces of any size. Nothing here ever raises."""

from __future__ import annotations

from dataclasses import dataclass

from bhm_service.mavlink.dialect import layout
from bhm_service.mavlink.tlog import checksum_holds

_V1, _V2 = 0xFE, 0xFD
_SIGNED = 0x01
_LONGEST = 280  # bytes of the longest signed MAVLink 2 frame


@dataclass(frozen=True, slots=True)
class WireFrame:
    """One frame with a right checksum."""

    message_id: int
    source: tuple[int, int]  # system, component
    payload: bytes
    raw: bytes


@dataclass(slots=True)
class FrameSplitter:
    """Keeps what is left of a stream until the rest of a frame comes; counts what belonged to no frame."""

    stray_bytes: int = 0
    bad_checksums: int = 0
    _left: bytes = b""

    def feed(self, data: bytes) -> list[WireFrame]:
        """Frames that are complete now. Frames of kinds that the dialect does not know are passed over."""
        buffer = self._left + data
        frames: list[WireFrame] = []
        at, size = 0, len(buffer)
        while at < size:
            magic = buffer[at]
            if magic not in (_V1, _V2):
                at += 1
                self.stray_bytes += 1
                continue
            head = 10 if magic == _V2 else 6
            if at + head > size:
                break
            length = buffer[at + 1]
            end = at + head + length + 2
            if magic == _V2:
                end += 13 if buffer[at + 2] & _SIGNED else 0
                message_id = buffer[at + 7] | buffer[at + 8] << 8 | buffer[at + 9] << 16
                source = (buffer[at + 5], buffer[at + 6])
            else:
                message_id, source = buffer[at + 5], (buffer[at + 3], buffer[at + 4])
            if end > size:
                break
            strange = magic == _V2 and buffer[at + 2] & ~_SIGNED
            if strange or not checksum_holds(buffer, at, message_id):
                # Damage, a kind that the dialect does not know, or a flag of a protocol to come, of which one has to
                # keep one's hands off: the next head is looked for inside it. Only of a known kind it is known to be
                # damage: a link that carries messages of its maker's own is none the worse for it.
                self.bad_checksums += layout(message_id) is not None
                at += 1
                continue
            payload = buffer[at + head : at + head + length]
            frames.append(WireFrame(message_id, source, payload, buffer[at:end]))
            at = end
        self._left = buffer[at:][-_LONGEST:]
        return frames
