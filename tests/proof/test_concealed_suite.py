"""The concealed world as the assessor has it: what is kept back, what is translated, what a tool gets."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from bhm_service.mavlink.log import read_log
from sim.concealed.sheets import CaseSheet, EffectSheet
from sim.proof.cases import Case
from sim.proof.concealed_cases import ConcealedCase, concealed
from sim.proof.flying_time import errors_s
from sim.proof.scoring.answers import answer_from_json, answer_to_json
from sim.proof.suites import SUITES

HELD = 1


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder, held = tmp_path_factory.mktemp("cases"), tmp_path_factory.mktemp("held")
    sheet = CaseSheet(suite="try", seed=8, index=0, kind="single", flights=3, temperature_recorded=False,
                      effects=(EffectSheet("current-gain", "large"),))  # fmt: skip
    (answer,) = ConcealedCase(sheet, HELD)(folder, held)
    return Case(folder / answer.case), held / answer.case, answer


def test_the_flight_that_is_kept_back_is_nowhere_in_what_is_shown(made):
    case, held, answer = made
    assert [path.name for path in case.flights] == ["00.tlog", "02.tlog"]
    assert [path.name for path in held.iterdir()] == ["01.tlog"]
    with case.sidecar.open(newline="") as stream:
        assert [row["file"] for row in csv.DictReader(stream)] == ["00.tlog", "02.tlog"]
    assert set(answer.held) == {"01.tlog"}
    assert "01.tlog" not in {*answer.samples, *answer.hidden, *answer.starts_s}
    log = read_log(held / "01.tlog")
    assert answer.held["01.tlog"] > log.span_s[1] - log.span_s[0] - 200.0  # it landed before it was empty


def test_the_lab_of_a_case_has_the_three_runs_that_identify_takes(made):
    case, _, _ = made
    assert list(case.lab) == ["--slow", "--one-c", "--variable"]
    assert case.series == 6


def test_a_withheld_temperature_is_in_the_answer_on_the_logs_own_clock(made):
    case, _, answer = made
    assert set(answer.hidden) == {"00.tlog", "02.tlog"}
    for path in case.flights:
        begin, end = read_log(path).span_s
        assert answer.starts_s[path.name] == pytest.approx(begin, abs=1.0)
        assert answer.hidden[path.name]["time_s"][-1] <= end - begin + 31.0


def test_true_sizes_are_in_the_catalogues_own_parameters(made):
    from bhm_service.battery.effects import EFFECTS
    from bhm_service.battery.parameters import parameters_of
    from bhm_service.prediction.demand_effects import DEMAND_EFFECTS
    from sim.proof.concealed_cases import _TRANSLATED

    for effect, sizes in _TRANSLATED.items():
        units = {p.name: p.unit for p in parameters_of((EFFECTS | DEMAND_EFFECTS)[effect])}
        for ours, unit, _ in sizes.values():
            assert units[ours] == unit, (effect, ours)
    _, _, answer = made
    gain = answer.parameters["current-gain"]["gain"].value
    assert 0.02 < abs(gain) < 0.3
    # read / true = 1 / (1 + gain): an under-reading sensor misses current
    assert answer_from_json(answer_to_json(answer)) == answer


def test_a_suite_is_the_same_for_a_seed_and_another_for_another():
    drawn = [concealed("quick", seed, 10) for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1]
    assert drawn[0] != drawn[2]
    assert {case.sheet.flights for case in drawn[0]} == {7}
    assert {(case.held, case.sheet.kept_back) for case in drawn[0]} == {(6, 6)}  # the one that comes next
    assert SUITES["exam"].cases >= 300
    nulls = [c for c in concealed("exam", 5, SUITES["exam"].cases) if not c.sheet.effects]
    assert len(nulls) >= 100
    assert SUITES["truth"].cases >= 40


def test_the_shown_flights_do_not_depend_on_which_is_kept_back(made, tmp_path):
    case, _, _ = made
    sheet = CaseSheet(suite="try", seed=8, index=0, kind="single", flights=3, temperature_recorded=False,
                      effects=(EffectSheet("current-gain", "large"),))  # fmt: skip
    ConcealedCase(replace(sheet), 0)(tmp_path, tmp_path / "held")
    again = tmp_path / case.name / "flights" / "02.tlog"
    assert again.read_bytes() == (case.folder / "flights" / "02.tlog").read_bytes()


def test_the_error_of_the_flying_time_is_of_the_second_half_of_the_flight(tmp_path):
    path, rows = tmp_path / "00.csv", []
    for t in range(100):
        late = 7.0 if t >= 50 else 1000.0
        rows.append([1.7e9 + t, int(t >= 10), 500.0 - t + late if t % 2 else ""])
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([["time_s", "airborne", "rft_s"], *rows])
    errors = errors_s(path, 500.0)
    assert len(errors) == 23
    assert np.allclose(errors, 7.0)
