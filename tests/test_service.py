"""The service as it runs: a process of its own, a simulated vehicle on a real socket."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time

import pytest

from bhm_service.config import shipped
from bhm_service.mavlink.dialect import mavlink
from bhm_service.mavlink.frames import FrameSplitter
from sim.autopilot import Autopilot
from sim.battery import SimulatedPack
from sim.multirotor import Multirotor, hover_plan

# Never BATTERY_STATUS, which QGroundControl would take for the vehicle's; never COMMAND_ACK for what is everybody's.
OURS = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ, mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
}  # fmt: skip
VEHICLE = str(shipped("vehicles", "quad-4s.toml"))


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def service():
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "bhm_service.cli", "run", "--link", f"udpin:127.0.0.1:{port}",
         "--vehicle", VEHICLE],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert "listening" in process.stdout.readline()
    yield process, port
    if process.poll() is None:
        process.kill()
    process.wait()


def fly(port: int, seconds: int) -> list:
    """Fly for so many real seconds; what came back over the link."""
    vehicle = Multirotor(SimulatedPack(series=4, capacity_ah=5.0, left=0.9), hover_plan(240.0, 300.0, 2.0), 1)
    autopilot, splitter, back = Autopilot(), FrameSplitter(), []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", port))
        link.settimeout(0.05)
        ground = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        for _ in range(seconds):
            command = mavlink.MAVLink_command_long_message(
                1, 0, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 1, 0, 0, 0, 0, 0, 0
            )
            link.send(bytes(command.pack(ground)))
            for frame in autopilot.frames(vehicle.second()):
                link.send(frame)
            until = time.monotonic() + 1.0
            while time.monotonic() < until:
                try:
                    back += splitter.feed(link.recv(65535))
                except TimeoutError:
                    continue
    return back


def test_it_tells_the_vehicle_what_it_knows_and_ends_cleanly(service):
    process, port = service
    back = fly(port, 16)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=10)
    assert process.returncode == 0, err
    assert out.rstrip().endswith("stopped")
    assert "RFT" in out
    assert "flying" in out
    assert {f.source for f in back} == {(1, 191)}
    names = set()
    for frame in back:
        if frame.message_id == mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT:
            names.add(frame.payload[8:18].split(b"\0")[0].decode())
    assert {"BHM_RFT", "BHM_SOC", "BHM_HLTH", "RFT_CIRC", "RFT_CHEM"} <= names
    beats = [f for f in back if f.message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT]
    assert 10 <= len(beats) <= 18
    asked = [f for f in back if f.message_id == mavlink.MAVLINK_MSG_ID_COMMAND_LONG]
    assert len(asked) >= 5
    assert {f.message_id for f in back} <= OURS


def test_it_loads_nothing_that_it_does_not_need_on_a_vehicle():
    """Each of these is between 5 and 45 MB of a small computer's memory."""
    heavy = [
        "scipy.stats",
        "scipy.linalg",
        "scipy.interpolate",
        "scipy.optimize",
        "scipy.special",
        "plotly",
        "jinja2",
        "rich",
    ]
    heavy += ["pymavlink.mavutil", "pymavlink.DFReader"]
    code = f"import sys, bhm_service.service; print([m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_it_ends_cleanly_when_nothing_was_ever_heard(service):
    process, _ = service
    time.sleep(1.5)
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=10)
    assert process.returncode == 0
    assert "no estimate" in out


def test_a_port_that_is_taken_is_one_clear_message():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        link = f"udpin:127.0.0.1:{other.getsockname()[1]}"
        run = subprocess.run(
            [sys.executable, "-m", "bhm_service.cli", "run", "--link", link, "--vehicle", VEHICLE],
            capture_output=True, text=True, timeout=30, check=False,
        )  # fmt: skip
    assert run.returncode == 2
    assert "in use" in run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize(
    "link", ["tcp", "udpin:nowhere", "udpin:127.0.0.1:99999", "serial:/dev/ttyS0", "http:localhost:80"]
)
def test_a_link_that_cannot_be_is_one_clear_message(link):
    run = subprocess.run(
        [sys.executable, "-m", "bhm_service.cli", "run", "--link", link, "--vehicle", VEHICLE],
        capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    assert run.returncode == 2
    assert "udpin:HOST:PORT" in run.stderr
