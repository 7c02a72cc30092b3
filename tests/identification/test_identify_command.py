"""`bhm identify` as people call it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bhm_service.battery.battery_file import read_battery
from bhm_service.cli import cli
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.errors import BadInputError

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"
needs_cases = pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is absent")


def run(*args: str | Path) -> str:
    result = CliRunner().invoke(cli, ["identify", *map(str, args)], catch_exceptions=False, standalone_mode=False)
    return result.output


@needs_cases
def test_a_fast_discharge_alone_gives_a_battery_file_that_reads_back(tmp_path: Path) -> None:
    output = tmp_path / "mine.toml"
    said = run(
        "--one-c", CASES / "null/lab/one_c.csv.gz", "--series", "6", "--model", "circ", "--ocv", "spline", "-o", output
    )  # fmt: skip
    battery = read_battery(output)
    assert battery.name == "mine"
    assert battery.series == 6
    assert battery.circ is not None
    assert battery.chem is None
    assert list(battery.left_open) == ["circ"]
    assert lab_of(battery, "circ", None, None).left_open is not None
    assert "no slow discharge" in said
    assert "columns: time from time_s" in said
    assert "Parameters, circ" in said
    assert "mine: identified" in (tmp_path / "mine.html").read_text(encoding="utf-8")


@needs_cases
def test_the_page_goes_where_it_is_wanted(tmp_path: Path) -> None:
    run(
        "--one-c", CASES / "null/lab/one_c.csv.gz", "--series", "6", "--model", "circ", "--method", "nelder-mead",
        "-o", tmp_path / "mine.toml", "--report", tmp_path / "page.html",
    )  # fmt: skip
    assert (tmp_path / "page.html").is_file()
    assert not (tmp_path / "mine.html").exists()


def test_a_page_for_which_there_is_no_folder_is_refused_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="its folder does not exist"):
        run(
            "--slow", tmp_path / "slow.csv", "--series", "6", "-o", tmp_path / "out.toml",
            "--report", tmp_path / "absent" / "page.html",
        )  # fmt: skip


def test_an_option_takes_several_files_and_one_that_is_not_there_is_named(tmp_path: Path) -> None:
    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    one.write_text("t_s,V,I\n" + "".join(f"{t},{4.2 - t / 2000},1.0\n" for t in range(1000)))
    with pytest.raises(BadInputError, match=r"two\.csv: no such file"):
        run("--rate", one, two, "--series", "1", "-o", tmp_path / "out.toml")


def test_without_recordings_or_cells_the_question_names_the_option(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="--slow"):
        run("--series", "6", "-o", tmp_path / "out.toml")
    with pytest.raises(BadInputError, match="--series N"):
        run("--slow", tmp_path / "slow.csv", "-o", tmp_path / "out.toml")


def test_flights_alone_need_neither_cells_nor_capacity_told(data: Path, tmp_path: Path) -> None:
    output = tmp_path / "flown.toml"
    said = run("--flights", *sorted((data / "flights/tlog").glob("acuasi*.tlog")), "--model", "circ", "-o", output)
    battery = read_battery(output)
    assert battery.series == 4
    assert battery.circ is not None
    assert not battery.left_open  # no lab has seen this pack
    assert "4.0 Ah, from BATT_CAPACITY" in said
    assert "so left near what was assumed: capacity" in said


def test_flights_of_which_one_is_from_a_full_lihv_pack_begin_from_such_a_cell(data: Path, tmp_path: Path) -> None:
    flights = [data / f"flights/wadl_m100/{name}.csv" for name in ("msl_20200121_211644", "waddle3_20200112_142509")]
    said = run("--flights", *flights, "--model", "circ", "-o", tmp_path / "flown.toml")
    battery = read_battery(tmp_path / "flown.toml")
    assert battery.series == 6
    assert battery.circ is not None
    assert "LiHV cells, charged to 4.35 V, by waddle3_20200112_142509.csv" in said
    full, half = (float(np.asarray(battery.circ.open_circuit(soc))) for soc in (1.0, 0.5))
    assert full == pytest.approx(4.335, abs=0.02)
    assert half == pytest.approx(3.855, abs=0.03)  # a LiPo's is 3.81 V
    # The packs' own gauge counts 5.3 Ah from full to where it shows none, and a twentieth is left there.
    assert float(np.asarray(battery.circ.c_max)) / 3600.0 == pytest.approx(5.3 / 0.95, rel=2 * 0.08)


def test_flights_and_bench_recordings_do_not_mix(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="--flights stands alone"):
        run("--flights", tmp_path / "a.tlog", "--slow", tmp_path / "s.csv", "--series", "4", "-o", tmp_path / "o.toml")
