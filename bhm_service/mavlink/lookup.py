"""Where a host is, without making the loop wait: name servers that are not there take half a minute to say so."""

from __future__ import annotations

import socket
import threading
from typing import Any

_PATIENCE_S = 0.2  # numbers, localhost and /etc/hosts answer at once


class LookupFailedError(Exception):
    """The host is not known, or not yet."""


class Lookup:
    """The address of one host and port, looked up anew each time that a link opens: it may have moved."""

    def __init__(self, host: str, port: int, kind: int) -> None:
        self._host, self._port, self._kind = host, port, kind
        self._thread: threading.Thread | None = None
        self._found: Any = None
        self._turn = -1  # a host may have several addresses, of which not all answer

    def address(self) -> tuple[int, Any]:
        """Address family and address. Raises LookupFailedError, also while it is being looked up: ask again later."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._look, daemon=True)
            self._thread.start()
        self._thread.join(_PATIENCE_S)
        if self._thread.is_alive():
            raise LookupFailedError(f"host {self._host!r} is being looked up")
        self._thread = None
        if isinstance(self._found, OSError):
            raise LookupFailedError(f"host {self._host!r} is not known: {self._found.strerror}")
        self._turn += 1
        family, _, _, _, address = self._found[self._turn % len(self._found)]
        return family, address

    def _look(self) -> None:
        try:
            self._found = socket.getaddrinfo(self._host, self._port, type=self._kind)
        except OSError as why:
            self._found = why
