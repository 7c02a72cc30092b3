"""The unit that ships: sandboxed, watched, and startable."""

from __future__ import annotations

import configparser
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bhm_service.config import shipped

UNIT = Path(__file__).parent.parent / "systemd" / "bhm.service"


@pytest.fixture(scope="module")
def service():
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str
    parser.read(UNIT)
    return parser["Service"]


def test_its_exposure_is_at_most_two():
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not here")
    run = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=20", "--no-pager", str(UNIT)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    exposure = re.search(r"exposure level for bhm.service: ([\d.]+)", run.stdout)
    assert exposure is not None, run.stderr
    assert float(exposure[1]) <= 2.0


def test_systemd_understands_every_line_of_it(tmp_path):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not here")
    copy = tmp_path / "bhm.service"
    copy.write_text(UNIT.read_text().replace("/opt/bhm/bin/bhm", sys.executable))
    run = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True, check=False)
    assert [line for line in run.stderr.splitlines() if "bhm.service" in line] == []


def test_it_starts_what_there_is_and_watches_it(service):
    assert service["Type"] == "notify"
    assert service["WatchdogSec"] == "10s"
    assert service["Restart"] == "always"
    assert service["RestartPreventExitStatus"] == "2"  # a wrong file
    words = service["ExecStart"].split()
    assert words[1:3] == ["run", "--config"]
    assert words[3] == "/etc/bhm/service.toml"
    assert shipped("service.toml").exists()
    help_ = subprocess.run(
        [sys.executable, "-m", "bhm_service.cli", "run", "--help"], capture_output=True, text=True, check=True
    )
    assert "--config" in help_.stdout


def test_no_memory_of_the_service_is_both_written_and_run():
    """MemoryDenyWriteExecute would end a process that wants such memory."""
    code = """
import bhm_service.service
from bhm_service.assembly import assemble
from bhm_service.config import Service, shipped
from bhm_service.equipment import equipment_of
assemble(equipment_of(shipped("vehicles", "quad-4s.toml"), None), Service())
print([line for line in open("/proc/self/maps") if line.split()[1].startswith("rwx")])
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
