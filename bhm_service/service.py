"""The live loop: bytes from the link to the bus, what the bus says back to the link, once a second a tick."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

from bhm_service.assembly import assemble
from bhm_service.equipment import equipment_of, read_service
from bhm_service.mavlink.decode import REQUESTED, VehicleDecoder
from bhm_service.mavlink.encode import FrameEncoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.mavlink.link import UdpLink
from bhm_service.messages import (
    BatterySample,
    Event,
    FlightPhase,
    Message,
    NamedValue,
    RemainingTime,
    StateEstimate,
    Tick,
)
from bhm_service.reporting.words import duration, number

_TICK_S = 1.0


class Wire:
    """The sink that tells the ground."""

    name = "wire"
    hears = (NamedValue,)
    says: tuple[type, ...] = ()

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self.encoder: FrameEncoder | None = None  # as soon as the vehicle's system id is known

    def on_message(self, message: Message) -> Sequence[Message]:
        if self.encoder is not None and isinstance(message, NamedValue):
            self._send(self.encoder.named_value(message))
        return []


class Screen:
    """The sink that prints a line a second."""

    name = "screen"
    hears = (BatterySample, FlightPhase, StateEstimate, RemainingTime, Event)
    says: tuple[type, ...] = ()

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._sample: BatterySample | None = None
        self._airborne = False
        self._soc: dict[str, StateEstimate] = {}

    def on_message(self, message: Message) -> Sequence[Message]:
        if isinstance(message, BatterySample):
            self._sample = message
        elif isinstance(message, FlightPhase):
            self._airborne = message.airborne
        elif isinstance(message, StateEstimate):
            self._soc[message.model.value] = message
        elif isinstance(message, Event):
            self._write(f"         {message.text}\n")
        elif isinstance(message, RemainingTime):
            self._write(self._line(message) + "\n")
        return []

    def _line(self, r: RemainingTime) -> str:
        remaining = "RFT     -"
        if r.median_s is not None:
            remaining = f"RFT {duration(r.median_s):>5} ({duration(r.low_s)} to {duration(r.high_s)})"
        models = "  ".join(
            f"{name} {100 * e.soc:.0f} % +-{164.5 * e.soc_sd:.0f}" for name, e in self._soc.items() if e.valid
        )
        sample = self._sample
        measured = "no battery data"
        if sample is not None:
            measured = f"{number(sample.voltage_v, 2)} V {number(sample.current_a, 1)} A"
        where = "flying" if self._airborne else "ground"
        health = ("good", "degraded", "no estimate")[r.health] + (f": {r.because}" if r.because else "")
        return f"{remaining:<30} SoC {models or '-':<32} {measured:<16} {where}  {health}"


def run_service(url: str, vehicle: Path, battery: Path | None, service: Path | None) -> int:
    """Run until SIGINT or SIGTERM; returns the exit status."""
    equipment = equipment_of(vehicle, battery)
    settings = read_service(service)
    link = UdpLink(url)
    wire = Wire(link.send)
    bus = assemble(equipment, settings, sinks=[wire, Screen(sys.stdout.write)], stopwatch=time.perf_counter)
    decoder, splitter = VehicleDecoder(), FrameSplitter()
    stop = _Stop()
    sys.stdout.write(f"{equipment.vehicle.name}, battery {equipment.battery.name}; listening on {url}, Ctrl-C ends\n")
    due = time.monotonic() + _TICK_S
    asked = False
    while not stop.asked:
        for data in link.receive(max(due - time.monotonic(), 0.0)):
            now = time.monotonic()
            for frame in splitter.feed(data):
                for message in decoder.decode(frame.message_id, frame.payload, frame.source, now):
                    bus.publish(message)
        now = time.monotonic()
        if now < due:
            continue
        due = max(due + _TICK_S, now)
        if decoder.system is not None and decoder.component is not None:
            if wire.encoder is None:
                wire.encoder = FrameEncoder(decoder.system)
            link.send(wire.encoder.companion_heartbeat())
            if not asked:
                for message_id in REQUESTED:
                    link.send(wire.encoder.request_interval(decoder.system, decoder.component, message_id, 1.0))
                asked = True
        bus.publish(Tick(time_s=now))
        sys.stdout.flush()
    link.close()
    sys.stdout.write("stopped\n")
    return 0


class _Stop:
    """Set by the first SIGINT or SIGTERM."""

    def __init__(self) -> None:
        self.asked = False
        for number_ in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number_, self._ask)

    def _ask(self, number_: int, frame: FrameType | None) -> None:
        self.asked = True
