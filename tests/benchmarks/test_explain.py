"""Seconds and memory of `bhm explain`, in a process of its own: ten flights of twenty minutes, and the open cases."""

from __future__ import annotations

import json
import os
import sys
import time
from statistics import median

import numpy as np
import pytest
from commanded import bhm
from discrepancy.flown import BATTERY, flown
from discrepancy.tables import write

from bhm_service.battery.battery_file import write_battery
from bhm_service.battery.effects import EFFECTS
from sim.proof.suites import SHARED

FLIGHTS, SECONDS = 10, 1200
LIMIT_S, LIMIT_MIB, MEDIAN_S = 45.0, 1024.0, 15.0
CASES = SHARED / "cases"
WARMTH = {"heat_capacity": 900.0, "conductance": 1.0, "start_above": 0.0}


@pytest.mark.parametrize("name", [None, "resistance-growth", "resistance-temperature"])
def test_ten_flights_explained(row, tmp_path, name):
    write_battery(tmp_path / "known.toml", BATTERY)
    logs = []
    for k in range(FLIGHTS):
        effects = {
            None: [],
            "resistance-growth": [EFFECTS["resistance-growth"](growth=0.5)],
            "resistance-temperature": [
                EFFECTS["resistance-temperature"](activation_energy=25e3),
                EFFECTS["self-heating"](ambient=274.0 + 3.0 * k, **WARMTH),
            ],
        }[name]
        flight = flown(effects, seed=1, number=k, samples=SECONDS, step_s=1.0)
        columns = {"t_s": flight.time_s, "V": flight.voltage_v, "I": flight.current_a}
        columns |= {"T_C": np.full(SECONDS, np.nan), "alt_m": flight.altitude_m, "armed": flight.airborne * 1.0}
        logs.append(write(tmp_path / f"{k}.csv", columns))
    wall_s, used = explained(tmp_path, *logs, "--battery", tmp_path / "known.toml")
    what = f"explain, {FLIGHTS} flights of {SECONDS // 60} min, {name or 'null'}"
    row(what, f"{wall_s:.1f} s", "", f"{used.ru_utime + used.ru_stime:.1f} s CPU; target {LIMIT_S:.0f} s")
    row(f"{what}: memory", f"{used.ru_maxrss / 1024.0:.0f} MiB", "", f"target under {LIMIT_MIB:.0f}; a process")


@pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is absent")
def test_the_open_cases_explained(row, tmp_path):
    took = {}
    for folder in sorted(path for path in CASES.iterdir() if path.is_dir()):
        pack = json.loads((folder / "truth.json").read_text())["pack"]
        battery = tmp_path / f"{pack}.toml"
        if not battery.exists():
            lab = folder / "lab"
            bhm("identify", "--slow", lab / "slow.csv.gz", "--one-c", lab / "one_c.csv.gz", "--variable",
                lab / "variable.csv.gz", "--series", "6", "-o", battery)  # fmt: skip
        flights = folder / "flights"
        words = (*sorted(flights.glob("*.tlog")), "--battery", battery, "--sidecar", flights / "flights.csv")
        took[folder.name], _ = explained(tmp_path, *words)
    longest = max(took, key=took.__getitem__)
    row(f"explain, {len(took)} open cases: median", f"{median(took.values()):.1f} s", "", f"target {MEDIAN_S:.0f} s")
    row(f"the same: longest, {longest}", f"{took[longest]:.1f} s", "", f"target {LIMIT_S:.0f} s")


def explained(tmp_path, *words):
    """Seconds that a process of `bhm explain` takes, and what it used."""
    words = [sys.executable, "-m", "bhm_service.cli", "explain", *map(str, words), "-o", str(tmp_path / "out")]
    begin = time.monotonic()
    _, status, used = os.wait4(os.posix_spawn(sys.executable, words, os.environ), 0)
    wall_s = time.monotonic() - begin
    assert os.waitstatus_to_exitcode(status) == 0
    return wall_s, used
