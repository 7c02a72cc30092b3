"""What the doctor finds out about the computer."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from bhm_service.config import Service
from bhm_service.doctor.finding import Level
from bhm_service.doctor.machine import clock, holding, key, machine, place, port, serial
from bhm_service.mavlink.transport import LinkUrl

HOLDER = """
import os, socket, sys
held = open(sys.argv[1], "rb")
port = socket.socket(socket.AF_INET, getattr(socket, sys.argv[2]))
port.bind(("127.0.0.1", 0))
if sys.argv[2] == "SOCK_STREAM":
    port.listen()
print(port.getsockname()[1], flush=True)
sys.stdin.read()
"""


@pytest.fixture(params=["SOCK_DGRAM", "SOCK_STREAM"])
def holder(request, tmp_path):
    """Another program that has a file and a port."""
    (tmp_path / "holder.py").write_text(HOLDER)
    (tmp_path / "device").write_text("")
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "holder.py"), str(tmp_path / "device"), request.param],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        yield tmp_path / "device", request.param, int(process.stdout.readline())
        process.stdin.close()


def test_who_holds_a_device_or_a_port_is_named(holder):
    device, kind, number = holder
    assert holding(device) == ["holder.py"]
    name = "udpin" if kind == "SOCK_DGRAM" else "tcpin"
    finding = port(LinkUrl.parse(f"{name}:0.0.0.0:{number}"))
    assert finding.level is Level.BAD
    assert "is open in holder.py" in finding.what
    assert "stop holder.py" in finding.mend


def test_a_port_that_nobody_has_is_free():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    assert port(LinkUrl.parse(f"udpin:0.0.0.0:{number}")).level is Level.GOOD


def test_a_serial_port_that_is_none_is_told(tmp_path):
    assert "no such device" in serial(tmp_path / "ttyUSB0").what
    (tmp_path / "file").write_text("")
    assert "is not a serial port" in serial(tmp_path / "file").what
    ours, theirs = os.openpty()
    assert serial(Path(os.ttyname(theirs))).level is Level.GOOD
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(
    ("unix_s", "signing", "level"),
    [(1.8e9, True, Level.GOOD), (0.0, False, Level.DOUBTFUL), (1.42e9, True, Level.BAD), (-5.0, True, Level.BAD)],
)
def test_a_clock_that_was_never_set_is_bad_for_signing_and_doubtful_else(unix_s, signing, level):
    assert clock(unix_s, signing).level is level


def test_a_key_that_others_can_read_is_told(tmp_path):
    path = tmp_path / "key"
    path.write_bytes(bytes(32))
    path.chmod(0o644)
    finding = key(path)
    assert finding.level is Level.BAD
    assert "chmod 600" in finding.mend
    path.chmod(0o600)
    assert key(path).level is Level.GOOD


def test_room_and_permission_for_what_is_kept(tmp_path):
    assert place(tmp_path / "not" / "yet", 1e3).level is Level.GOOD
    assert place(tmp_path, 1e18).level is Level.DOUBTFUL
    (tmp_path / "file").write_text("")
    assert place(tmp_path / "file" / "below", 1e3).level is Level.BAD


def test_everything_about_the_computer_together(tmp_path):
    urls = (LinkUrl.parse("serial:/dev/no-such:57600"), LinkUrl.parse("udpout:127.0.0.1:9"))
    findings = machine(Service(), urls, tmp_path, 1.8e9)
    assert [f.level for f in findings] == [Level.GOOD, Level.GOOD, Level.BAD]
