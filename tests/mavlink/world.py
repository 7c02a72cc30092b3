"""A simulated vehicle and our links over a real socket or terminal, one after the other in simulated time."""

from __future__ import annotations

import socket
import time

from mavlink.wire import PATIENCE_S, free_port

from bhm_service.mavlink.links import Links
from bhm_service.mavlink.transport import LinkUrl
from bhm_service.mavlink.transports import transport_of
from sim.command import Options, vehicle_of
from sim.terminal import TerminalTransport

_OTHER_END = {"udpin": "udpout", "udpout": "udpin", "tcp": "tcpin", "tcpin": "tcp", "serial": "serial"}


class Counted:
    """A transport whose bytes are counted, so that simulated time can wait until the kernel has delivered them."""

    def __init__(self, transport):
        self._transport, self._kept = transport, []
        self.sent = self.arrived = 0

    def __getattr__(self, name):
        return getattr(self._transport, name)

    def send(self, data):
        self.sent += len(data) if self._transport.ready else 0
        self._transport.send(data)

    def pump(self):
        """Send what waits, take what has come."""
        chunks = self._transport.receive()
        self.arrived += sum(len(data) for _, data in chunks)
        self._kept += chunks

    def receive(self):
        self.pump()
        kept, self._kept = self._kept, []
        return kept


class World:
    """``kind`` is that of our link; the vehicle has the other end."""

    def __init__(self, settings=(), kind="udpin", folder=None, **options):
        self._is_stream = kind in ("tcp", "tcpin", "serial")
        self.port = free_port(socket.SOCK_STREAM if self._is_stream else socket.SOCK_DGRAM)
        place = f"{folder}/tty:57600" if kind == "serial" else f"127.0.0.1:{self.port}"
        url = LinkUrl.parse(f"{_OTHER_END[kind]}:{place}")
        self._theirs = Counted(TerminalTransport(url) if kind == "serial" else transport_of(url))
        self.vehicle = vehicle_of(Options(charge=0.9, flight=1200.0, **options), [self._theirs])
        self.clock_s = 0.0
        self.links = Links([f"{kind}:{place}"], settings=settings, clock=lambda: self.clock_s)
        (link,) = self.links._links
        self._ours = link.transport = Counted(link.transport)
        self.said = []

    def run(self, seconds, others=()):
        """Messages of that time."""
        said = []
        for _ in range(round(seconds * 10)):
            assert self.vehicle.step()
            for other in others:
                other()
            self.clock_s = self.vehicle.time_s
            said += self._settled()
        self.said += said
        return said

    def _settled(self):
        """Messages, when all bytes are where they belong; datagrams are there at once, or have nobody to go to."""
        said, until = [], time.monotonic() + PATIENCE_S
        while True:
            while found := self.links.poll(0.0):
                said += [message for _, message in found]
            if not self._is_stream:
                return said
            self._theirs.pump()
            if self._ours.arrived == self._theirs.sent and self._theirs.arrived == self._ours.sent:
                return said
            assert time.monotonic() < until, "bytes were lost on the way"
            time.sleep(1e-4)

    def send(self, data):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.sendto(data, ("127.0.0.1", self.port))

    def close(self):
        self.vehicle.close()
        self.links.close()
