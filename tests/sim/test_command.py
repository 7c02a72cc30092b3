"""`bhm sim` and `bhm run` as two processes: over a pseudo terminal and TCP, signed, with faults."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from mavlink.wire import free_port

from bhm_service.config import shipped
from bhm_service.mavlink.log import read_log
from bhm_service.messages import BatteryStatus

BHM = [sys.executable, "-u", "-m", "bhm_service.cli"]


def ended(process):
    process.send_signal(signal.SIGINT)
    try:
        return process.communicate(timeout=20)[0]
    finally:
        process.kill()


def test_the_service_flies_beside_the_simulation_on_two_signed_links(tmp_path):
    key, port = tmp_path / "mavlink.key", free_port()
    key.write_text("5a" * 32)
    key.chmod(0o600)
    links = [f"serial:{tmp_path}/tty:57600", f"tcp:127.0.0.1:{port}"]
    service = tmp_path / "service.toml"
    service.write_text(
        f"vehicle = '{shipped('vehicles', 'quad-4s.toml')}'\n"
        f"[link]\nurls = {links}\nsigning_key = 'mavlink.key'\n[prediction]\nsamples = 20\n"
    )
    flags = [flag for link in (links[0], links[1].replace("tcp:", "tcpin:")) for flag in ("--link", link)]
    environment = {**os.environ, "STATE_DIRECTORY": str(tmp_path / "state")}
    sim = subprocess.Popen(
        [*BHM, "sim", "--quiet", *flags, "--signing-key", key, "--garbage", "0.1"], stdout=subprocess.PIPE, text=True
    )
    run = subprocess.Popen([*BHM, "run", "--config", service], stdout=subprocess.PIPE, text=True, env=environment)
    lines, until = [], time.monotonic() + 120.0
    heard = [f"{link} autopilot heard: ArduPilot, system 1" for link in links]

    def seen():
        flying = any(line.startswith("RFT") and "good" in line for line in lines)
        return flying and all(any(words in line for line in lines) for words in heard)

    # Either link is enough to fly by, so the other may be heard after the first remaining time.
    while time.monotonic() < until and not seen():
        lines.append(run.stdout.readline())
    out, said = ended(run), ended(sim)
    text = "".join(lines) + out
    for words in heard:
        assert words in text
    assert "good" in text
    assert (run.returncode, sim.returncode, said) == (0, 0, "")
    assert not (tmp_path / "tty").exists()


def test_a_simulated_log_is_the_same_every_time(tmp_path):
    logs = [tmp_path / name for name in ("one.tlog", "two.tlog")]
    for log in logs:
        subprocess.run([*BHM, "sim", "--tlog", log, "--flight", "60", "--seed", "4"], check=True, capture_output=True)
    assert logs[0].read_bytes() == logs[1].read_bytes()
    batteries = [m for _, m in read_log(logs[0]).messages if isinstance(m, BatteryStatus)]
    assert len(batteries) > 70
    assert batteries[-1].consumed_c > 500.0


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--link", "udp:127.0.0.1:14550"], "serial:DEVICE:BAUD"),
        (["--silence", "soon"], "BEGIN:SECONDS"),
        (["--link", "udpin:203.0.113.1:14550"], "cannot assign requested address"),
        (["--signing-key", "nowhere.key"], "no such file"),
    ],
)
def test_a_wrong_option_is_one_clear_message(flags, said):
    run = subprocess.run([*BHM, "sim", *flags], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == 2
    assert said in run.stderr
    assert "Traceback" not in run.stderr
