"""The other end of a link, for tests: real sockets and a pseudo terminal, at which an autopilot speaks."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import socket
import time
import tty

from mavlink.frames import Sender, battery_status, heartbeat, system_time

from bhm_service.mavlink.frames import FrameSplitter

PATIENCE_S = 60.0


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class UdpEnd:
    """Sends to a port of ours (udpin), or waits on one (udpout)."""

    def __init__(self, kind):
        self.port = free_port(socket.SOCK_DGRAM)
        self.url = f"{kind}:127.0.0.1:{self.port}"
        self._kind = kind
        self._socket = None
        self._peer = None

    def up(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if self._kind == "udpin":
            self._peer = ("127.0.0.1", self.port)
        else:
            self._socket.bind(("127.0.0.1", self.port))

    def down(self):
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def write(self, data):
        if self._socket is not None and self._peer is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, self._peer)

    def read(self):
        data = b""
        while self._socket is not None:
            try:
                piece, self._peer = self._socket.recvfrom(65535)
            except OSError:
                break
            data += piece
        return data


class TcpEnd:
    """A router that listens (tcp), or an autopilot that connects to us (tcpin)."""

    def __init__(self, kind):
        self.port = free_port()
        self.url = f"{kind}:127.0.0.1:{self.port}"
        self._kind = kind
        self._listener = None
        self._socket = None

    def up(self):
        if self._kind == "tcp":
            self._listener = socket.create_server(("127.0.0.1", self.port))
            self._listener.setblocking(False)

    def down(self):
        for one in (self._socket, self._listener):
            if one is not None:
                one.close()
        self._socket = self._listener = None

    def _connected(self):
        if self._socket is None:
            with contextlib.suppress(OSError):
                if self._kind == "tcp":
                    self._socket = self._listener.accept()[0] if self._listener else None
                else:
                    self._socket = socket.create_connection(("127.0.0.1", self.port), timeout=1.0)
            if self._socket is not None:
                self._socket.setblocking(False)
        return self._socket

    def write(self, data):
        end = self._connected()
        if end is not None:
            with contextlib.suppress(BlockingIOError):
                end.sendall(data)

    def read(self):
        end = self._connected()
        if end is None:
            return b""
        try:
            return end.recv(65535)
        except BlockingIOError:
            return b""


class SerialEnd:
    """The autopilot's end of a pseudo terminal; ``down`` pulls the adapter out, device file and all."""

    def __init__(self, folder):
        self._name = folder / "ttyTEST"
        self.url = f"serial:{self._name}:57600"
        self._main = None

    def up(self):
        self._main, theirs = pty.openpty()
        tty.setraw(self._main)
        os.set_blocking(self._main, False)
        self._name.symlink_to(os.ttyname(theirs))
        os.close(theirs)

    def down(self):
        if self._main is not None:
            self._name.unlink()
            os.close(self._main)
        self._main = None

    def write(self, data):
        if self._main is not None:
            with contextlib.suppress(BlockingIOError):
                os.write(self._main, data)

    def read(self):
        with contextlib.suppress(OSError):
            if self._main is not None and select.select([self._main], [], [], 0)[0]:
                return os.read(self._main, 65535)
        return b""


class Autopilot:
    """Speaks at one end, twenty times faster than a real one, and remembers what it heard."""

    def __init__(self, end, system=1, boot_ms=60_000, damage=lambda frames: b"".join(frames)):
        self.end, self.system, self.boot_ms, self.damage = end, system, boot_ms, damage
        self.send = Sender(system)
        self.heard = []
        self._splitter = FrameSplitter()
        self._due = 0.0

    def messages(self):
        return [heartbeat(), battery_status(), system_time(self.boot_ms)]

    def run(self):
        self.heard += self._splitter.feed(self.end.read())
        now = time.monotonic()
        if now >= self._due:
            self._due = now + 0.05
            self.boot_ms += 50
            self.end.write(self.damage([self.send(message) for message in self.messages()]))


def poll_until(links, done, *autopilots, patience=PATIENCE_S):
    """Let everybody run until ``done(messages so far)``; the messages."""
    said = []
    until = time.monotonic() + patience
    while time.monotonic() < until:
        for autopilot in autopilots:
            autopilot.run()
        said += [message for _, message in links.poll(0.01)]
        if done(said):
            return said
    raise AssertionError(f"nothing came of it in {patience} s; heard {[type(m).__name__ for m in said[-20:]]}")


def count(kind):
    return lambda said, n=5: sum(isinstance(m, kind) for m in said) >= n


def statuses(said, status):
    from bhm_service.messages import LinkState

    return [m for m in said if isinstance(m, LinkState) and m.status is status]
