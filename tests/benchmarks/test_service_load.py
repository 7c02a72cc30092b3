"""What the running service takes of this machine, by /proc: beside a vehicle in flight, recording."""

from __future__ import annotations

import os
import time
from pathlib import Path

from executive.live import config, end, flying, free_port, start

FLIES_S, MEASURED_S = 20.0, 30.0


def cpu_s(pid):
    """User and system time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid):
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def test_load_of_the_running_service(row, tmp_path):
    port = free_port()
    with flying(port) as vehicle:
        begin = time.monotonic()
        service = start(config(tmp_path, port), OPENBLAS_NUM_THREADS="1")
        vehicle.wait_for("BHM_RFT", 0.0, 60.0)
        starting_s, started_s = cpu_s(service.pid), time.monotonic() - begin
        time.sleep(FLIES_S)
        before, cycles = cpu_s(service.pid), len(vehicle.values("BHM_RFT"))
        time.sleep(MEASURED_S)
        used, cycles = cpu_s(service.pid) - before, len(vehicle.values("BHM_RFT")) - cycles
        memory = resident_mb(service.pid)
        end(service)
    row("running service, CPU a cycle", f"{1000 * used / cycles:.1f} ms", "", f"of {cycles} cycles; target 30 ms")
    row("running service, resident", f"{memory:.0f} MiB", "", "with checkpoint and recorder; target under 100")
    row("start to first RFT", f"{starting_s:.2f} s CPU", "", f"{started_s:.1f} s with the take-off")
