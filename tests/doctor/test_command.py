"""`bhm doctor` beside a simulated vehicle on a real socket."""

from __future__ import annotations

import subprocess
import sys
import threading
from contextlib import contextmanager

from executive.live import free_port

from bhm_service.config import shipped
from sim.command import Options, vehicle_of
from sim.multirotor import STEP_S, Phase


def doctor(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "bhm_service.cli", "doctor", *arguments],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


@contextmanager
def on_the_ground(port, **settings):
    """A simulated ArduPilot that tells its settings."""
    options = Options(links=(f"udpout:127.0.0.1:{port}",))
    vehicle = vehicle_of(options)
    vehicle.multirotor.plan = (Phase(600.0, 0.0),)
    vehicle.firmware.parameters |= settings
    end = threading.Event()

    def live():
        while not end.wait(STEP_S):
            vehicle.step()

    thread = threading.Thread(target=live, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()
        vehicle.close()


def test_a_vehicle_that_is_heard_and_one_that_is_not():
    port = free_port()
    vehicle = ["--link", f"udpin:127.0.0.1:{port}", "--vehicle", str(shipped("vehicles", "quad-4s.toml"))]
    with on_the_ground(port, BATT_OPTIONS=64.0, BATT_AMP_PERVLT=17.0):
        run = doctor(*vehicle, "--seconds", "7")
    assert "ArduPilot, system 1" in run.stdout
    assert "reports a second" in run.stdout
    assert "BATT_OPTIONS = 64: the voltage is sag-compensated" in run.stdout
    assert "-> set BATT_OPTIONS = 0 (bit 6 off)" in run.stdout
    assert "the current sensor was never calibrated" in run.stdout
    assert run.returncode == 1
    assert "1 to mend" in run.stdout
    assert max(map(len, run.stdout.splitlines())) <= 100
    run = doctor(*vehicle, "--seconds", "1.5")
    assert run.returncode == 1
    assert "nothing came" in run.stdout
    assert "1 to mend" in run.stdout


def test_a_wrong_service_file_is_one_clear_message(tmp_path):
    (tmp_path / "service.toml").write_text("[link]\nurl = 3\n")
    run = doctor("--config", str(tmp_path / "service.toml"))
    assert run.returncode == 2
    assert "unknown key 'link.url'" in run.stderr
