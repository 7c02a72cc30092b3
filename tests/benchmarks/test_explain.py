"""Seconds and memory of `bhm explain` on ten flights of twenty minutes, once a second, in a process of its own."""

from __future__ import annotations

import os
import sys
import time

import numpy as np
import pytest
from discrepancy.flown import BATTERY, flown
from discrepancy.tables import write

from bhm_service.battery.battery_file import write_battery
from bhm_service.battery.effects import EFFECTS

FLIGHTS, SECONDS = 10, 1200
LIMIT_S, LIMIT_MIB = 45.0, 1024.0


@pytest.mark.parametrize("name", [None, "resistance-growth"], ids=["nothing is missing", "one effect is missing"])
def test_ten_flights_explained(row, tmp_path, name):
    write_battery(tmp_path / "known.toml", BATTERY)
    effects = [] if name is None else [EFFECTS[name](growth=0.5)]
    logs = []
    for k in range(FLIGHTS):
        flight = flown(effects, seed=1, number=k, samples=SECONDS, step_s=1.0)
        columns = {"t_s": flight.time_s, "V": flight.voltage_v, "I": flight.current_a}
        columns |= {"T_C": np.full(SECONDS, np.nan), "alt_m": flight.altitude_m, "armed": flight.airborne * 1.0}
        logs.append(str(write(tmp_path / f"{k}.csv", columns)))
    out = tmp_path / "out"
    words = ["-m", "bhm_service.cli", "explain", *logs, "--battery", str(tmp_path / "known.toml"), "-o", str(out)]
    begin = time.monotonic()
    child = os.posix_spawn(sys.executable, [sys.executable, *words], os.environ)
    _, status, used = os.wait4(child, 0)
    wall_s = time.monotonic() - begin
    assert os.waitstatus_to_exitcode(status) == 0
    what = f"explain, {FLIGHTS} flights of {SECONDS // 60} min, {name or 'null'}"
    row(what, f"{wall_s:.1f} s", "", f"{used.ru_utime + used.ru_stime:.1f} s CPU; target {LIMIT_S:.0f} s")
    row(f"{what}: memory", f"{used.ru_maxrss / 1024.0:.0f} MiB", "", f"target under {LIMIT_MIB:.0f}")
