"""What every way to an autopilot has in common: it never blocks, says when it is gone, and opens again."""

from __future__ import annotations

import os
import select
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, TypeAlias

from bhm_service.errors import BadInputError
from bhm_service.mavlink.lookup import Lookup, LookupFailedError

Peer: TypeAlias = object
Chunk: TypeAlias = tuple[Peer, bytes]
"""Bytes and whom they came from: what several peers say must not be glued together."""

FORMS = "serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or tcpin:HOST:PORT"
KINDS = ("serial", "udpin", "udpout", "tcp", "tcpin")
_BAUDS = (1200, 12_000_000)
_PIECE = 16384
_WAITING = 32768  # bytes that a stuck stream may hold back


class LinkDownError(Exception):
    """The link is gone, or cannot be opened now; the words say why and what to do."""


@dataclass(frozen=True, slots=True)
class LinkUrl:
    """Where a link leads."""

    text: str
    kind: str
    target: str  # host or device
    number: int  # port or baud rate

    @classmethod
    def parse(cls, text: str) -> LinkUrl:
        """Read `kind:target:number`. Raises BadInputError."""
        kind, _, rest = text.partition(":")
        target, _, digits = rest.rpartition(":")
        low, high = _BAUDS if kind == "serial" else (1, 65535)
        right = kind in KINDS and target and digits.isascii() and digits.isdigit() and low <= int(digits) <= high
        if not right:
            raise BadInputError(f"link {text!r}", f"must be {FORMS}")
        return cls(text, kind, target.removeprefix("[").removesuffix("]"), int(digits))


class Transport(ABC):
    """One link's bytes. Every method but `open` and `receive` keeps quiet about trouble: the next `receive` tells."""

    lost_frames = 0  # that did not fit into what was waiting to be sent

    def __init__(self, url: LinkUrl) -> None:
        self.url = url

    @abstractmethod
    def open(self) -> None:
        """Begin to open; raises LinkDownError. `ready` tells when bytes go through."""

    @property
    @abstractmethod
    def ready(self) -> bool:
        """Whether what is sent has a way to go."""

    @abstractmethod
    def interests(self) -> list[tuple[int, int]]:
        """File descriptors and the poll events that are waited for."""

    @abstractmethod
    def receive(self) -> list[Chunk]:
        """What has come; raises LinkDownError."""

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Send one frame as a whole or, where there is no room, not at all."""

    @abstractmethod
    def close(self) -> None:
        """Give everything back; may be opened again."""


class StreamTransport(Transport):
    """A stream of bytes through one file descriptor; what it does not take at once waits, up to a limit."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._waiting = bytearray()
        self._broken = ""

    @abstractmethod
    def _descriptor(self) -> int | None: ...

    def _read(self, descriptor: int) -> bytes:
        return os.read(descriptor, _PIECE)

    @property
    def ready(self) -> bool:
        return self._descriptor() is not None

    def interests(self) -> list[tuple[int, int]]:
        descriptor = self._descriptor()
        if descriptor is None:
            return []
        return [(descriptor, select.POLLIN | (select.POLLOUT if self._waiting else 0))]

    def receive(self) -> list[Chunk]:
        descriptor = self._descriptor()
        if descriptor is None:
            return []
        self._flush()
        if self._broken:
            raise LinkDownError(self._broken)
        try:
            data = self._read(descriptor)
        except BlockingIOError:
            return []
        except OSError as why:
            raise LinkDownError(words(why)) from None
        if not data:
            raise LinkDownError("the other end closed it")
        return [(None, data)]

    def send(self, data: bytes) -> None:
        if self._descriptor() is None:
            return
        if len(self._waiting) + len(data) > _WAITING:
            self.lost_frames += 1
            return
        self._waiting += data
        self._flush()

    def _flush(self) -> None:
        descriptor = self._descriptor()
        if descriptor is None or not self._waiting:
            return
        try:
            del self._waiting[: os.write(descriptor, self._waiting)]
        except BlockingIOError:
            return
        except OSError as why:
            self._broken = words(why)

    def close(self) -> None:
        self._waiting.clear()
        self._broken = ""


def wait_for(transports: list[Transport], timeout_s: float) -> list[Transport]:
    """Those that have something to tell, after at most ``timeout_s``; sleeps where none is open."""
    poll = select.poll()
    owner: dict[int, Transport] = {}
    for transport in transports:
        for descriptor, events in transport.interests():
            poll.register(descriptor, events)
            owner[descriptor] = transport
    told = poll.poll(max(timeout_s, 0.0) * 1000.0)
    return list(dict.fromkeys(owner[descriptor] for descriptor, _ in told))


def found(lookup: Lookup) -> tuple[int, Any]:
    """Address family and address of a host; raises LinkDownError while they are not known."""
    try:
        return lookup.address()
    except LookupFailedError as why:
        raise LinkDownError(str(why)) from None


def words(why: OSError) -> str:
    """What the system says of an error."""
    return (why.strerror or str(why)).lower()
