"""Datagrams from and to an autopilot or a router."""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import time
from collections.abc import Callable
from typing import Any

from bhm_service.mavlink.lookup import Lookup
from bhm_service.mavlink.transport import Chunk, LinkDownError, LinkUrl, Transport, found, words

_FORGET_PEER_S = 30.0
_PEERS = 16
_DATAGRAM = 65535
_DATAGRAMS = 256  # at most in one go, so that a flood cannot hold the loop


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
        family, address = found(self._lookup)
        opened = socket.socket(family, socket.SOCK_DGRAM)
        opened.setblocking(False)
        try:
            opened.bind(address) if self._listens else opened.connect(address)
        except OSError as why:
            opened.close()
            if self._listens and why.errno == errno.EADDRINUSE:
                raise LinkDownError(f"{words(why)}: is another program on this port?") from None
            raise LinkDownError(words(why)) from None
        self._socket = opened

    @property
    def ready(self) -> bool:
        return self._socket is not None

    def interests(self) -> list[tuple[int, int]]:
        return [] if self._socket is None else [(self._socket.fileno(), select.POLLIN)]

    def receive(self) -> list[Chunk]:
        chunks: list[Chunk] = []
        if self._socket is None:
            return chunks
        for _ in range(_DATAGRAMS):
            try:
                data, peer = self._socket.recvfrom(_DATAGRAM)
            except BlockingIOError:
                break
            except ConnectionError:  # nobody is on the other port yet
                continue
            except OSError as why:
                raise LinkDownError(words(why)) from None
            if self._listens:
                self._meet(peer)
            chunks.append((peer, data))
        return chunks

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
