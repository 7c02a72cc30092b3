"""The running service is killed in flight, recorded, watched by systemd, and its computer's clock is set."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import time
from contextlib import closing, suppress
from itertools import pairwise
from pathlib import Path

import pytest
from executive.flight import Notebook, quad
from executive.live import TO_THE_GROUND, config, end, flying, free_port, start

from bhm_service.assembly import assemble
from bhm_service.config import Service
from bhm_service.equipment import recorded_equipment
from bhm_service.flight_recorder import segments_of
from bhm_service.mavlink.log import read_log
from bhm_service.messages import Event, NamedValue
from bhm_service.replay import replay
from bhm_service.reporting.played import outgoing_frames

PATIENCE_S = 240.0  # with a machine that has other things to do


def test_killed_in_flight_it_goes_on_and_its_recordings_give_the_same_bytes(tmp_path):
    port, moments = free_port(), random.Random(4)
    path = config(tmp_path, port)
    with flying(port, flight_s=900.0) as vehicle:
        service, started = start(path), 0.0
        for _ in range(2):
            vehicle.wait_for("BHM_RFT", started, PATIENCE_S)
            time.sleep(moments.uniform(3.0, 9.0))
            end(service, signal.SIGKILL)
            service, started = start(path), time.monotonic()
        vehicle.wait_for("BHM_RFT", started, PATIENCE_S)
        time.sleep(2.0)
        printed = end(service)
    assert "went on from what was believed" in printed
    segments = segments_of(tmp_path / "state" / "recordings")
    assert len(segments) == 3
    heard, at = b"".join(f.raw for _, f in vehicle.heard if f.message_id in TO_THE_GROUND), 0
    for segment in segments:
        said = b"".join(frames(segment))
        found = heard.find(said, at)
        assert 0 <= found - at < 1000, "only a killed process's last second may be missing"
        at = found + len(said)
        assert said
    assert at == len(heard)
    spared = remaining(undisturbed(segments))
    killed = remaining(m for segment in segments[1:] for m in read_log(segment).recorded.said)
    assert len(killed) >= 2
    for moment, value in killed.items():
        assert value == pytest.approx(spared[moment], rel=0.05)


def frames(segment):
    log = read_log(segment)
    equipment, service = recorded_equipment(log.recorded, str(segment))
    return outgoing_frames(log, replay(log, equipment, service, as_recorded=True))


def undisturbed(segments):
    """What one service says that hears all of this and is never killed."""
    sink = Notebook(NamedValue)
    bus = assemble(quad(), Service(), [sink])
    for segment in segments:
        for message in read_log(segment).recorded.messages:
            if not isinstance(message, Event):
                bus.publish(message)
    return sink.heard


def remaining(said):
    """Remaining time by the moment that it was said."""
    return {m.time_s: m.value for m in said if isinstance(m, NamedValue) and m.name == "BHM_RFT"}


class Ear:
    """A notification socket, as systemd has one."""

    def __init__(self, folder):
        self.path = str(folder / "notify")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self.path)

    def until(self, word):
        """All that comes up to and with a word."""
        heard = []
        self._socket.settimeout(PATIENCE_S)
        while not heard or not heard[-1].startswith(word):
            heard.append(self._socket.recv(500).decode())
        return heard

    def within(self, seconds):
        """Whatever comes in that time."""
        heard, until = [], time.monotonic() + seconds
        while (rest := until - time.monotonic()) > 0:
            self._socket.settimeout(rest)
            with suppress(TimeoutError):
                heard.append(self._socket.recv(500).decode())
        return heard

    def close(self):
        self._socket.close()


def test_systemd_hears_of_progress_only_while_there_is_some(tmp_path):
    with closing(Ear(tmp_path)) as ear:
        service = start(config(tmp_path, free_port()), NOTIFY_SOCKET=ear.path)
        assert ear.until("WATCHDOG=1\nSTATUS=RFT")[0] == "READY=1"
        ear.until("WATCHDOG=1\nSTATUS=RFT")
        service.send_signal(signal.SIGSTOP)  # a loop that hangs, as systemd sees it
        ear.within(0.2)
        assert ear.within(2.5) == []
        service.send_signal(signal.SIGCONT)
        ear.until("WATCHDOG=1")
        end(service)
        assert ear.until("STOPPING=1")
        assert ear.within(0.1) == []


MUTE = """
import sys
from bhm_service.service import Wire
Wire.on_message = lambda self, message: 1 / 0
from bhm_service.cli import main
sys.argv = ["bhm", "run", "--config", sys.argv[1]]
main()
"""


def test_a_service_that_cannot_speak_any_more_is_left_to_the_watchdog(tmp_path):
    with closing(Ear(tmp_path)) as ear:
        service = start(config(tmp_path, free_port()), program=("-c", MUTE), NOTIFY_SOCKET=ear.path)
        ear.until("READY=1")
        assert len(ear.within(4.0)) <= 1
        assert "wire failed twice within a minute and stays down" in end(service)
        assert ear.until("STOPPING=1") == ["STOPPING=1"]


def test_a_full_disk_behind_what_is_printed_costs_only_the_words(tmp_path):
    port = free_port()
    with flying(port, speed=4.0) as vehicle, Path("/dev/full").open("w") as full:
        service = subprocess.Popen(
            [sys.executable, "-u", "-m", "bhm_service.cli", "run", "--config", str(config(tmp_path, port))],
            stdout=full, stderr=subprocess.PIPE, text=True, env={**os.environ, "STATE_DIRECTORY": str(tmp_path)},
        )  # fmt: skip
        vehicle.wait_for("BHM_RFT", 0.0, PATIENCE_S)
        end(service)
    assert service.returncode == 0


def test_a_port_that_is_taken_when_the_computer_starts_is_waited_for(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        service = start(config(tmp_path, port))
        time.sleep(1.0)
    with flying(port, speed=4.0) as vehicle:
        vehicle.wait_for("BHM_RFT", 0.0, PATIENCE_S)
        assert "address already in use: is another program on this port?" in end(service)


CLOCK = """
import sys, time
real, begin = time.time, time.monotonic()
time.time = lambda: real() + (-86400.0, 0.0, 3e8)[int((time.monotonic() - begin) / 2.0) % 3]
from bhm_service.cli import main
sys.argv = ["bhm", "run", "--config", sys.argv[1]]
main()
"""


def test_a_computer_whose_clock_is_set_back_and_forth_by_days_misses_no_second(tmp_path):
    port = free_port()
    path = config(tmp_path, port)
    with flying(port) as vehicle:
        service = start(path, program=("-c", CLOCK))
        first, _ = vehicle.wait_for("BHM_RFT", 0.0, PATIENCE_S)
        vehicle.wait_for("BHM_RFT", first + 8.0, PATIENCE_S)
        end(service)
    seconds = vehicle.boot_ms("BHM_RFT")
    assert len(seconds) >= 8
    assert all(0 < b - a < 5000 for a, b in pairwise(seconds))
