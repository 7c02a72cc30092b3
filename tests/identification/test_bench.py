"""Faulty recordings are mended or refused, each with one sentence that names the file and the way out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from bhm_service.errors import BadInputError
from bhm_service.identification.bench import Bench, read_bench
from bhm_service.identification.bench_table import Reading
from bhm_service.identification.experiment import Kind
from bhm_service.units import SECONDS_PER_HOUR, Array

AMPS, HOURS = 2.5, 2.0
TIME = np.arange(0.0, HOURS * SECONDS_PER_HOUR + 1.0, 10.0)
VOLTS = 4.15 - 1.0 * TIME / TIME[-1]  # of a cell


def table(folder: Path, columns: Mapping[str, Array | list[str]], name: str = "run.csv") -> Path:
    path = folder / name
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def run(current: Array | float = AMPS, voltage: Array = VOLTS, time: Array = TIME) -> dict[str, Array]:
    return {"time_s": time, "current_A": np.broadcast_to(current, time.shape), "voltage_V": voltage}


def read(path: Path, kind: Kind = Kind.RATE, **reading: object) -> list[Bench]:
    return read_bench(path, kind, Reading(**{"series": 1, **reading}))  # type: ignore[arg-type]


def test_a_charge_alone_is_refused(tmp_path: Path) -> None:
    path = table(tmp_path, run(-AMPS, VOLTS[::-1]))
    with pytest.raises(BadInputError, match=r"run\.csv: only charges"):
        read(path)


def test_a_charge_alone_with_an_offset_of_the_sensor_at_rest_is_refused(tmp_path: Path) -> None:
    current = np.where(TIME < 600.0, 0.02, -AMPS)
    with pytest.raises(BadInputError, match="only charges"):
        read(table(tmp_path, run(current, VOLTS[::-1])), Kind.VARIABLE)


@pytest.mark.parametrize("kind", [Kind.SLOW, Kind.ONE_C, Kind.RATE])
def test_a_constant_current_too_short_to_discharge_is_refused(tmp_path: Path, kind: Kind) -> None:
    path = table(tmp_path, run(voltage=VOLTS[:30], time=TIME[:30]))
    with pytest.raises(BadInputError, match="too short to discharge: the cell's voltage moves by 40 mV only"):
        read(path, kind)


def test_a_slow_discharge_of_a_flat_cell_is_used_and_that_is_said(tmp_path: Path) -> None:
    flat = np.interp(TIME, [0.0, TIME[-1]], [4.10, 3.69])
    (bench,) = read(table(tmp_path, run(voltage=flat)), Kind.SLOW)
    assert bench.remarks[-1] == "the cell's voltage moves by 410 mV only: taken for a discharge from full to empty"


def test_of_a_charge_and_a_discharge_only_the_discharge_is_used_and_that_is_said(tmp_path: Path) -> None:
    time = np.arange(0.0, 3 * TIME[-1], 10.0)
    current = np.select([time < 3000.0, time < 3600.0, time < 3600.0 + TIME[-1]], [-AMPS, 0.0, AMPS], 0.0)
    voltage = np.interp(time, [0.0, 3000.0, 3600.0, 3600.0 + TIME[-1], time[-1]], [3.4, 4.2, 4.15, 3.1, 3.3])
    (bench,) = read(table(tmp_path, run(current, voltage, time)))
    assert bench.experiment.charge_c.max() == pytest.approx(AMPS * TIME[-1], rel=0.01)
    assert bench.experiment.current_a.min() == 0.0
    assert bench.experiment.time_s[0] == 0.0
    assert "the charge before it is left out" in bench.remarks[-1]


def test_a_long_gap_under_load_is_refused_and_a_short_one_bridged(tmp_path: Path) -> None:
    long = (TIME < 2000.0) | (TIME > 4000.0)
    with pytest.raises(BadInputError, match="nothing was recorded for 2020 s at 1990 s while current flowed"):
        read(table(tmp_path, run(voltage=VOLTS[long], time=TIME[long])))
    short = (TIME < 2000.0) | (TIME > 2300.0)
    (bench,) = read(table(tmp_path, run(voltage=VOLTS[short], time=TIME[short])))
    assert "bridged 320 s without samples at 1990 s" in bench.remarks
    assert bench.experiment.charge_c[-1] == pytest.approx(AMPS * TIME[-1], rel=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_gap_is_filled_from_the_charge_column_whatever_its_sign(tmp_path: Path, sign: float) -> None:
    kept = (TIME < 2000.0) | (TIME > 4000.0)
    resting = np.where(abs(TIME - 3000.0) < 1020.0, 0.0, AMPS)  # what was recorded around the gap is rest
    counted = sign * np.concatenate([[0.0], np.cumsum(np.full(TIME.size - 1, AMPS * 10.0))]) / SECONDS_PER_HOUR
    columns = {**run(resting[kept], VOLTS[kept], TIME[kept]), "charge_Ah": counted[kept]}
    (bench,) = read(table(tmp_path, columns))
    assert bench.experiment.charge_c[-1] == pytest.approx(AMPS * TIME[-1], rel=0.01)
    assert "put back the charge of 1 gaps, from the charge column" in bench.remarks


@pytest.mark.parametrize("amps", [2.5, 12.0])
def test_swapped_columns_are_noticed(tmp_path: Path, amps: float) -> None:
    columns = run(amps)
    columns["current_A"], columns["voltage_V"] = columns["voltage_V"], columns["current_A"]
    with pytest.raises(BadInputError, match="current and voltage seem to be swapped"):
        read(table(tmp_path, columns))


def test_a_reversed_sign_is_asked_for_and_the_answer_taken(tmp_path: Path) -> None:
    path = table(tmp_path, run(-AMPS))
    with pytest.raises(BadInputError, match=r"negative while discharging\?[\s\S]*--discharge negative"):
        read(path)
    (bench,) = read(path, discharge="negative")
    assert bench.experiment.current_a.min() == AMPS


def test_rows_without_numbers_are_left_out_and_counted(tmp_path: Path) -> None:
    current = np.full(TIME.size, AMPS)
    current[[40, 41, 100]] = np.nan
    (bench,) = read(table(tmp_path, run(current)))
    assert f"left out 3 of {TIME.size} rows without a number (the first is line 42)" in bench.remarks
    assert bench.experiment.charge_c[-1] == pytest.approx(AMPS * TIME[-1], rel=1e-6)


def test_a_table_without_any_number_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no row with time, current and voltage"):
        read(table(tmp_path, run(np.full(TIME.size, np.nan))))


def test_milliampere_are_asked_for_unless_the_column_says_so(tmp_path: Path) -> None:
    path = table(tmp_path, run(1000.0 * AMPS))
    with pytest.raises(BadInputError, match=r"is the current in mA\? It reaches 2500[\s\S]*--current-unit mA"):
        read(path)
    (bench,) = read(path, current_unit="mA")
    assert bench.experiment.current_a[0] == AMPS
    columns = run(1000.0 * AMPS)
    columns["current_mA"] = columns.pop("current_A")
    (bench,) = read(table(tmp_path, columns))
    assert bench.experiment.current_a[0] == AMPS
    assert "current_mA is read as mA, as its name says" in bench.remarks


def test_a_slow_discharge_in_milliampere_is_asked_for(tmp_path: Path) -> None:
    slow = np.arange(0.0, 20.0 * SECONDS_PER_HOUR, 60.0)
    path = table(tmp_path, run(145.0, np.linspace(4.2, 2.6, slow.size), slow))
    with pytest.raises(BadInputError, match="is the current in mA"):
        read(path, Kind.SLOW)


def test_the_voltage_of_a_pack_or_of_a_cell_is_asked_for_where_it_is_open(tmp_path: Path) -> None:
    path = table(tmp_path, run())
    for series in (2, 6):
        with pytest.raises(BadInputError, match=r"voltage of one cell\?[\s\S]*--voltage cell or --voltage pack"):
            read(path, series=series)
    (bench,) = read(path, series=6, voltage_of="cell")
    assert bench.experiment.voltage_v[0] == VOLTS[0]
    (bench,) = read(table(tmp_path, run(voltage=6.0 * VOLTS)), series=6)
    assert bench.experiment.voltage_v[0] == pytest.approx(VOLTS[0])


def test_a_voltage_that_no_pack_of_so_many_cells_has_is_refused(tmp_path: Path) -> None:
    path = table(tmp_path, run(voltage=6.0 * VOLTS))
    for reading in ({"series": 1}, {"series": 12}, {"series": 6, "voltage_of": "cell"}):
        with pytest.raises(BadInputError, match="check --series"):
            read(path, **reading)


def test_unknown_columns_are_asked_for_and_the_answer_taken(tmp_path: Path) -> None:
    columns = run()
    columns["flow"] = columns.pop("current_A")
    path = table(tmp_path, columns)
    with pytest.raises(BadInputError, match=r"which column is the current\? It has time_s, voltage_V, flow"):
        read(path)
    (bench,) = read(path, columns={"current": "flow"})
    assert bench.experiment.current_a[0] == AMPS
    with pytest.raises(BadInputError, match="no column 'flwo'; it has time_s, voltage_V, flow"):
        read(path, columns={"current": "flwo"})


def test_labels_part_a_table_and_parts_that_only_charge_are_left_out(tmp_path: Path) -> None:
    up = run(-AMPS, VOLTS[::-1])
    columns: dict[str, Array | list[str]] = {key: np.concatenate([up[key], down]) for key, down in run().items()}
    columns["label"] = ["charge"] * TIME.size + ["discharge"] * TIME.size
    (bench,) = read(table(tmp_path, columns))
    assert bench.experiment.label == "run.csv [discharge]"
    assert "left out 1 of 2 parts, the first of which only charges: a discharge is needed" in bench.remarks


def test_a_temperature_in_kelvin_is_taken_as_such_and_said(tmp_path: Path) -> None:
    for degrees in (25.0, 298.15):
        (bench,) = read(table(tmp_path, {**run(), "temperature": np.full(TIME.size, degrees)}))
        assert bench.experiment.temperature_k is not None
        assert bench.experiment.temperature_k[0] == pytest.approx(298.15)
    assert "temperature is read as kelvin: no cell is that warm in degC" in bench.remarks
