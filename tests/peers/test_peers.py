"""Peers that are not ours: MAVProxy and MAVSDK hear what we say, and MAVSDK plays an autopilot for us."""

from __future__ import annotations

import importlib.util
import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mavlink.wire import free_port

from bhm_service.config import shipped
from bhm_service.mavlink.dialect import mavlink, unpack
from bhm_service.mavlink.tlog import TlogReader

HERE = Path(__file__).parent
NAMES = {"BHM_RFT", "BHM_RFTLO", "BHM_RFTHI", "BHM_SOC", "BHM_SOE", "RFT_CIRC", "RFT_CHEM", "SOC_CIRC", "SOC_CHEM"}
NAMES |= {"BHM_HLTH"}
VALUE = mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT


def needs(module):
    missing = importlib.util.find_spec(module) is None
    return pytest.mark.skipif(missing, reason=f"{module} is not here: no wheel for this platform?")


@pytest.fixture
def start(tmp_path):
    """Starts processes in an empty folder, their output in files; ends them, by id, when the test is over."""
    running = []

    def begin(name, *command, stdin=None):
        out = (tmp_path / f"{name}.out").open("wb")
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1", "HOME": str(tmp_path)}
        process = subprocess.Popen(
            [sys.executable, *map(str, command)], stdin=stdin, stdout=out, stderr=subprocess.STDOUT, cwd=tmp_path,
            env={**environment, "PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip
        out.close()
        running.append(process)
        return process, tmp_path / f"{name}.out"

    yield begin
    for process in reversed(running):
        process.terminate()
    for process in running:
        try:
            process.wait(timeout=3)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdin is not None:
            process.stdin.close()


def until(done, patience=120.0):
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if found := done():
            return found
        time.sleep(0.2)
    raise AssertionError("nothing came of it")


def flown(start):
    """A simulated ArduPilot with the service on one link; the port of its other one."""
    service, ground = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
    links = [f"udpout:127.0.0.1:{port}" for port in (service, ground)]
    start("sim", "-m", "bhm_service.cli", "sim", "--quiet", "--charge", 0.9, "--link", links[0], "--link", links[1])
    serve(start, service)
    return ground


def serve(start, port):
    vehicle = shipped("vehicles", "quad-4s.toml")
    link = f"udpin:127.0.0.1:{port}"
    return start("service", "-m", "bhm_service.cli", "run", "--link", link, "--vehicle", vehicle)[1]


@needs("MAVProxy")
def test_mavproxy_lists_every_name_and_writes_a_log_in_which_they_are_found(start, tmp_path):
    master = f"udpin:127.0.0.1:{flown(start)}"
    script = Path(sys.executable).with_name("mavproxy.py")
    log = tmp_path / "peer.tlog"
    options = [f"--master={master}", "--default-modules=", f"--logfile={log}", "--mav20"]
    process, out = start("mavproxy", script, *options, stdin=subprocess.PIPE)

    def listed():
        process.stdin.write(b"status NAMED_VALUE_FLOAT*\n")
        process.stdin.flush()
        time.sleep(0.5)
        text = out.read_text()
        return "Detected vehicle 1:191" in text and all(f"name : {name}," in text for name in NAMES)

    until(listed)

    def logged():
        frames = list(TlogReader(log.read_bytes(), frozenset({VALUE})))
        names = {unpack(VALUE, f.payload)["name"].split(b"\0")[0].decode() for f in frames}
        return names == NAMES and {f.source for f in frames} == {(1, 191)}

    until(logged)


@needs("mavsdk")
def test_mavsdk_receives_every_name_with_our_system_and_component(start):
    _, out = start("ground", HERE / "mavsdk_ground.py", f"udpin://127.0.0.1:{flown(start)}", 180)

    def heard():
        lines = [line for line in out.read_text().splitlines() if line.startswith("{") and line.endswith("}")]
        return [json.loads(line) for line in lines] if sum('"BHM_HLTH"' in line for line in lines) >= 2 else []

    values = until(heard)
    assert {tuple(value["from"]) for value in values} == {(1, 191)}
    assert {value["name"] for value in values} == NAMES
    last = {value["name"]: value["value"] for value in values}
    assert 0.5 < last["BHM_SOC"] < 1.0
    assert last["BHM_RFTLO"] <= last["BHM_RFT"] <= last["BHM_RFTHI"]


@needs("mavsdk")
def test_mavsdks_telemetry_server_is_an_autopilot_to_us_and_one_without_current_gets_no_estimate(start):
    port = free_port(socket.SOCK_DGRAM)
    service = serve(start, port)
    _, autopilot = start("autopilot", HERE / "mavsdk_autopilot.py", f"udpout://127.0.0.1:{port}", 180)
    until(lambda: "autopilot heard" in service.read_text())
    until(lambda: "15.50 V" in service.read_text())
    until(lambda: "reports no current" in service.read_text())
    assert "no estimate" in service.read_text()
    said = autopilot.read_text()
    assert "Discovered component Companion Computer (system ID: 1, component ID: 191)" in said
    for message_id in (mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, mavlink.MAVLINK_MSG_ID_SYS_STATUS):
        assert f"Setting interval for msg id: {message_id} interval_ms:1000" in said
