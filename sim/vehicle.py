"""The simulated vehicle on its links: flies in steps of a tenth of a second, streams, answers, has its faults."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from bhm_service.mavlink.encode import stamped
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.mavlink.transport import LinkDownError, Transport, wait_for
from sim.autopilot import Autopilot
from sim.firmware import Channel, Firmware
from sim.multirotor import STEP_S, Multirotor, State
from sim.trouble import Trouble, Way

_EPOCH_S = 1_750_000_000.0  # stamps of simulated tlogs: always the same
_REOPEN_S = 1.0


@dataclass(slots=True)
class _Port:
    """One link of the vehicle."""

    transport: Transport
    channel: Channel
    out: Way
    splitter: FrameSplitter = field(default_factory=FrameSplitter)
    is_open: bool = False
    retry_s: float = 0.0


class VirtualVehicle:
    """A multirotor, its autopilot and its links. `step` never waits: who calls it decides how fast time goes."""

    def __init__(
        self,
        multirotor: Multirotor,
        firmware: Firmware,
        transports: Sequence[Transport],
        trouble: Trouble | None = None,
        reboots_s: Sequence[float] = (),
        seed: int = 1,
    ) -> None:
        self.multirotor, self.firmware = multirotor, firmware
        self._reboots_s = sorted(reboots_s)
        self._ports = [
            _Port(transport, firmware.channel(), Way(trouble or Trouble(), seed + number))
            for number, transport in enumerate(transports)
        ]

    @property
    def time_s(self) -> float:
        """Simulated time since the vehicle was switched on."""
        return self.multirotor.time_s

    def step(self) -> bool:
        """The next tenth of a second; False when the plan is at its end."""
        if not self.multirotor.step():
            return False
        now = self.time_s
        if self._reboots_s and now >= self._reboots_s[0]:
            self._reboots_s.pop(0)
            self.reboot()
        state = self.multirotor.seen()
        for port in self._ports:
            self._hear(port, now)
            frames = port.out.carry(self.firmware.send_due(port.channel, state), now)
            for frame in frames if port.is_open else ():
                port.transport.send(frame)
        return True

    def reboot(self) -> None:
        """Switch the autopilot off and on; the vehicle, being simulated, stays where it is."""
        self.firmware.reboot(self.multirotor.seen())

    def cut(self, number: int) -> None:
        """One link is cut for good."""
        self._ports[number].transport.close()
        self._ports[number].is_open, self._ports[number].retry_s = False, math.inf

    def fly(self, speed: float, tell: Callable[[State], None]) -> None:
        """The rest of the plan, ``speed`` seconds a second; ``tell`` is called once a simulated second."""
        due = time.monotonic()
        while self.step():
            if self.time_s.is_integer():
                tell(self.multirotor.seen())
            due = max(due + STEP_S / speed, time.monotonic() - 1.0)
            while (left := due - time.monotonic()) > 0.0:
                for transport in wait_for([port.transport for port in self._ports if port.is_open], left):
                    self._hear(next(p for p in self._ports if p.transport is transport), self.time_s)

    def close(self) -> None:
        """Give ports and devices back."""
        for port in self._ports:
            port.transport.close()

    def _hear(self, port: _Port, now: float) -> None:
        try:
            if not port.is_open:
                if now < port.retry_s:
                    return
                port.transport.open()
                port.is_open = True
            chunks = port.transport.receive()
        except LinkDownError:
            port.transport.close()
            port.is_open, port.retry_s = False, now + _REOPEN_S
            return
        for _, data in chunks:
            for frame in port.splitter.feed(data):
                self.firmware.take(port.channel, frame, now)


def tlog(multirotor: Multirotor, autopilot: Autopilot) -> bytes:
    """A whole flight as a telemetry log."""
    out = bytearray()
    while (state := multirotor.second()) is not None:
        for frame in autopilot.frames(state):
            out += stamped(_EPOCH_S + state.time_s, frame)
    return bytes(out)
