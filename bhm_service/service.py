"""The live loop: messages from the links to the apps, what they say back to the links, once a second a tick."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import Any

from bhm_service.apps.recorder import RecorderApp
from bhm_service.assembly import Equipment, assemble
from bhm_service.bus import App
from bhm_service.checkpoint import CheckpointFile, host_boot, state_folder
from bhm_service.config import Service
from bhm_service.equipment import configured
from bhm_service.flight_recorder import Segments
from bhm_service.mavlink.links import Links
from bhm_service.mavlink.signing import read_key
from bhm_service.messages import Message, NamedValue, StatusText
from bhm_service.reporting.screen import Screen
from bhm_service.resumption import Run
from bhm_service.session import Memory, Recording, Session
from bhm_service.standing import StandingFile
from bhm_service.telemetry import options_parameter
from bhm_service.watchdog import Notifier

_TICK_S = 1.0


class Wire:
    """The sink that tells the ground; ``note`` is told each time with whose frames they were and their first number."""

    name = "wire"
    hears = (NamedValue, StatusText)
    says: tuple[type, ...] = ()

    def __init__(self, links: Links, note: Callable[[str, Any], None]) -> None:
        self._links, self._note = links, note

    def on_message(self, message: Message) -> Sequence[Message]:
        encoder = self._links.encoder
        if self._links.vehicle is None:
            self._note("sent", None)
            return []
        self._note("sent", [encoder.system, encoder.component, encoder.sequence])
        for frame in encoder.frames(message):
            self._links.send(frame)
        return []


def run_service(urls: Sequence[str], config: Path | None, vehicle: Path | None, battery: Path | None) -> int:
    """Run until SIGINT or SIGTERM; returns the exit status. What is given stands in for the service file's own."""
    equipment, settings = configured(config, vehicle, battery)
    link = settings.link
    key = None if link.signing_key is None else read_key(link.signing_key)
    settings_asked = (options_parameter(equipment.vehicle.battery.id),)
    # With a service file nobody may be there to read that a port is taken or an address not there yet: wait for it.
    patient = config is not None
    links = Links(urls or link.urls, link.system, link.component, key, settings_asked, patient)
    screen = Screen(_print, every_second="JOURNAL_STREAM" not in os.environ)
    where = ", ".join(urls or link.urls)
    _print(f"{equipment.vehicle.name}, battery {equipment.battery.name}; listening on {where}, Ctrl-C ends\n")
    for remark in equipment.remarks:
        _print(f"{remark}\n")
    stop, notifier = _Stop(), Notifier()
    session = _session(equipment, settings, links, screen, None if config is None else state_folder(os.environ))
    notifier.ready()
    due = time.monotonic() + _TICK_S
    while not stop.asked:
        for _, message in links.poll(max(due - time.monotonic(), 0.0)):
            if session.take(message):
                due = time.monotonic()  # the pilot waits for nothing more
        now = time.monotonic()
        if now < due:
            continue
        due = max(due + _TICK_S, now)
        session.tick(now)
        if not session.bus.counters[Wire.name].down:  # a service that is mute for good is of no use: systemd's turn
            notifier.progress(screen.line)
    notifier.stopping()
    session.close(time.monotonic())
    links.close()
    notifier.close()
    _print("stopped\n")
    return 0


def _print(text: str) -> None:
    """Nobody in the air reads this: a full disk or a closed pipe behind it costs nothing but the words."""
    with contextlib.suppress(OSError):
        sys.stdout.write(text)
        sys.stdout.flush()


def _session(equipment: Equipment, settings: Service, links: Links, screen: Screen, folder: Path | None) -> Session:
    """The apps with what they keep under ``folder``; without one nothing is kept."""
    memory = recording = segments = None
    recorder, checkpoint = settings.recorder, settings.checkpoint
    sinks: list[App] = [Wire(links, lambda kind, data: None), screen]
    if folder is not None and recorder.folder is not None:
        segments = Segments(folder / recorder.folder, round(recorder.size_mb * 1e6))
        recording = Recording(segments, _head(equipment, settings))
        sinks = [Wire(links, segments.add), screen, RecorderApp(segments.add)]
    standing = None
    if folder is not None and equipment.shadow is not None:
        kept = StandingFile(folder / "standing.json", equipment.fingerprint(settings))
        standing = kept.read()
        sinks.append(kept)
    if folder is not None and checkpoint.file is not None:
        run = Run(
            version=version("bhm-service"),
            belongs_to=equipment.fingerprint(settings),
            host_boot=host_boot(),
            battery_id=equipment.vehicle.battery.id,
            max_age_s=checkpoint.max_age_s,
        )
        memory = Memory(run, CheckpointFile(folder / checkpoint.file))
    bus = assemble(equipment, settings, sinks, time.perf_counter, standing)
    return Session(bus, memory, recording, time.monotonic())


def _head(equipment: Equipment, settings: Service) -> dict[str, Any]:
    """All that a replay of the recording needs."""
    return {
        "version": version("bhm-service"),
        "unix_s": time.time(),
        "vehicle": equipment.vehicle.model_dump(mode="json"),
        "battery": equipment.battery_text,
        "shadow": None if equipment.shadow is None else equipment.shadow.battery_text,
        "service": settings.model_dump(mode="json"),
    }


class _Stop:
    """Set by the first SIGINT or SIGTERM."""

    def __init__(self) -> None:
        self.asked = False
        for number_ in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number_, self._ask)

    def _ask(self, number_: int, frame: FrameType | None) -> None:
        self.asked = True
