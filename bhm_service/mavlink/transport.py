"""Ways to an autopilot: serial, UDP, TCP. None of them ever blocks; each says when it is gone and opens again."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import termios
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from bhm_service.errors import BadInputError
from bhm_service.mavlink.lookup import Lookup, LookupFailedError

Peer: TypeAlias = object
Chunk: TypeAlias = tuple[Peer, bytes]
"""Bytes and whom they came from: what several peers say must not be glued together."""

FORMS = "serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or tcpin:HOST:PORT"
_BAUDS = (1200, 12_000_000)
_FORGET_PEER_S = 30.0
_PEERS = 16
_DATAGRAM = 65535
_DATAGRAMS = 256  # at most in one go, so that a flood cannot hold the loop
_PIECE = 16384
_WAITING = 32768  # bytes that a stuck stream may hold back
_CONNECT_S = 5.0
_DEAD_MS = 10_000  # a TCP peer that acknowledges nothing for so long is gone


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
        right = kind in _KINDS and target and digits.isascii() and digits.isdigit() and low <= int(digits) <= high
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


class UdpTransport(Transport):
    """Datagrams. ``udpin`` answers whoever has lately sent to a port; ``udpout`` talks with one address."""

    def __init__(self, url: LinkUrl, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(url)
        self._clock = clock
        self._lookup = Lookup(url.target, url.number, socket.SOCK_DGRAM)
        self._socket: socket.socket | None = None
        self._peers: dict[Any, float] = {}

    @property
    def _listens(self) -> bool:
        return self.url.kind == "udpin"

    def open(self) -> None:
        family, address = _resolved(self._lookup)
        opened = socket.socket(family, socket.SOCK_DGRAM)
        opened.setblocking(False)
        try:
            opened.bind(address) if self._listens else opened.connect(address)
        except OSError as why:
            opened.close()
            if self._listens and why.errno == errno.EADDRINUSE:
                raise LinkDownError(f"{_words(why)}: is another program on this port?") from None
            raise LinkDownError(_words(why)) from None
        self._socket = opened

    @property
    def ready(self) -> bool:
        return self._socket is not None

    def interests(self) -> list[tuple[int, int]]:
        return [] if self._socket is None else [(self._socket.fileno(), select.POLLIN)]

    def receive(self) -> list[Chunk]:
        found: list[Chunk] = []
        if self._socket is None:
            return found
        for _ in range(_DATAGRAMS):
            try:
                data, peer = self._socket.recvfrom(_DATAGRAM)
            except BlockingIOError:
                break
            except ConnectionError:  # nobody is on the other port yet
                continue
            except OSError as why:
                raise LinkDownError(_words(why)) from None
            if self._listens:
                self._meet(peer)
            found.append((peer, data))
        return found

    def _meet(self, peer: Any) -> None:
        now = self._clock()
        if peer not in self._peers and len(self._peers) >= _PEERS:
            del self._peers[min(self._peers, key=self._peers.__getitem__)]
        self._peers[peer] = now

    def send(self, data: bytes) -> None:
        if self._socket is None:
            return
        if not self._listens:
            with contextlib.suppress(OSError):  # what cannot be delivered is lost, as UDP is
                self._socket.send(data)
            return
        now = self._clock()
        self._peers = {peer: seen for peer, seen in self._peers.items() if now - seen < _FORGET_PEER_S}
        for peer in self._peers:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, peer)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None
        self._peers.clear()


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
            raise LinkDownError(_words(why)) from None
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
            self._broken = _words(why)

    def close(self) -> None:
        self._waiting.clear()
        self._broken = ""


class SerialTransport(StreamTransport):
    """A serial port. An adapter that is pulled out is gone; it opens again when it is back."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._port: Any = None

    def open(self) -> None:
        import serial  # only who has a serial link pays for it

        device = Path(self.url.target)
        if not device.exists():
            raise LinkDownError("no such device: is the adapter plugged in?")
        try:
            self._port = serial.Serial(str(device), self.url.number, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as why:  # SerialException is an OSError, termios.error is not
            raise LinkDownError(_serial_words(why)) from None
        os.set_blocking(self._port.fileno(), False)

    def _descriptor(self) -> int | None:
        return None if self._port is None else int(self._port.fileno())

    def close(self) -> None:
        super().close()
        port, self._port = self._port, None
        if port is not None:
            # Unsent bytes are thrown away first: closing a port that nobody reads would wait for them.
            with contextlib.suppress(OSError, termios.error):
                port.reset_output_buffer()
            with contextlib.suppress(OSError, termios.error):
                port.close()


class TcpTransport(StreamTransport):
    """A TCP connection that we make."""

    def __init__(self, url: LinkUrl, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(url)
        self._clock = clock
        self._lookup = Lookup(url.target, url.number, socket.SOCK_STREAM)
        self._socket: socket.socket | None = None
        self._connected = False
        self._give_up_s = 0.0

    def open(self) -> None:
        family, address = _resolved(self._lookup)
        opened = socket.socket(family, socket.SOCK_STREAM)
        opened.setblocking(False)
        _lively(opened)
        refused = opened.connect_ex(address)
        if refused not in (0, errno.EINPROGRESS):
            opened.close()
            raise LinkDownError(_words(OSError(refused, os.strerror(refused))))
        self._socket, self._connected = opened, refused == 0
        self._give_up_s = self._clock() + _CONNECT_S

    @property
    def ready(self) -> bool:
        return self._socket is not None and self._connected

    def _descriptor(self) -> int | None:
        return self._socket.fileno() if self._socket is not None and self._connected else None

    def interests(self) -> list[tuple[int, int]]:
        if self._socket is not None and not self._connected:
            return [(self._socket.fileno(), select.POLLOUT)]
        return super().interests()

    def receive(self) -> list[Chunk]:
        if self._socket is None or self._connected:
            return super().receive()
        refused = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if refused:
            raise LinkDownError(_words(OSError(refused, os.strerror(refused))))
        try:
            self._socket.getpeername()
        except OSError:
            if self._clock() >= self._give_up_s:
                raise LinkDownError(f"no answer within {_CONNECT_S:.0f} s") from None
            return []
        self._connected = True
        return []

    def close(self) -> None:
        super().close()
        if self._socket is not None:
            self._socket.close()
        self._socket, self._connected = None, False


class TcpServerTransport(StreamTransport):
    """A TCP port on which one peer at a time is served; a new one replaces the old, which may be dead."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._lookup = Lookup(url.target, url.number, socket.SOCK_STREAM)
        self._listener: socket.socket | None = None
        self._peer: socket.socket | None = None

    def open(self) -> None:
        family, address = _resolved(self._lookup)
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(address)
            listener.listen(1)
        except OSError as why:
            listener.close()
            raise LinkDownError(_words(why)) from None
        self._listener = listener

    def _descriptor(self) -> int | None:
        return None if self._peer is None else self._peer.fileno()

    def interests(self) -> list[tuple[int, int]]:
        listener = [] if self._listener is None else [(self._listener.fileno(), select.POLLIN)]
        return [*listener, *super().interests()]

    def receive(self) -> list[Chunk]:
        if self._listener is not None:
            with contextlib.suppress(OSError):
                peer = self._listener.accept()[0]
                self._drop_peer()
                peer.setblocking(False)
                _lively(peer)
                self._peer = peer
        try:
            return super().receive()
        except LinkDownError:
            self._drop_peer()
            return []

    def _drop_peer(self) -> None:
        super().close()
        if self._peer is not None:
            self._peer.close()
        self._peer = None

    def close(self) -> None:
        self._drop_peer()
        if self._listener is not None:
            self._listener.close()
        self._listener = None


_KINDS: dict[str, type[Transport]] = {
    "serial": SerialTransport,
    "udpin": UdpTransport,
    "udpout": UdpTransport,
    "tcp": TcpTransport,
    "tcpin": TcpServerTransport,
}


def transport_of(url: LinkUrl) -> Transport:
    """The transport of a link, not yet open."""
    return _KINDS[url.kind](url)


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


def _resolved(lookup: Lookup) -> tuple[int, Any]:
    try:
        return lookup.address()
    except LookupFailedError as why:
        raise LinkDownError(str(why)) from None


def _lively(opened: socket.socket) -> None:
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        # Heartbeats go out every second: a router that vanished without a word is noticed by their silence.
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _DEAD_MS)


def _words(why: OSError) -> str:
    return (why.strerror or str(why)).lower()


def _serial_words(why: Exception) -> str:
    number = getattr(why, "errno", None)
    if number == errno.EACCES:
        return "permission denied: add the user to the group of the device (dialout on Debian)"
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return "another program has this port open"
    return str(why)
