"""Where the recordings are, and what every test may ask for."""

from __future__ import annotations

from pathlib import Path

import pytest

from bhm_service.battery.battery_file import BatteryFile, read_battery
from bhm_service.config import shipped

ROOT = Path(__file__).parent.parent
SHARED = ROOT.parent / "shared"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="write the golden files anew and show what changed")


@pytest.fixture(scope="session")
def data() -> Path:
    """The real recordings; a test that asks for them is skipped where they are absent."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip(f"real recordings are not here: {folder}")
    return folder


@pytest.fixture(scope="session")
def generic() -> BatteryFile:
    """The battery that ships."""
    return read_battery(shipped("batteries", "generic-lipo.toml"))
