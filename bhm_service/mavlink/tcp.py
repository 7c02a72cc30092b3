"""TCP connections: one that we make, and a port on which somebody connects to us."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import time
from collections.abc import Callable

from bhm_service.mavlink.lookup import Lookup
from bhm_service.mavlink.transport import Chunk, LinkDownError, LinkUrl, StreamTransport, found, words

_CONNECT_S = 5.0
_DEAD_MS = 10_000  # a peer that acknowledges nothing for so long is gone


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
        family, address = found(self._lookup)
        opened = socket.socket(family, socket.SOCK_STREAM)
        opened.setblocking(False)
        _lively(opened)
        refused = opened.connect_ex(address)
        if refused not in (0, errno.EINPROGRESS):
            opened.close()
            raise LinkDownError(words(OSError(refused, os.strerror(refused))))
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
            raise LinkDownError(words(OSError(refused, os.strerror(refused))))
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
        family, address = found(self._lookup)
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(address)
            listener.listen(1)
        except OSError as why:
            listener.close()
            raise LinkDownError(words(why)) from None
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


def _lively(opened: socket.socket) -> None:
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        # Heartbeats go out every second: a router that vanished without a word is noticed by their silence.
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _DEAD_MS)
