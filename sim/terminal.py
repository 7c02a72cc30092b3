"""A serial port that is not there: a pseudo terminal, under a name of its own."""

from __future__ import annotations

import contextlib
import os
import pty
import tty
from pathlib import Path

from bhm_service.mavlink.transport import LinkDownError, LinkUrl, StreamTransport


class TerminalTransport(StreamTransport):
    """The autopilot's end; ``url.target`` becomes the device that a service opens."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._main: int | None = None

    def open(self) -> None:
        path = Path(self.url.target)
        if path.is_symlink():
            path.unlink()
        if path.exists():
            raise LinkDownError(f"{path} is something else already")
        self._main, device = pty.openpty()
        tty.setraw(device)
        os.set_blocking(self._main, False)
        path.symlink_to(os.ttyname(device))
        self._device = device  # kept open: without any reader the terminal would be hung up

    def _descriptor(self) -> int | None:
        return self._main

    def close(self) -> None:
        super().close()
        if self._main is not None:
            with contextlib.suppress(OSError):
                Path(self.url.target).unlink()
            os.close(self._main)
            os.close(self._device)
        self._main = None
