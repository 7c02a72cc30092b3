"""What systemd is told: that the service is ready, that it makes progress, that it stops (sd_notify's datagrams)."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping


class Notifier:
    """Sends to NOTIFY_SOCKET; does nothing where systemd did not start the service, and never raises.

    WATCHDOG=1 is sent by the loop itself after each second's work, not by a thread beside it: a loop that hangs in an
    app or in a link stops feeding, and systemd kills and restarts it after WatchdogSec.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        path = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path.startswith("@") else path
        self._socket: socket.socket | None = None
        if path.startswith(("/", "@")):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def ready(self) -> None:
        """The service does its work from now on."""
        self._send("READY=1")

    def progress(self, status: str) -> None:
        """One more second's work is done; ``status`` is what `systemctl status` shows."""
        self._send(f"WATCHDOG=1\nSTATUS={status}")

    def stopping(self) -> None:
        """The service was told to end."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Give the socket back."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, words: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(words.encode(), self._address)
        except OSError:
            return  # systemd's ear is full or gone: nothing that the vehicle should suffer for
