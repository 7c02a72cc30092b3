"""A link to an autopilot. So far UDP; serial and TCP join with the onboard service."""

from __future__ import annotations

import select
import socket
import time
from typing import TypeAlias

from bhm_service.errors import BadInputError

Address: TypeAlias = tuple[str, int]
_FORGET_PEER_S = 30.0
_DATAGRAM = 65535


class UdpLink:
    """Datagrams from and to an autopilot or a router.

    ``udpin`` waits on a port and answers whoever has lately sent there; ``udpout`` sends to an address.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        kind, host, port = _parsed(url)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._fixed: Address | None = None
        self._peers: dict[Address, float] = {}
        try:
            if kind == "udpin":
                self._socket.bind((host, port))
            else:
                self._fixed = (socket.gethostbyname(host), port)
        except OSError as why:
            self._socket.close()
            raise BadInputError(f"link {url}", why.strerror or str(why), "is another program on this port?") from None

    def receive(self, timeout_s: float) -> list[bytes]:
        """Datagrams that have come, after waiting at most ``timeout_s`` for the first."""
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return []
        found: list[bytes] = []
        while True:
            try:
                data, peer = self._socket.recvfrom(_DATAGRAM)
            except (BlockingIOError, ConnectionError):
                return found
            self._peers[peer] = time.monotonic()
            found.append(data)

    def send(self, data: bytes) -> None:
        """Send to the address, or to everybody heard lately; what cannot be delivered is lost, as UDP is."""
        now = time.monotonic()
        self._peers = {peer: seen for peer, seen in self._peers.items() if now - seen < _FORGET_PEER_S}
        for peer in [self._fixed] if self._fixed is not None else list(self._peers):
            try:
                self._socket.sendto(data, peer)
            except OSError:
                continue

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()


def _parsed(url: str) -> tuple[str, str, int]:
    kind, _, rest = url.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in ("udpin", "udpout") or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise BadInputError(f"link {url!r}", "must be udpin:HOST:PORT or udpout:HOST:PORT")
    return kind, host, int(port)
