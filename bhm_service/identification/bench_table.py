"""Tables and logs of a bench as columns: which column is what, which rows hold numbers, where a recording ends."""

from __future__ import annotations

import csv
import gzip
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from bhm_service.errors import BadInputError
from bhm_service.mavlink.log import LogKind, kind_of, read_log
from bhm_service.mavlink.recording import record
from bhm_service.units import SECONDS_PER_HOUR, ZERO_CELSIUS_K, Array

QUANTITIES = ("time", "current", "voltage", "temperature", "charge", "label")
_KNOWN: dict[str, tuple[str, ...]] = {
    "time": ("time_s", "t_s", "time", "t", "seconds", "test_time(s)", "time(s)", "time [s]"),
    "current": (
        "current_a",
        "i",
        "current",
        "amps",
        "current(a)",
        "current [a]",
        "i_a",
        "current_ma",
        "current(ma)",
        "current [ma]",
        "i_ma",
        "ma",
    ),
    "voltage": (
        "voltage_v",
        "v",
        "voltage",
        "volts",
        "voltage(v)",
        "voltage [v]",
        "u",
        "u_v",
        "voltage_mv",
        "voltage(mv)",
        "voltage [mv]",
        "mv",
    ),
    "temperature": ("temperature_c", "t_c", "temperature", "temp_c", "temp", "battery_temp_degc"),
    "charge": ("charge_ah",),
    "label": ("label", "cycle"),
}
_MILLI = re.compile(r"(^|[_ (\[])m[av][)\]]?$")
_NO_CELSIUS = 150.0  # a cell is never this warm: it is in kelvin


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """How recordings are to be read: the answers to what their numbers leave open."""

    series: int
    columns: Mapping[str, str] = field(default_factory=dict)
    current_unit: Literal["A", "mA"] | None = None
    voltage_of: Literal["pack", "cell"] | None = None
    discharge: Literal["positive", "negative"] | None = None
    battery_id: int = 0


@dataclass(frozen=True, slots=True)
class Table:
    """The columns of one recording as they stand in the file."""

    time: Array
    current: Array
    voltage: Array
    temperature: Array | None  # [K]
    charge: Array | None  # [C]
    label: tuple[str, ...] | None
    remarks: tuple[str, ...]  # what was guessed and left out

    def where(self, keep: Array | slice) -> Table:
        """Some of its rows."""
        return replace(
            self,
            time=self.time[keep],
            current=self.current[keep],
            voltage=self.voltage[keep],
            temperature=None if self.temperature is None else self.temperature[keep],
            charge=None if self.charge is None else self.charge[keep],
            label=None if self.label is None else tuple(np.asarray(self.label)[keep].tolist()),
        )


def read_tables(path: Path, reading: Reading) -> list[tuple[str, Table]]:
    """The recordings of a table or a log, each with its name; labels and restarting times part them.

    Raises BadInputError where a column is not found or nothing is a number.
    """
    return _pieces(_read_table(path, reading) if kind_of(path) is LogKind.TABLE else _read_log(path, reading))


def _read_table(path: Path, reading: Reading) -> Table:
    with gzip.open(path, "rt", newline="") if path.suffix == ".gz" else path.open(newline="") as stream:
        rows = list(csv.reader(stream))
    if not rows:
        raise BadInputError(str(path), "is empty")
    header = [name.strip() for name in rows[0]]
    where = _columns(path, header, reading.columns)
    remarks = []
    if not reading.columns:
        remarks.append("columns: " + ", ".join(f"{q} from {header[k]}" for q, k in where.items()))
    numbers = {q: np.array([_number(row, k) for row in rows[1:]]) for q, k in where.items() if q != "label"}
    if not all(np.isfinite(numbers[q]).any() for q in ("time", "current", "voltage")):
        raise BadInputError(str(path), "has no row with time, current and voltage")
    good = np.isfinite(numbers["time"]) & np.isfinite(numbers["current"]) & np.isfinite(numbers["voltage"])
    bad = int(good.size - good.sum())
    if bad:
        first = int(np.argmax(~good)) + 2
        remarks.append(f"left out {bad} of {good.size} rows without a number (the first is line {first})")
    for quantity in ("current", "voltage"):
        name = header[where[quantity]]
        if _MILLI.search(name.lower()) and not (quantity == "current" and reading.current_unit):
            numbers[quantity] = numbers[quantity] / 1000.0
            remarks.append(f"{name} is read as m{'A' if quantity == 'current' else 'V'}, as its name says")
    k = where.get("label")
    whole = Table(
        numbers["time"],
        numbers["current"],
        numbers["voltage"],
        _kelvin(numbers["temperature"], remarks) if "temperature" in numbers else None,
        numbers["charge"] * SECONDS_PER_HOUR if "charge" in numbers else None,
        None if k is None else tuple(row[k] if k < len(row) else "" for row in rows[1:]),
        tuple(remarks),
    )
    return whole.where(good)


def _kelvin(celsius: Array, remarks: list[str]) -> Array:
    if np.isfinite(celsius).any() and float(np.nanmedian(celsius)) > _NO_CELSIUS:
        remarks.append("temperature is read as kelvin: no cell is that warm in degC")
        return celsius
    return celsius + ZERO_CELSIUS_K


def _columns(path: Path, header: list[str], told: Mapping[str, str]) -> dict[str, int]:
    found: dict[str, int] = {}
    for quantity, name in told.items():
        if name not in header:
            raise BadInputError(str(path), f"no column {name!r}; it has {', '.join(header)}")
        found[quantity] = header.index(name)
    lower = [name.lower() for name in header]
    for quantity in QUANTITIES:
        if quantity not in found:
            match = next((lower.index(name) for name in _KNOWN[quantity] if name in lower), None)
            if match is not None and match not in found.values():
                found[quantity] = match
    missing = [q for q in ("time", "current", "voltage") if q not in found]
    if missing:
        raise BadInputError(
            str(path),
            f"which column is the {missing[0]}? It has {', '.join(header)}",
            f"answer with --columns {','.join(f'{q}=NAME' for q in missing)}",
        )
    return found


def _number(row: list[str], k: int) -> float:
    try:
        value = float(row[k])
    except (ValueError, IndexError):
        return float("nan")
    return value if np.isfinite(value) else float("nan")


def _read_log(path: Path, reading: Reading) -> Table:
    log = read_log(path)
    recording = record(log, reading.battery_id, reading.series, capacity_c=5.0 * SECONDS_PER_HOUR)
    good = np.isfinite(recording.current_a) & np.isfinite(recording.voltage_v)
    if not good.any():
        raise BadInputError(str(path), "has no sample with current and voltage")
    kelvin = recording.temperature_k[good]
    return Table(
        recording.time_s[good],
        recording.current_a[good],
        recording.voltage_v[good],
        kelvin if np.isfinite(kelvin).all() else None,
        None,
        None,
        tuple(log.remarks()),
    )


def _pieces(table: Table) -> list[tuple[str, Table]]:
    edges = set((np.flatnonzero(np.diff(table.time) < -1.0) + 1).tolist())
    if table.label is not None:
        edges |= {k for k in range(1, len(table.label)) if table.label[k] != table.label[k - 1]}
    cuts = [0, *sorted(edges), table.time.size]
    found = [
        (table.label[low] if table.label is not None else str(number), table.where(slice(low, high)))
        for number, (low, high) in enumerate(pairwise(cuts), start=1)
        if high - low >= 2
    ]
    return found or [("1", table)]
