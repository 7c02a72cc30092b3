"""Bench recordings in: columns found or told, units questioned, faults mended or refused, each with a sentence.

Nothing is converted silently. Where a unit or a sign cannot be what it seems, the person is asked, and the answer is
an option of the command.
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from bhm_service.errors import BadInputError
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.mavlink.log import LogKind, kind_of, read_log
from bhm_service.mavlink.recording import record
from bhm_service.units import SECONDS_PER_HOUR, ZERO_CELSIUS_K, Array

QUANTITIES = ("time", "current", "voltage", "temperature", "charge", "label")
_KNOWN: dict[str, tuple[str, ...]] = {
    "time": ("time_s", "t_s", "time", "t", "seconds", "test_time(s)", "time(s)", "time [s]"),
    "current": ("current_a", "i", "current", "amps", "current(a)", "current [a]", "i_a", "current_ma"),
    "voltage": ("voltage_v", "v", "voltage", "volts", "voltage(v)", "voltage [v]", "u", "u_v", "voltage_mv"),
    "temperature": ("temperature_c", "t_c", "temperature", "temp_c", "temp", "battery_temp_degc"),
    "charge": ("charge_ah",),
    "label": ("label", "cycle"),
}
_CELL_V = (1.5, 4.6)  # [V] what one cell may show
_MOST_C = 60.0  # a larger current than this many times the charge that came out per hour is none in ampere
_BRIDGED_S = 600.0  # a gap of a steady current up to this long is bridged


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
class Bench:
    """A recording and what was done to it."""

    experiment: Experiment
    remarks: tuple[str, ...]


@dataclass(slots=True)
class _Table:
    """The columns as they stand in the file."""

    time: Array
    current: Array
    voltage: Array
    temperature: Array | None
    charge: Array | None
    label: list[str] | None
    remarks: list[str]


def read_bench(path: Path, kind: Kind, reading: Reading) -> list[Bench]:
    """Read a table or a log; a table with labels or restarting times gives one recording for each.

    Raises BadInputError with a question where units or signs are open, and with the reason where nothing can be
    learnt from the recording.
    """
    if not path.is_file():
        raise BadInputError(str(path), "no such file")
    table = _read_table(path, reading) if kind_of(path) is LogKind.TABLE else _read_log(path, reading)
    pieces = _pieces(table)
    return [
        _bench(piece, path, kind, reading, f"{path.name}" if len(pieces) == 1 else f"{path.name} [{name}]")
        for name, piece in pieces
    ]


# ---- files ----------------------------------------------------------------------------------------------------------


def _read_table(path: Path, reading: Reading) -> _Table:
    with gzip.open(path, "rt", newline="") if path.suffix == ".gz" else path.open(newline="") as stream:
        rows = list(csv.reader(stream))
    if not rows:
        raise BadInputError(str(path), "is empty")
    header = [name.strip() for name in rows[0]]
    where = _columns(path, header, reading.columns)
    remarks = []
    named = {q: header[k] for q, k in where.items()}
    if not reading.columns:
        remarks.append("columns: " + ", ".join(f"{q} from {name}" for q, name in named.items()))
    numbers = {q: np.array([_number(row, k) for row in rows[1:]]) for q, k in where.items() if q != "label"}
    labels = (
        [row[where["label"]] if where["label"] < len(row) else "" for row in rows[1:]] if "label" in where else None
    )
    good = np.isfinite(numbers["time"]) & np.isfinite(numbers["current"]) & np.isfinite(numbers["voltage"])
    bad = int(good.size - good.sum())
    if not good.any():
        raise BadInputError(str(path), "has no row with time, current and voltage")
    if bad:
        first = int(np.argmax(~good)) + 2
        remarks.append(f"left out {bad} of {good.size} rows without a number (the first is line {first})")
    return _Table(
        numbers["time"][good],
        numbers["current"][good],
        numbers["voltage"][good],
        numbers["temperature"][good] + ZERO_CELSIUS_K if "temperature" in numbers else None,
        numbers["charge"][good] * SECONDS_PER_HOUR if "charge" in numbers else None,
        [label for label, keep in zip(labels, good, strict=True) if keep] if labels is not None else None,
        remarks,
    )


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


def _read_log(path: Path, reading: Reading) -> _Table:
    log = read_log(path)
    recording = record(log, reading.battery_id, reading.series, capacity_c=5.0 * SECONDS_PER_HOUR)
    good = np.isfinite(recording.current_a) & np.isfinite(recording.voltage_v)
    if not good.any():
        raise BadInputError(str(path), "has no sample with current and voltage")
    kelvin = recording.temperature_k[good]
    return _Table(
        recording.time_s[good],
        recording.current_a[good],
        recording.voltage_v[good],
        kelvin if np.isfinite(kelvin).all() else None,
        None,
        None,
        log.remarks(),
    )


def _pieces(table: _Table) -> list[tuple[str, _Table]]:
    """Apart where the label changes or the time starts again."""
    restarts = np.flatnonzero(np.diff(table.time) < -1.0) + 1
    edges = set(restarts.tolist())
    if table.label is not None:
        edges |= {k for k in range(1, len(table.label)) if table.label[k] != table.label[k - 1]}
    cuts = [0, *sorted(edges), table.time.size]
    found = []
    for number, (low, high) in enumerate(pairwise(cuts), start=1):
        part = slice(low, high)
        if high - low < 2:
            continue
        found.append(
            (
                table.label[low] if table.label is not None else str(number),
                _Table(
                    table.time[part],
                    table.current[part],
                    table.voltage[part],
                    None if table.temperature is None else table.temperature[part],
                    None if table.charge is None else table.charge[part],
                    None,
                    list(table.remarks),
                ),
            )
        )
    return found


# ---- checks ---------------------------------------------------------------------------------------------------------


def _bench(table: _Table, path: Path, kind: Kind, reading: Reading, label: str) -> Bench:
    _in_order(table)
    _swapped(table, path, reading)
    current = _in_ampere(table, path, reading)
    voltage = _of_a_cell(table, path, reading)
    current = _discharging_positive(current, voltage, table, path, reading)
    kelvin = _temperature(table)
    time_s, current, voltage, kelvin = _bridged(table, current, voltage, kelvin, path)
    full = table.charge is not None and abs(float(table.charge[0])) < 0.01 * float(np.ptp(table.charge) + 1e-9)
    experiment = Experiment(
        label=label,
        kind=kind,
        time_s=time_s - time_s[0],
        current_a=current,
        voltage_v=voltage,
        temperature_k=kelvin,
        full_at_start=full,
    )
    _discharges_at_all(experiment, path)
    if kind in (Kind.SLOW, Kind.ONE_C, Kind.RATE):
        experiment = _without_recharge(experiment, table.remarks)
    return Bench(experiment, tuple(dict.fromkeys(table.remarks)))


def _in_order(table: _Table) -> None:
    keep = np.append(True, np.diff(np.maximum.accumulate(table.time)) > 1e-6)
    dropped = int(keep.size - keep.sum())
    if dropped:
        table.remarks.append(f"left out {dropped} samples that repeat a time or go back")
        for name in ("time", "current", "voltage", "temperature", "charge"):
            column = getattr(table, name)
            if column is not None:
                setattr(table, name, column[keep])


def _swapped(table: _Table, path: Path, reading: Reading) -> None:
    def like_voltage(x: Array) -> bool:
        for cells in (1, reading.series):
            if _CELL_V[0] * cells < float(np.quantile(x, 0.02)) and float(np.quantile(x, 0.98)) < _CELL_V[1] * cells:
                return True
        return False

    if not like_voltage(table.voltage) and like_voltage(table.current) and "current" not in reading.columns:
        raise BadInputError(
            str(path),
            f"current and voltage seem to be swapped: the voltage is {_span(table.voltage)}, the current "
            f"{_span(table.current)}",
            "say which is which with --columns current=NAME,voltage=NAME",
        )


def _in_ampere(table: _Table, path: Path, reading: Reading) -> Array:
    if reading.current_unit is not None:
        return table.current / 1000.0 if reading.current_unit == "mA" else table.current
    most = float(np.max(np.abs(table.current)))
    hours = float(table.time[-1] - table.time[0]) / SECONDS_PER_HOUR
    if most > 400.0 or (most > 60.0 and most * max(hours, 0.05) > 500.0):
        raise BadInputError(
            str(path), f"is the current in mA? It reaches {most:g}", "answer with --current-unit mA or --current-unit A"
        )
    return table.current


def _of_a_cell(table: _Table, path: Path, reading: Reading) -> Array:
    series = reading.series
    low, high = float(np.quantile(table.voltage, 0.02)), float(np.quantile(table.voltage, 0.98))
    if reading.voltage_of is not None:
        return table.voltage if reading.voltage_of == "cell" else table.voltage / series
    as_pack = _CELL_V[0] * series < low and high < _CELL_V[1] * series
    as_cell = _CELL_V[0] < low and high < _CELL_V[1]
    if as_pack:
        return table.voltage / series
    if as_cell:
        raise BadInputError(
            str(path),
            f"is this the voltage of one cell? It is {_span(table.voltage)} with --series {series}",
            "answer with --voltage cell or --voltage pack",
        )
    millivolts = " (in millivolts? convert it to V)" if high > 1000.0 else ""
    raise BadInputError(
        str(path),
        f"voltage {_span(table.voltage)}{millivolts}: {series} cells show {_CELL_V[0] * series:g} to "
        f"{_CELL_V[1] * series:g} V",
        "check --series and the column",
    )


def _discharging_positive(current: Array, voltage: Array, table: _Table, path: Path, reading: Reading) -> Array:
    if reading.discharge is not None:
        return current if reading.discharge == "positive" else -current
    charge = np.concatenate([[0.0], np.cumsum(0.5 * (current[1:] + current[:-1]) * np.diff(table.time))])
    # Voltage falls while charge goes out: over the recording the two move against each other.
    together = float(np.sum((charge - charge.mean()) * (voltage - voltage.mean())))
    strength = together / max(float(np.std(charge) * np.std(voltage) * charge.size), 1e-12)
    if strength > 0.3:
        raise BadInputError(
            str(path),
            "is the current negative while discharging? The voltage rises with the charge that it counts out",
            "answer with --discharge negative or --discharge positive",
        )
    return current


def _temperature(table: _Table) -> Array | None:
    if table.temperature is None or not np.isfinite(table.temperature).any():
        return None
    known = np.isfinite(table.temperature)
    if not known.all():
        table.remarks.append(f"temperature carried over {int((~known).sum())} samples without one")
        return np.interp(table.time, table.time[known], table.temperature[known])
    return table.temperature


def _bridged(
    table: _Table, current: Array, voltage: Array, kelvin: Array | None, path: Path
) -> tuple[Array, Array, Array, Array | None]:
    """Gaps: what the charge counter says went out is put back; else a steady current is taken to have gone on."""
    time_s = table.time
    dt = np.diff(time_s)
    usual = float(np.median(dt))
    gaps = np.flatnonzero(dt > max(20.0 * usual, 100.0))
    inserts: list[tuple[int, list[float], list[float]]] = []
    for k in gaps:
        mean = 0.5 * (current[k] + current[k + 1])
        if table.charge is not None:
            missing = float(table.charge[k + 1] - table.charge[k] - mean * dt[k])
            if abs(missing) > 1e-3 * abs(float(np.ptp(table.charge))):
                lasting = min(0.45 * dt[k], max(abs(missing), 1e-9))
                amps = missing / lasting
                at = [time_s[k] + 0.01, time_s[k] + 0.01 + lasting, time_s[k] + 0.02 + lasting]
                inserts.append((int(k), at, [amps, amps, 0.0]))
            continue
        steady = abs(current[k] - current[k + 1]) <= 0.05 * float(np.max(np.abs(current)))
        if not steady or (dt[k] > _BRIDGED_S and abs(mean) > 0.02 * float(np.max(np.abs(current)))):
            raise BadInputError(
                str(path),
                f"nothing was recorded for {dt[k]:.0f} s at {time_s[k] - time_s[0]:.0f} s while current flowed: the "
                "charge that went out is not known",
                "give a recording without this gap, or one with a charge_Ah column",
            )
        if abs(mean) > 0.02 * float(np.max(np.abs(current))):
            table.remarks.append(f"bridged {dt[k]:.0f} s without samples at {time_s[k] - time_s[0]:.0f} s")
    if not inserts:
        return time_s, current, voltage, kelvin
    table.remarks.append(f"put back the charge of {len(inserts)} gaps, from the charge column")
    places = np.repeat([k + 1 for k, _, _ in inserts], 3)
    filled = np.insert(time_s, places, np.concatenate([t for _, t, _ in inserts]))
    return (
        filled,
        np.insert(current, places, np.concatenate([a for _, _, a in inserts])),
        np.insert(voltage, places, np.nan),
        None if kelvin is None else np.interp(filled, time_s, kelvin),
    )


def _discharges_at_all(experiment: Experiment, path: Path) -> None:
    out = float(np.max(experiment.charge_c))
    fell = float(np.nanmax(experiment.voltage_v) - np.nanmin(experiment.voltage_v))
    if out <= 0.0 or float(np.max(experiment.current_a)) <= 0.0:
        raise BadInputError(str(path), "only charges: a discharge is needed")
    if experiment.kind is Kind.SLOW and fell < 0.5:
        raise BadInputError(
            str(path),
            f"too short to discharge: the cell's voltage moves by {1000 * fell:.0f} mV only",
            "a slow discharge runs from full to empty",
        )


def _without_recharge(experiment: Experiment, remarks: list[str]) -> Experiment:
    """Up to where the charger starts: on the way up a cell's voltage runs along another branch."""
    emptiest = int(np.argmax(experiment.charge_c))
    charging = experiment.current_a[emptiest:] < -0.05 * float(np.max(experiment.current_a))
    if not charging.any():
        return experiment
    stop = emptiest + int(np.argmax(charging))
    remarks.append(f"the charge from {experiment.time_s[stop]:.0f} s on is left out: a discharge is wanted here")
    return experiment.part(slice(0, stop))


def _span(values: Array) -> str:
    return f"{float(np.min(values)):.4g} to {float(np.max(values)):.4g}"
