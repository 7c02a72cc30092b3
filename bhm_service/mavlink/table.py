"""Recordings as tables (.csv, .csv.gz) to the same messages as a tlog.

Two layouts are known: flights (t_s, V, I, T_C, soc_pct, used_mAh, alt_m, speed_mps, armed) and bench recordings of one
cell (time_s, current_A, voltage_V, temperature_C). Either may have the voltages of single cells (cell1_V, cell2_V and
so on). Currents are positive while discharging. A blank is not recorded.
"""

from __future__ import annotations

import csv
import gzip
import math
import re
from collections.abc import Iterator
from pathlib import Path

from bhm_service.errors import BadInputError
from bhm_service.mavlink.decode import measured_cells
from bhm_service.mavlink.tlog import Skipped
from bhm_service.messages import AutopilotKind, BatteryStatus, Heartbeat, Message, Motion
from bhm_service.units import kelvin

_TIME, _VOLTS, _AMPS, _CELSIUS = "time", "volts", "amps", "celsius"
_NAMES = {
    _TIME: ("t_s", "time_s"),
    _VOLTS: ("V", "voltage_V"),
    _AMPS: ("I", "current_A"),
    _CELSIUS: ("T_C", "temperature_C"),
    "percent": ("soc_pct",),
    "used": ("used_mAh",),
    "height": ("alt_m",),
    "speed": ("speed_mps",),
    "armed": ("armed",),
}
_CELL = re.compile(r"cell([1-9]\d*)_V")


class TableReader:
    """Messages of a table."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.skipped = Skipped()

    def __iter__(self) -> Iterator[Message]:
        packed = self.path.suffix == ".gz"
        with gzip.open(self.path, "rt", newline="") if packed else self.path.open(newline="") as stream:
            reader = csv.DictReader(stream)
            given = list(reader.fieldnames or [])
            columns, cells = self._columns(given), self._cells(given)
            armed: bool | None = None
            for row in reader:
                values = {key: _number(row.get(name)) for key, name in columns.items()}
                time_s = values[_TIME]
                if time_s is None:
                    self.skipped.rows += 1
                    continue
                now_armed = None if values.get("armed") is None else bool(values["armed"])
                if now_armed is not None and now_armed != armed:
                    armed = now_armed
                    yield Heartbeat(time_s=time_s, system=1, component=1, kind=AutopilotKind.OTHER, armed=armed)
                height, speed = values.get("height"), values.get("speed")
                if height is not None or speed is not None:
                    yield Motion(time_s=time_s, altitude_m=height, ground_speed_mps=speed)
                yield _battery(time_s, values, [_number(row.get(name)) for name in cells])

    def _columns(self, given: list[str]) -> dict[str, str]:
        found = {key: name for key, names in _NAMES.items() for name in names if name in given}
        missing = [f"{' or '.join(_NAMES[key])}" for key in (_TIME, _VOLTS, _AMPS) if key not in found]
        if missing:
            raise BadInputError(
                str(self.path),
                f"column {missing[0]} is missing; it has {', '.join(given) if given else 'no header line'}",
            )
        return found

    def _cells(self, given: list[str]) -> list[str]:
        """Columns of single cells from the first one on."""
        cells = {int(of[1]): name for name in given if (of := _CELL.fullmatch(name))}
        missing = [k for k in range(1, max(cells, default=0)) if k not in cells]
        if missing:
            raise BadInputError(str(self.path), f"column cell{missing[0]}_V is missing; it has {', '.join(given)}")
        return [cells[k] for k in sorted(cells)]


def _battery(time_s: float, values: dict[str, float | None], cells: list[float | None]) -> BatteryStatus:
    celsius, percent, used = values.get(_CELSIUS), values.get("percent"), values.get("used")
    measured = tuple(volts for volts in cells if volts is not None)
    return BatteryStatus(
        time_s=time_s,
        battery_id=0,
        voltage_v=values[_VOLTS],
        cells_v=measured_cells(measured) if len(measured) == len(cells) else None,
        current_a=values[_AMPS],
        temperature_k=None if celsius is None else kelvin(celsius),
        consumed_c=None if used is None else used * 3.6,
        remaining=None if percent is None else percent / 100.0,
    )


def _number(text: str | None) -> float | None:
    if text is None or not text.strip():
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
