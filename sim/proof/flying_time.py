"""Remaining flying time on flights that nobody was shown: with the battery as it was, and as it was repaired."""

from __future__ import annotations

import csv
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from sim.proof.confine import Confinement
from sim.proof.scoring.answers import Answer

_CUTOFF_V, _THRESHOLD_SOC = 3.3, 0.20
_LONGEST_S = 300.0
_SECOND_HALF = 0.5


def flying_times(
    asked: Sequence[tuple[Answer, Path, Path, int]], held: Path, jobs: int, progress: Callable[[int, int], None]
) -> dict[str, tuple[float, float]]:
    """Median error [s] before and after, for each (answer, battery before, battery after, cells in series).

    A case whose replay fails or says nothing has none.
    """
    found: dict[str, tuple[float, float]] = {}

    def one(item: tuple[Answer, Path, Path, int]) -> tuple[str, list[float | None]]:
        answer, before, after, series = item
        logs = {held / answer.case / flight: end_s for flight, end_s in answer.held.items()}
        return answer.case, [_error_s(logs, battery, series) for battery in (before, after)]

    progress(0, len(asked))
    with ThreadPoolExecutor(jobs) as pool:
        for done, (case, errors) in enumerate(pool.map(one, asked), start=1):
            if errors[0] is not None and errors[1] is not None:
                found[case] = errors[0], errors[1]
            progress(done, len(asked))
    return found


def _error_s(logs: Mapping[Path, float], battery: Path, series: int) -> float | None:
    """Median over the second half of every flight."""
    errors: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        vehicle = Path(folder) / "vehicle.toml"
        vehicle.write_text(tomlkit.dumps(_vehicle(battery, series)))
        command = [sys.executable, "-m", "bhm_service.cli", "replay", *map(str, logs), "-o", folder]
        ran = Confinement((), ()).run([*command, "--vehicle", str(vehicle)], Path(folder), _LONGEST_S, os.environ)
        if ran.status != 0:
            return None
        for log, end_s in logs.items():
            errors += errors_s(Path(folder) / f"{log.stem}.csv", end_s)
    return float(np.median(errors)) if errors else None


def errors_s(series: Path, end_s: float) -> list[float]:
    """|RFT - what was left| at every second of the second half of a replayed flight; ``end_s`` since its beginning."""
    with series.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    start = float(rows[0]["time_s"])
    flying = [(float(row["time_s"]) - start, row["rft_s"]) for row in rows if row["airborne"] == "1"]
    later = flying[int(_SECOND_HALF * len(flying)) :]
    return [abs(float(rft) - (end_s - t)) for t, rft in later if rft]


def _vehicle(battery: Path, series: int) -> dict[str, Any]:
    settings = {"file": str(battery), "series": series, "cutoff_v": _CUTOFF_V, "threshold_soc": _THRESHOLD_SOC}
    return {"name": "examined", "battery": settings}
