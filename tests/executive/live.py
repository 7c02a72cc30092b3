"""The service as a process of its own beside a simulated vehicle on a real socket, to be killed and started again."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bhm_service.config import shipped
from bhm_service.mavlink.dialect import mavlink, unpack
from bhm_service.mavlink.frames import FrameSplitter, WireFrame
from sim.autopilot import Autopilot
from sim.battery import SimulatedPack
from sim.multirotor import Multirotor, hover_plan

TO_THE_GROUND = (mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT, mavlink.MAVLINK_MSG_ID_STATUSTEXT)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class _Ear:
    """One UDP link of the vehicle."""

    def __init__(self, port: int, heard: list[tuple[float, WireFrame]]) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.connect(("127.0.0.1", port))
        self._splitter, self._heard = FrameSplitter(), heard

    def send(self, frame: bytes) -> None:
        with suppress(ConnectionError):  # nobody is on the other port now
            self.socket.send(frame)

    def hear(self) -> None:
        with suppress(ConnectionError):
            self._heard += [(time.monotonic(), f) for f in self._splitter.feed(self.socket.recv(65535))]


@dataclass
class Vehicle:
    """Flies in a thread of its own, ``speed`` seconds a second, whether or not anybody listens."""

    port: int
    flight_s: float = 300.0
    left: float = 0.9
    ground_s: float = 2.0  # before take-off
    beside: int | None = None  # another service's port, which gets the same
    speed: float = 1.0
    heard: list[tuple[float, WireFrame]] = field(default_factory=list)
    heard_beside: list[tuple[float, WireFrame]] = field(default_factory=list)
    flown_s: float = 0.0

    def __post_init__(self) -> None:
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._end.set()
        self._thread.join()

    def _fly(self) -> None:
        vehicle = Multirotor(SimulatedPack(4, 5.0, left=self.left), hover_plan(240.0, self.flight_s, self.ground_s), 1)
        autopilot = Autopilot()
        links = [_Ear(self.port, self.heard)]
        if self.beside is not None:
            links.append(_Ear(self.beside, self.heard_beside))
        due = time.monotonic()
        while not self._end.is_set() and (state := vehicle.second()) is not None:
            self.flown_s = state.time_s
            for frame in autopilot.frames(state):
                for link in links:
                    link.send(frame)
            due += 1.0 / self.speed
            while not self._end.is_set() and (rest := due - time.monotonic()) > 0.0:
                for ready in select.select([link.socket for link in links], [], [], min(rest, 0.1))[0]:
                    next(link for link in links if link.socket is ready).hear()
        for link in links:
            link.socket.close()

    def named(self, name: str, beside: bool = False) -> list[tuple[float, dict[str, Any]]]:
        """When each value of a name came, and its fields."""
        found = []
        for when, frame in list(self.heard_beside if beside else self.heard):
            if frame.message_id == mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT:
                fields = unpack(frame.message_id, frame.payload)
                if fields["name"].split(b"\0")[0].decode() == name:
                    found.append((when, fields))
        return found

    def values(self, name: str) -> list[tuple[float, float]]:
        """When each value of a name came, and what it was."""
        return [(when, fields["value"]) for when, fields in self.named(name)]

    def boot_ms(self, name: str) -> list[int]:
        """Of which moment of the autopilot's clock each value of a name is."""
        return [fields["time_boot_ms"] for _, fields in self.named(name)]

    def wait_for(self, name: str, since: float, timeout_s: float) -> tuple[float, float]:
        """The first value of a name after a moment."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            for when, value in self.values(name):
                if when > since:
                    return when, value
            time.sleep(0.02)
        raise AssertionError(f"no {name} within {timeout_s} s; {self.flown_s:.0f} s flown")


def config(folder: Path, port: int) -> Path:
    """A service file for the simulated vehicle; what is kept lies beside it."""
    path = folder / "service.toml"
    path.write_text(
        f'vehicle = "{shipped("vehicles", "quad-4s.toml")}"\n[link]\nurls = ["udpin:127.0.0.1:{port}"]\n',
        encoding="utf-8",
    )
    return path


def as_the_unit_does() -> list[str]:
    """The unit's Nice=-5, where this user may ask for it."""
    nice = ["nice", "-n", "-5"]
    run = subprocess.run([*nice, "true"], capture_output=True, check=False)
    return nice if run.returncode == 0 and not run.stderr else []


def start(
    config_: Path,
    before: Sequence[str] = (),
    program: Sequence[str] = ("-m", "bhm_service.cli", "run", "--config"),
    **environment: str,
) -> subprocess.Popen[str]:
    """Start the service; it listens when this returns."""
    process = subprocess.Popen(
        [*before, sys.executable, "-u", *program, str(config_)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "STATE_DIRECTORY": str(config_.parent / "state"), **environment},
    )  # fmt: skip
    assert process.stdout is not None
    assert "listening" in process.stdout.readline()
    return process


def end(process: subprocess.Popen[str], number: int = signal.SIGTERM) -> str:
    """End the service; what it printed."""
    process.send_signal(number)
    out, err = process.communicate(timeout=120)
    assert "Traceback" not in err
    return out


@contextmanager
def flying(port: int, **how: Any) -> Iterator[Vehicle]:
    vehicle = Vehicle(port, **how)
    try:
        yield vehicle
    finally:
        vehicle.close()
