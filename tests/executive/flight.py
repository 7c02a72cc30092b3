"""A simulated flight through the real wiring, second by second and without waiting for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from bhm_service.assembly import Equipment, assemble
from bhm_service.bus import App, Bus
from bhm_service.config import Service, shipped
from bhm_service.equipment import equipment_of
from bhm_service.mavlink.decode import VehicleDecoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.messages import Message, Tick
from sim.autopilot import Autopilot
from sim.battery import SimulatedPack
from sim.multirotor import Multirotor, hover_plan


def quad() -> Equipment:
    """The vehicle that the simulation is of."""
    return equipment_of(shipped("vehicles", "quad-4s.toml"), None)


def seconds(
    flight_s: float = 600.0, left: float = 0.9, seed: int = 1, begin_s: float = 1000.0
) -> Iterator[list[Message]]:
    """What an autopilot says in each second, and a Tick at its end."""
    vehicle = Multirotor(SimulatedPack(series=4, capacity_ah=5.0, left=left), hover_plan(240.0, flight_s), seed)
    autopilot, splitter, decoder = Autopilot(), FrameSplitter(), VehicleDecoder()
    while (state := vehicle.second()) is not None:
        now = begin_s + state.time_s
        said: list[Message] = []
        for frame in splitter.feed(b"".join(autopilot.frames(state))):
            said += decoder.decode(frame.message_id, frame.payload, frame.source, now)
        yield [*said, Tick(time_s=now + 0.5)]


class Notebook:
    """A sink that keeps what it hears of some kinds."""

    name = "notebook"
    says: tuple[type, ...] = ()

    def __init__(self, *hears: type) -> None:
        self.hears = hears
        self.heard: list[Message] = []

    def on_message(self, message: Message) -> list[Message]:
        self.heard.append(message)
        return []


def flying_bus(seconds_: Iterable[list[Message]] | None = None, *, seconds: int = 60, sinks: Iterable[App] = ()) -> Bus:
    """A bus after so many seconds of flight."""
    bus = assemble(quad(), Service(), sinks)
    play(bus, seconds_ if seconds_ is not None else _first(seconds))
    return bus


def _first(count: int) -> Iterator[list[Message]]:
    for k, messages in enumerate(seconds()):
        if k == count:
            return
        yield messages


def play(bus: Bus, flight: Iterable[list[Message]], before: Callable[[int], None] | None = None) -> None:
    """Everything of a flight onto a bus."""
    for k, messages in enumerate(flight):
        if before is not None:
            before(k)
        for message in messages:
            bus.publish(message)
