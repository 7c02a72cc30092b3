"""`bhm explain` as people call it: what it writes, and what it says of input that cannot be used."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from discrepancy.flown import BATTERY
from discrepancy.tables import columns, write

from bhm_service.battery.battery_file import write_battery
from bhm_service.cli import main


@pytest.fixture
def battery(tmp_path):
    path = tmp_path / "known.toml"
    write_battery(path, BATTERY)
    return path


@pytest.fixture
def bhm(monkeypatch, capsys, battery, tmp_path):
    """Run `bhm explain`; exit status, what it printed, what it complained of."""

    def run(*args):
        words = ["bhm", "explain", *map(str, args), "--battery", str(battery), "-o", str(tmp_path / "out")]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        return ended.value.code, said.out, said.err

    return run


def sentence(err):
    """The one message, its lines joined; there is nothing else."""
    lines = [line.strip() for line in err.strip().splitlines()]
    assert lines[0].startswith("bhm: ")
    assert not any("Traceback" in line for line in lines)
    assert len(lines) <= 2
    return " ".join(lines)


NO_CURRENT = columns(I=np.full(240, np.nan))


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ([columns()], "1 usable flight, 2 are needed"),
        ([columns(), columns(seconds=40.0)], "1.csv: lasts 39 s only; 60 s are needed"),
        ([NO_CURRENT, NO_CURRENT], "0.csv: has no measured current; 1.csv: has no measured current"),
        ([columns(cells=3), columns(cells=3)], "the battery file has 6 cells"),
        ([columns(), columns(cells=3)], "the log looks like 3"),
    ],
    ids=["one flight", "too short", "no current", "other series count", "packs mixed"],
)
def test_flights_that_cannot_be_explained_end_with_one_sentence_and_status_two(bhm, tmp_path, tables, said):
    status, _, err = bhm(*(write(tmp_path / f"{k}.csv", rows) for k, rows in enumerate(tables)))
    assert status == 2
    assert said in sentence(err)
    assert not (tmp_path / "out" / "findings.json").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("file,cycles\nother.tlog,3\n", "none of its files is among the logs"),
        ("file,cycles\n0.csv,often\n", "cycles = 'often' is not a number"),
        ("file,rest_voltage_V\n0.csv,15.2\n1.csv,15.2\n", "rest_voltage_V = 15.2, but the log ends at"),
    ],
    ids=["other files", "no number", "another pack"],
)
def test_a_sidecar_that_contradicts_the_logs_is_refused_in_one_sentence(bhm, tmp_path, text, said):
    logs = [write(tmp_path / f"{k}.csv", columns()) for k in range(2)]
    (tmp_path / "flights.csv").write_text(text)
    status, _, err = bhm(*logs, "--sidecar", tmp_path / "flights.csv")
    assert status == 2
    assert said in sentence(err)


def test_a_battery_file_that_is_not_there_is_named(bhm, tmp_path, battery):
    battery.unlink()
    status, _, err = bhm(write(tmp_path / "0.csv", columns()))
    assert status == 2
    assert "known.toml" in err


def test_a_wrong_demand_table_of_the_vehicle_is_refused_before_the_search(bhm, tmp_path):
    vehicle = tmp_path / "v.toml"
    vehicle.write_text('name = "v"\n[battery]\nfile = "known.toml"\n[[demand]]\nid = "climb-power"\ninduced = 9.0\n')
    status, _, err = bhm(write(tmp_path / "0.csv", columns()), "--vehicle", vehicle)
    assert status == 2
    assert "climb-power" in sentence(err) and "9 is outside 0 ... 2" in sentence(err)


def test_it_writes_findings_prints_them_and_leaves_out_what_is_unusable(bhm, tmp_path):
    logs = [write(tmp_path / f"{k}.csv", columns(amps=14.0 + k)) for k in range(2)]
    short = write(tmp_path / "short.csv", columns(seconds=50.0))
    status, out, _ = bhm(*logs, short)
    assert status == 0
    written = json.loads((tmp_path / "out" / "findings.json").read_text())
    assert written["verdict"] in out
    assert "short.csv" in out
    assert "lasts 49 s only" in out
    assert len(out.splitlines()) < 40
    assert max(len(line) for line in out.splitlines() if str(tmp_path) not in line) <= 100


def test_an_effect_that_is_told_and_no_effect_of_a_pack_is_refused(bhm, tmp_path):
    logs = [write(tmp_path / f"{k}.csv", columns()) for k in range(2)]
    status, _, err = bhm(*logs, "--told", "capacity-fade+payload-mass")
    assert status == 2
    assert "no effect of a pack is called 'payload-mass'" in err
    assert "capacity-fade, resistance-growth" in err


def test_an_effect_that_is_told_and_cannot_be_measured_is_refused_with_the_reason(bhm, tmp_path):
    logs = [write(tmp_path / f"{k}.csv", columns()) for k in range(2)]
    status, _, err = bhm(*logs, "--told", "self-discharge")
    assert status == 2
    assert "self-discharge: needs storage, which is not recorded" in " ".join(err.split())


def test_json_is_the_findings_and_nothing_else(bhm, tmp_path):
    logs = [write(tmp_path / f"{k}.csv", columns(amps=14.0 + k)) for k in range(2)]
    status, out, _ = bhm(*logs, "--json")
    assert status == 0
    assert json.loads(out) == json.loads((tmp_path / "out" / "findings.json").read_text())
