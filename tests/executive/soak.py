"""Hours of flights, one after the other and as fast as they go: real links and files, simulated time, faults."""

from __future__ import annotations

import gc
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from executive.flight import Notebook, quad
from executive.live import free_port

from bhm_service.apps.recorder import RecorderApp
from bhm_service.assembly import assemble
from bhm_service.checkpoint import CheckpointFile
from bhm_service.config import Service
from bhm_service.flight_recorder import Segments
from bhm_service.mavlink.dialect import mavlink, unpack
from bhm_service.mavlink.frames import WireFrame
from bhm_service.mavlink.links import Links
from bhm_service.mavlink.transport import LinkUrl
from bhm_service.mavlink.transports import transport_of
from bhm_service.messages import Event
from bhm_service.resumption import Run
from bhm_service.service import Wire
from bhm_service.session import Memory, Recording, Session
from sim.ardupilot import ArduPilot
from sim.battery import SimulatedPack
from sim.multirotor import Multirotor, Phase, Wind, hover_plan
from sim.trouble import Trouble
from sim.vehicle import VirtualVehicle

_FIRST_S = 20.0  # after switching on: rates are asked for
_FLOWN_S = 15.0  # before some seconds of flight no load is known
_AFTER_S = 6.0  # after an outage
_LASTS_S = 10.0  # an outage shorter than this is bridged
_FAULTY = ("reader", "estimator-circ", "estimator-chem", "predictor", "publisher", "limits", "housekeeping")


@dataclass
class Result:
    """What was counted."""

    seconds: int = 0
    excused: int = 0  # seconds of injected outages, in flight
    flying: int = 0
    missed_health: list[float] = field(default_factory=list)
    missed_rft: list[float] = field(default_factory=list)
    memory_kb: list[int] = field(default_factory=list)  # after every hour
    events: Counter[str] = field(default_factory=Counter)
    faults: int = 0
    flights: int = 0
    files_kb: int = 0

    @property
    def growth_kb(self) -> int:
        """After the first hour."""
        return max(self.memory_kb[1:], default=self.memory_kb[0]) - self.memory_kb[0]


class Listening(ArduPilot):
    """An autopilot that notes the names of the values that it hears, with its own time."""

    heard: dict[str, set[int]]

    def hears(self, frame: WireFrame, now_s: float) -> None:
        if frame.message_id == mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT:
            name = unpack(frame.message_id, frame.payload)["name"].split(b"\0")[0].decode()
            self.heard.setdefault(name, set()).add(round(now_s))


def resident_kb() -> int:
    gc.collect()
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))


def soak(folder: Path, hours: float, seed: int, tell: Callable[[str], None] = lambda words: None) -> Result:
    """Fly for so many simulated hours; packs are swapped between flights with the vehicle off."""
    chance, result, port = random.Random(seed), Result(), free_port()
    now = 1000.0
    links = Links([f"udpin:127.0.0.1:{port}"], clock=lambda: now, wall=lambda: 1.8e9 + now)
    segments = Segments(folder / "recordings", 8_000_000)
    events = Notebook(Event)
    equipment = quad()
    bus = assemble(equipment, Service(), [Wire(links, segments.add), events, RecorderApp(segments.add)])
    run = Run(version="1", belongs_to="", host_boot="b", battery_id=0, max_age_s=120.0)
    head = {"vehicle": equipment.vehicle.model_dump(mode="json"), "battery": equipment.battery_text, "service": {}}
    session = Session(bus, Memory(run, CheckpointFile(folder / "checkpoint")), Recording(segments, head), now)
    end, hour = now + 3600.0 * hours, now + 3600.0
    while now < end:
        result.flights += 1
        flight_s = chance.uniform(200.0, 800.0)
        plan = (*hover_plan(240.0, flight_s, chance.uniform(5.0, 60.0)), Phase(chance.uniform(5.0, 200.0), 0.0))
        outages = [(chance.uniform(30.0, flight_s), chance.uniform(2.0, 60.0)) for _ in range(chance.randrange(3))]
        reboots = [chance.uniform(60.0, flight_s)] if chance.random() < 0.2 else []
        trouble = Trouble(
            loss=chance.choice([0.0, 0.0, 0.1, 0.3]), double=0.05, overtake=0.05, garbage=0.02,
            silences=tuple(outages),
        )  # fmt: skip
        pack = SimulatedPack(4, 5.0 * chance.uniform(0.9, 1.02), left=chance.uniform(0.9, 1.0))
        rotors = Multirotor(pack, plan, chance.randrange(10**6), wind=Wind(chance.uniform(0.0, 8.0), gust_mps=1.0))
        firmware = Listening(plan, 4, 5.0)
        firmware.heard = {}
        vehicle = VirtualVehicle(
            rotors,
            firmware,
            [transport_of(LinkUrl.parse(f"udpout:127.0.0.1:{port}"))],
            trouble,
            reboots,
            result.flights,
        )
        faults = {round(chance.uniform(30.0, flight_s)): chance.choice(_FAULTY)} if chance.random() < 0.5 else {}
        begin, flies = now, set()
        while vehicle.step():
            now = begin + vehicle.time_s
            for _, message in links.poll(0.0):
                session.take(message)
            if not vehicle.time_s.is_integer():
                continue
            second = round(vehicle.time_s)
            if second in faults:
                _break(bus, faults[second])
                result.faults += 1
            session.tick(now)
            result.seconds += 1
            if rotors.seen().airborne:
                flies.add(second)
        vehicle.close()
        _count(result, firmware.heard, flies, [*outages, *((at, 3.0) for at in reboots)], set(faults), begin)
        for event in events.heard:
            result.events[event.code.name] += 1
        events.heard.clear()
        if now >= hour:
            hour += 3600.0
            result.memory_kb.append(resident_kb())
            so_far, missed = (now - 1000.0) / 3600.0, len(result.missed_rft)
            tell(f"{so_far:.1f} h, {result.memory_kb[-1] / 1024:.2f} MB, missed {missed} s")
    session.close(now)
    links.close()
    result.files_kb = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) // 1024
    return result


def _break(bus, name):
    broken = next(app for app in bus.apps if app.name == name)._app

    def on_message(message):
        del broken.on_message
        raise ArithmeticError("on purpose")

    broken.on_message = on_message


def _count(result, heard, flies, outages, faults, begin):
    """Seconds in which the vehicle heard nothing: of the health at any time, of the flying time in flight."""
    excused = {s for fault in faults for s in range(fault - 1, fault + 3)}
    long_ = {s for at, span in outages for s in range(int(at + min(span, _LASTS_S)), int(at + span + _AFTER_S) + 1)}
    reboot = {s for at, span in outages if span == 3.0 for s in range(int(at) - 1, int(at) + 9)}
    result.flying += len(flies)
    result.excused += len(flies & (excused | long_ | reboot))
    for second in sorted(flies):
        if second < _FIRST_S or second in excused:
            continue
        if second not in reboot and not {second, second + 1} & heard.get("BHM_HLTH", set()):
            result.missed_health.append(begin + second)
        known = second not in long_ | reboot and second - min(flies) > _FLOWN_S
        if known and not {second, second + 1} & heard.get("BHM_RFT", set()):
            result.missed_rft.append(begin + second)
