"""Bench recordings in: units and signs questioned, faults mended or refused, each with a sentence.

Nothing is converted silently. Where a unit or a sign cannot be what it seems, the person is asked, and the answer is
an option of the command.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bhm_service.errors import BadInputError
from bhm_service.identification.bench_table import Reading, Table, read_tables
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.units import SECONDS_PER_HOUR, Array

_CELL_V = (1.5, 4.6)  # [V] what one cell may show
_HALF_FULL_V = 3.0  # [V] a cell shows more than this before it is discharged
_STEADY_V = 0.05  # [V] no discharge moves a pack's voltage by less
_MOST_A, _MOST_AH = 400.0, 200.0  # beyond these a current is hardly one of a multirotor's pack in ampere
_CHARGES = 0.05  # of the largest current, or of all charge that moved: less is no discharge, or no charge
_RECHARGED = 0.3  # of what went out: braking does not put back so much after the end
_LEAST_FALL_V = 0.2  # [V] a cell: the flattest of them moves by as much between full and nearly empty
_USUAL_FALL_V = 0.5  # [V] a cell, from full to empty
_UNSEEN_PER_H = 0.4  # of all charge that was counted: how fast the part that was not recorded is taken to have gone
_BRIDGED_S = 600.0  # a gap of a steady current up to this long is bridged


@dataclass(frozen=True, slots=True)
class Bench:
    """A recording and what was done to it."""

    experiment: Experiment
    remarks: tuple[str, ...]


def read_bench(path: Path, kind: Kind, reading: Reading) -> list[Bench]:
    """Read a table or a log; a table with labels or restarting times gives one recording for each.

    Raises BadInputError with a question where units or signs are open, and with the reason where nothing can be
    learnt from the recording.
    """
    if not path.is_file():
        raise BadInputError(str(path), "no such file")
    tables = read_tables(path, reading)
    found: list[Bench] = []
    useless: list[_UselessError] = []
    for name, table in tables:
        try:
            found.append(_bench(table, path, kind, reading, path.name if len(tables) == 1 else f"{path.name} [{name}]"))
        except _UselessError as why:
            useless.append(why)
    if not found:
        raise useless[0]
    if useless:
        said = f"left out {len(useless)} of {len(tables)} parts, the first of which {useless[0].problem}"
        found = [replace(bench, remarks=(*bench.remarks, said)) for bench in found]
    return found


def read_held_out(path: Path, reading: Reading) -> list[Bench]:
    """Read a recording that is not fitted; a recharge after its discharge is left out."""
    return [_without_recharge(bench) for bench in read_bench(path, Kind.VARIABLE, reading)]


def _without_recharge(bench: Bench) -> Bench:
    charge = bench.experiment.charge_c
    if float(charge.max() - charge[int(np.argmax(charge)) :].min()) < _RECHARGED * float(np.ptp(charge)):
        return bench
    remarks = list(bench.remarks)
    return Bench(_one_discharge(bench.experiment, remarks), tuple(remarks))


class _UselessError(BadInputError):
    """Nothing to be learnt from this part of a recording."""


def _bench(table: Table, path: Path, kind: Kind, reading: Reading, label: str) -> Bench:
    remarks = list(table.remarks)
    table = _in_order(table, remarks)
    _swapped(table, path, reading)
    current = _in_ampere(table, path, reading)
    voltage = _of_a_cell(table, path, reading)
    current = _discharging_positive(current, voltage, table, path, reading)
    kelvin = _temperature(table, remarks)
    counted = _counted(table, current)
    time_s, current, voltage, kelvin = _bridged(table.time, current, voltage, kelvin, counted, path, remarks)
    full = counted is not None and abs(float(counted[0])) < 0.01 * float(np.ptp(counted) + 1e-9)
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
        experiment = _one_discharge(experiment, remarks)
        _deep_enough(experiment, path, remarks)
    return Bench(experiment, tuple(remarks))


def _in_order(table: Table, remarks: list[str]) -> Table:
    keep = np.append(True, np.diff(np.maximum.accumulate(table.time)) > 1e-6)
    dropped = int(keep.size - keep.sum())
    if dropped:
        remarks.append(f"left out {dropped} samples that repeat a time or go back")
    return table.where(keep)


def _like_voltage(values: Array, cells: int) -> bool:
    low, high = float(np.quantile(values, 0.02)), float(np.quantile(values, 0.98))
    return _CELL_V[0] * cells < low and _HALF_FULL_V * cells < high < _CELL_V[1] * cells


def _swapped(table: Table, path: Path, reading: Reading) -> None:
    def like_voltage(x: Array) -> bool:
        return _like_voltage(x, 1) or _like_voltage(x, reading.series)

    moves = float(np.ptp(table.current)) > _STEADY_V
    steady = float(np.ptp(table.voltage)) < _STEADY_V
    swapped = moves and like_voltage(table.current) and (steady or not like_voltage(table.voltage))
    if swapped and "current" not in reading.columns:
        raise BadInputError(
            str(path),
            f"current and voltage seem to be swapped: the voltage is {_span(table.voltage)}, the current "
            f"{_span(table.current)}",
            "say which is which with --columns current=NAME,voltage=NAME",
        )


def _in_ampere(table: Table, path: Path, reading: Reading) -> Array:
    if reading.current_unit is not None:
        return table.current / 1000.0 if reading.current_unit == "mA" else table.current
    most = float(np.max(np.abs(table.current)))
    moved_ah = float(np.sum(np.abs(table.current[1:]) * np.diff(table.time))) / SECONDS_PER_HOUR
    if most > _MOST_A or moved_ah > _MOST_AH:
        raise BadInputError(
            str(path),
            f"is the current in mA? It reaches {most:g} and moves {moved_ah:.3g} Ah if it is in A",
            "answer with --current-unit mA or --current-unit A",
        )
    return table.current


def _of_a_cell(table: Table, path: Path, reading: Reading) -> Array:
    series = reading.series
    as_pack, as_cell = _like_voltage(table.voltage, series), _like_voltage(table.voltage, 1)
    if reading.voltage_of == "cell" and as_cell:
        return table.voltage
    if as_pack and reading.voltage_of != "cell":
        return table.voltage / series
    if as_cell:
        raise BadInputError(
            str(path),
            f"is this the voltage of one cell? It is {_span(table.voltage)} with --series {series}",
            "answer with --voltage cell or --voltage pack" if reading.voltage_of is None else "check --voltage",
        )
    cells = 1 if reading.voltage_of == "cell" else series
    millivolts = " (in millivolts? convert it to V)" if float(np.max(table.voltage)) > 1000.0 else ""
    raise BadInputError(
        str(path),
        f"voltage {_span(table.voltage)}{millivolts}: {cells} in series show {_CELL_V[0] * cells:g} to "
        f"{_CELL_V[1] * cells:g} V",
        "check --series, --voltage and the column",
    )


def _discharging_positive(current: Array, voltage: Array, table: Table, path: Path, reading: Reading) -> Array:
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


def _temperature(table: Table, remarks: list[str]) -> Array | None:
    if table.temperature is None or not np.isfinite(table.temperature).any():
        return None
    known = np.isfinite(table.temperature)
    if known.all():
        return table.temperature
    remarks.append(f"temperature carried over {int((~known).sum())} samples without one")
    return np.interp(table.time, table.time[known], table.temperature[known])


def _counted(table: Table, current: Array) -> Array | None:
    """The charge column, rising while discharging. [C]"""
    if table.charge is None or not np.isfinite(table.charge).all():
        return None
    steps = 0.5 * (current[1:] + current[:-1]) * np.diff(table.time)
    return table.charge if float(steps @ np.diff(table.charge)) >= 0.0 else -table.charge


def _bridged(
    time_s: Array,
    current: Array,
    voltage: Array,
    kelvin: Array | None,
    counted: Array | None,
    path: Path,
    remarks: list[str],
) -> tuple[Array, Array, Array, Array | None]:
    """Gaps: what the charge counter says went out is put back; else a steady current is taken to have gone on."""
    dt = np.diff(time_s)
    usual, most = float(np.median(dt)), float(np.max(np.abs(current)))
    span = 0.0 if counted is None else float(np.ptp(counted))
    places: list[int] = []
    times: list[float] = []
    amps: list[float] = []
    for k in np.flatnonzero(dt > max(20.0 * usual, 100.0)).tolist():
        mean = 0.5 * (current[k] + current[k + 1])
        if counted is not None:
            missing = float(counted[k + 1] - counted[k] - mean * dt[k])
            if abs(missing) > 1e-3 * span:
                lasting = min(0.45 * dt[k], abs(missing) / (_UNSEEN_PER_H * span) * SECONDS_PER_HOUR)
                places += [k + 1] * 3
                times += [time_s[k] + 0.01, time_s[k] + 0.01 + lasting, time_s[k] + 0.02 + lasting]
                amps += [missing / lasting, missing / lasting, 0.0]
            continue
        flowing = abs(mean) > 0.02 * most
        if abs(current[k] - current[k + 1]) > 0.05 * most or (flowing and dt[k] > _BRIDGED_S):
            raise BadInputError(
                str(path),
                f"nothing was recorded for {dt[k]:.0f} s at {time_s[k] - time_s[0]:.0f} s while current flowed: the "
                "charge that went out is not known",
                "give a recording without this gap, or one with a charge_Ah column",
            )
        if flowing:
            remarks.append(f"bridged {dt[k]:.0f} s without samples at {time_s[k] - time_s[0]:.0f} s")
    if not places:
        return time_s, current, voltage, kelvin
    remarks.append(f"put back the charge of {len(places) // 3} gaps, from the charge column")
    filled = np.insert(time_s, places, times)
    warmth = None if kelvin is None else np.interp(filled, time_s, kelvin)
    return filled, np.insert(current, places, amps), np.insert(voltage, places, np.nan), warmth


def _discharges_at_all(experiment: Experiment, path: Path) -> None:
    charge = experiment.charge_c
    went_out = float(np.max(charge - np.minimum.accumulate(charge)))
    if went_out <= _CHARGES * float(np.ptp(charge)) or float(np.max(experiment.current_a)) <= 0.0:
        raise _UselessError(str(path), "only charges: a discharge is needed")


def _one_discharge(experiment: Experiment, remarks: list[str]) -> Experiment:
    """From the charger's end to its next start: on the way up a cell's voltage runs along another branch."""
    charge, charging = experiment.charge_c, experiment.current_a < -_CHARGES * float(np.max(experiment.current_a))
    emptiest = int(np.argmax(charge - np.minimum.accumulate(charge)))
    before, after = np.flatnonzero(charging[:emptiest]), np.flatnonzero(charging[emptiest:])
    first = int(before[-1]) + 1 if before.size else 0
    last = emptiest + int(after[0]) if after.size else charge.size
    if first == 0 and last == charge.size:
        return experiment
    whole = experiment.time_s
    remarks.append(
        f"used is the discharge from {whole[first]:.0f} to {whole[last - 1]:.0f} s; the charge "
        f"{'before and after' if first and last < charge.size else 'before' if first else 'after'} it is left out"
    )
    part = experiment.part(slice(first, last))
    return replace(part, time_s=part.time_s - part.time_s[0], full_at_start=part.full_at_start and first == 0)


def _deep_enough(experiment: Experiment, path: Path, remarks: list[str]) -> None:
    fell = float(np.nanmax(experiment.voltage_v) - np.nanmin(experiment.voltage_v))
    slow = experiment.kind is Kind.SLOW
    if fell < _LEAST_FALL_V:
        raise _UselessError(
            str(path),
            f"is too short to discharge: the cell's voltage moves by {1000 * fell:.0f} mV only",
            "a slow discharge runs from full to empty" if slow else None,
        )
    # Between its ends a cell may be flat: the voltage does not tell whether they were reached.
    if slow and fell < _USUAL_FALL_V:
        remarks.append(
            f"the cell's voltage moves by {1000 * fell:.0f} mV only: taken for a discharge from full to empty"
        )


def _span(values: Array) -> str:
    return f"{float(np.min(values)):.4g} to {float(np.max(values)):.4g}"
