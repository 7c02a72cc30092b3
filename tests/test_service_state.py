"""The running service is killed in flight, recorded, watched by systemd, and its computer's clock is set."""

from __future__ import annotations

import random
import signal
import socket
import subprocess
import sys
import time
from itertools import pairwise

import pytest
from executive.live import TO_THE_GROUND, config, end, flying, free_port, start

from bhm_service.equipment import recorded_equipment
from bhm_service.flight_recorder import segments_of
from bhm_service.mavlink.log import read_log
from bhm_service.replay import replay
from bhm_service.reporting.played import outgoing_frames


def test_killed_in_flight_it_goes_on_and_its_recordings_give_the_same_bytes(tmp_path):
    port, moments = free_port(), random.Random(4)
    path = config(tmp_path, port)
    runs = []
    with flying(port) as vehicle:
        service, started = start(path), 0.0
        for _ in range(2):
            vehicle.wait_for("BHM_RFT", started, 30.0)
            time.sleep(moments.uniform(3.0, 9.0))
            killed = time.monotonic()
            end(service, signal.SIGKILL)
            runs.append((started, killed))
            before = vehicle.values("BHM_RFT")[-1][1]
            service, started = start(path), killed
            _, after = vehicle.wait_for("BHM_RFT", killed, 20.0)
            assert after == pytest.approx(before, rel=0.05)
        time.sleep(2.0)
        printed = end(service)
        runs.append((started, time.monotonic()))
    assert "went on from what was believed" in printed
    segments = segments_of(tmp_path / "state" / "recordings")
    assert len(segments) == len(runs)
    for segment, (begin, until) in zip(segments, runs, strict=True):
        heard = b"".join(f.raw for when, f in vehicle.heard if begin < when <= until and ours(f))
        said = b"".join(frames(segment))
        # A killed process loses its last second; and before the vehicle had answered nobody heard what was said.
        shorter, longer = sorted((heard, said), key=len)
        assert shorter in longer
        assert len(longer) - len(shorter) < 1000
        assert len(shorter) > 1000


def ours(frame):
    return frame.message_id in TO_THE_GROUND


def frames(segment):
    log = read_log(segment)
    equipment, service = recorded_equipment(log.recorded, str(segment))
    return outgoing_frames(log, replay(log, equipment, service, as_recorded=True))


def words(ear, seconds):
    """What a notification socket hears."""
    heard, until = [], time.monotonic() + seconds
    while (rest := until - time.monotonic()) > 0:
        ear.settimeout(rest)
        try:
            heard.append(ear.recv(500).decode())
        except TimeoutError:
            break
    return heard


def test_systemd_hears_of_progress_only_while_there_is_some(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(str(tmp_path / "notify"))
        service = start(config(tmp_path, free_port()), NOTIFY_SOCKET=str(tmp_path / "notify"))
        running = words(ear, 3.5)
        service.send_signal(signal.SIGSTOP)  # a loop that hangs, as systemd sees it
        words(ear, 0.2)
        hanging = words(ear, 3.0)
        service.send_signal(signal.SIGCONT)
        again = words(ear, 2.5)
        end(service)
        last = words(ear, 0.5)
    assert running[0] == "READY=1"
    assert sum(w.startswith("WATCHDOG=1\nSTATUS=RFT") for w in running) >= 2
    assert hanging == []
    assert any(w.startswith("WATCHDOG=1") for w in again)
    assert last[-1] == "STOPPING=1"


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
        service = subprocess.Popen(
            [sys.executable, "-u", "-c", CLOCK, str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        vehicle.wait_for("BHM_RFT", 0.0, 30.0)
        time.sleep(8.0)
        end(service)
    seconds = vehicle.boot_ms("BHM_RFT")
    assert len(seconds) >= 8
    assert all(0 < b - a < 5000 for a, b in pairwise(seconds))
