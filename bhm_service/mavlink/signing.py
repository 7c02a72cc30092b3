"""MAVLink 2 message signing (https://mavlink.io/en/guide/message_signing.html).

A signature is checked before anything of its frame changes any state, so that a forged frame from the future cannot
shut out the real stream.
"""

from __future__ import annotations

import hashlib
import hmac
import os
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from fastcrc.crc16 import mcrf4xx

from bhm_service.errors import BadInputError
from bhm_service.mavlink.dialect import ENUM, layout

KEY_BYTES = 32
_SIGNATURE = 13  # link id, 6 bytes of time, 6 bytes of hash
_EPOCH_S = 1_420_070_400  # 2015-01-01: signing times count from here, in 10 us
_UNIT_S = 1e-5
_SET_S = 1_735_689_600.0  # 2025-01-01: a clock before this was never set
_LATE_UNITS = 6_000_000  # one minute: how old the first frame of a new stream may be
_STREAMS = 64
_V2 = 0xFD
_SIGNED = 0x01
_UNSIGNED_ALLOWED = frozenset({ENUM.MAVLINK_MSG_ID_RADIO_STATUS})  # radios make it up themselves and have no key


class Refusal(Enum):
    """Why a frame was not believed."""

    UNSIGNED = "not signed"
    FORGED = "signed with another key, or forged"
    REPLAYED = "older than what was heard before"


def read_key(path: Path) -> bytes:
    """A key file: 32 bytes, or 64 hexadecimal digits. Raises BadInputError, also where others could read it."""
    try:
        mode = path.stat().st_mode
        data = path.read_bytes()
    except OSError as why:
        raise BadInputError(f"signing key {path}", (why.strerror or str(why)).lower()) from None
    # What systemd hands over (LoadCredential) it guards itself, with a mode that depends on its version.
    handed_over = path.parent == Path(os.environ.get("CREDENTIALS_DIRECTORY", "/nowhere"))
    if mode & 0o077 and not handed_over:
        raise BadInputError(
            f"signing key {path}", f"may be used by others (mode {mode & 0o777:04o})", f"chmod 600 {path}"
        )
    if len(data) == KEY_BYTES:
        return data
    try:
        key = bytes.fromhex(data.decode("ascii"))
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise BadInputError(
            f"signing key {path}",
            f"must be {KEY_BYTES} bytes or {2 * KEY_BYTES} hexadecimal digits; has {len(data)} bytes",
            f"make one: (umask 077; openssl rand -hex {KEY_BYTES} > {path})",
        )
    return key


@dataclass(slots=True)
class Signer:
    """Signs what goes out and checks what comes in; its clock is the later one of ours and of what it believed."""

    key: bytes = field(repr=False)
    _clock: int = 0  # [10 us] of the last frame, ours or believed
    _streams: dict[tuple[int, int, int], int] = field(default_factory=dict)

    @staticmethod
    def clock_is_set(unix_s: float) -> bool:
        """Whether a wall clock may be used for signing: peers silently reject one that stands at its start."""
        return unix_s >= _SET_S

    def sign(self, frame: bytes, link: int, unix_s: float) -> bytes:
        """An unsigned MAVLink 2 frame of the dialect, signed for one link (0 to 255)."""
        message_id = int.from_bytes(frame[7:10], "little")
        shape = layout(message_id)
        assert shape is not None
        body = bytes((frame[0], frame[1], frame[2] | _SIGNED)) + frame[3:-2]
        checksum = mcrf4xx(shape.extra, mcrf4xx(body[1:]))
        self._clock = max(_units(unix_s), self._clock + 1)
        signed = body + checksum.to_bytes(2, "little") + bytes((link,)) + self._clock.to_bytes(6, "little")
        return signed + self._hash(signed)

    def check(self, raw: bytes, message_id: int, unix_s: float) -> Refusal | None:
        """Whether a frame with a right checksum is to be believed; nothing is remembered of one that is not."""
        if raw[0] != _V2 or not raw[2] & _SIGNED:
            return None if message_id in _UNSIGNED_ALLOWED else Refusal.UNSIGNED
        if not hmac.compare_digest(self._hash(raw[:-6]), raw[-6:]):
            return Refusal.FORGED
        stamp = int.from_bytes(raw[-12:-6], "little")
        stream = (raw[5], raw[6], raw[-_SIGNATURE])
        last = self._streams.get(stream)
        oldest = max(_units(unix_s), self._clock) - _LATE_UNITS if last is None else last + 1
        if stamp < oldest:
            return Refusal.REPLAYED
        if last is None and len(self._streams) >= _STREAMS:
            del self._streams[next(iter(self._streams))]
        self._streams[stream] = stamp
        self._clock = max(self._clock, stamp)
        return None

    def _hash(self, signed: bytes) -> bytes:
        return hashlib.sha256(self.key + signed).digest()[:6]


def _units(unix_s: float) -> int:
    return max(int((unix_s - _EPOCH_S) / _UNIT_S), 0)
