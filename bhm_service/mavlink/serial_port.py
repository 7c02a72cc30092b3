"""A serial port: a UART, or an adapter that may be pulled out and put back."""

from __future__ import annotations

import contextlib
import errno
import os
import termios
from pathlib import Path
from typing import Any

from bhm_service.mavlink.transport import LinkDownError, LinkUrl, StreamTransport


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


def _serial_words(why: Exception) -> str:
    number = getattr(why, "errno", None)
    if number == errno.EACCES:
        return "permission denied: add the user to the group of the device (dialout on Debian)"
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return "another program has this port open"
    return str(why)
