"""`bhm doctor` beside a simulated vehicle on a real socket."""

from __future__ import annotations

import subprocess
import sys

from executive.live import flying, free_port

from bhm_service.config import shipped


def doctor(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "bhm_service.cli", "doctor", *arguments],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


def test_a_vehicle_that_is_heard_and_one_that_is_not(tmp_path):
    port = free_port()
    vehicle = ["--vehicle", str(shipped("vehicles", "quad-4s.toml"))]
    with flying(port):
        run = doctor("--link", f"udpin:127.0.0.1:{port}", *vehicle, "--seconds", "4")
    assert "ArduPilot, system 1" in run.stdout
    assert "reports a second" in run.stdout
    assert "settings cannot be read" in run.stdout  # this one does not answer
    assert run.returncode == 0
    assert "nothing to mend" in run.stdout
    assert max(map(len, run.stdout.splitlines())) <= 100
    run = doctor("--link", f"udpin:127.0.0.1:{port}", *vehicle, "--seconds", "1.5")
    assert run.returncode == 1
    assert "nothing came" in run.stdout
    assert "1 to mend" in run.stdout


def test_a_wrong_service_file_is_one_clear_message(tmp_path):
    (tmp_path / "service.toml").write_text("[link]\nurl = 3\n")
    run = doctor("--config", str(tmp_path / "service.toml"))
    assert run.returncode == 2
    assert "unknown key 'link.url'" in run.stderr
