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
from bhm_service.mavlink.links import Links
from bhm_service.mavlink.signing import read_key
from bhm_service.messages import (
    BatterySample,
    Event,
    FlightPhase,
    LinkState,
    Message,
    NamedValue,
    RemainingTime,
    StateEstimate,
    StatusText,
    Tick,
)
from bhm_service.reporting.words import duration, number

_TICK_S = 1.0


class Wire:
    """The sink that tells the ground."""

    name = "wire"
    hears = (NamedValue, StatusText)
    says: tuple[type, ...] = ()

    def __init__(self, links: Links) -> None:
        self._links = links

    def on_message(self, message: Message) -> Sequence[Message]:
        if self._links.vehicle is None:
            return []
        if isinstance(message, NamedValue):
            self._links.send(self._links.encoder.named_value(message))
        elif isinstance(message, StatusText):
            for frame in self._links.encoder.status_text(message):
                self._links.send(frame)
        return []


class Screen:
    """The sink that prints a line a second."""

    name = "screen"
    hears = (BatterySample, FlightPhase, StateEstimate, RemainingTime, StatusText, Event, LinkState)
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
        elif isinstance(message, LinkState):
            because = f": {message.because}" if message.because else ""
            self._write(f"         {message.url} {message.status.value}{because}\n")
        elif isinstance(message, StatusText | Event):
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


def run_service(urls: Sequence[str], vehicle: Path, battery: Path | None, service: Path | None) -> int:
    """Run until SIGINT or SIGTERM; returns the exit status. ``urls`` stand in for those of the service file."""
    equipment = equipment_of(vehicle, battery)
    settings = read_service(service)
    link = settings.link
    key = None if link.signing_key is None else read_key(link.signing_key)
    links = Links(urls or link.urls, link.system, link.component, key)
    bus = assemble(equipment, settings, sinks=[Wire(links), Screen(sys.stdout.write)], stopwatch=time.perf_counter)
    stop = _Stop()
    where = ", ".join(urls or link.urls)
    sys.stdout.write(f"{equipment.vehicle.name}, battery {equipment.battery.name}; listening on {where}, Ctrl-C ends\n")
    due = time.monotonic() + _TICK_S
    while not stop.asked:
        for _, message in links.poll(max(due - time.monotonic(), 0.0)):
            bus.publish(message)
        now = time.monotonic()
        if now < due:
            continue
        due = max(due + _TICK_S, now)
        bus.publish(Tick(time_s=now))
        sys.stdout.flush()
    links.close()
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
