"""What an identification looks like, on the page and in the terminal."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from identification.known import cell_of, one_c, slow, variable
from rich.console import Console

from bhm_service.battery.battery_file import Joined
from bhm_service.battery.effects import SlowDiffusion
from bhm_service.battery.pack import PackModel
from bhm_service.identification.identify import Request, identify
from bhm_service.reporting.identified import headline, open_questions, parameters, quality, resistance
from bhm_service.reporting.identified_figure import open_circuit
from bhm_service.reporting.identified_page import identified_page
from bhm_service.reporting.identified_terminal import identified_tables


@pytest.fixture(scope="module")
def done():
    """A Circ cell identified from a slow and a one-C discharge, a variable one held out with its best fit."""
    rng = np.random.default_rng(5)
    pack = PackModel(cell_of("circ", rng), 1)
    made = (slow(pack, rng), one_c(pack, rng, step_s=2.0), variable(pack, rng))
    recordings = tuple(recording.thinned(150) for recording in made)
    request = Request(
        experiments=recordings[:2], held_out=recordings[2:], oracle=True, series=6, models=("circ",),
        method="nelder-mead", name="<bench> & pack",
    )  # fmt: skip
    return identify(request)


def printed(identified):
    stream = io.StringIO()
    console = Console(file=stream, width=100, highlight=False)
    for table in identified_tables(identified):
        console.print(table)
    return stream.getvalue()


def test_terminal_stays_within_a_hundred_columns_and_cuts_nothing_off(done):
    text = printed(done)
    assert max(len(line) for line in text.splitlines()) <= 100
    assert "…" not in text
    assert "RMSE [mV]" in text  # not taken for markup


def test_terminal_survives_names_as_long_as_a_path(done):
    identified = done
    (result,) = identified.results
    long = tuple(replace(a, label="discharge_" * 9 + "25degC.csv.gz") for a in result.assessments)
    text = printed(replace(identified, results=(replace(result, assessments=long),)))
    assert max(len(line) for line in text.splitlines()) <= 100
    assert "…" not in text


def test_page_needs_nothing_else(done):
    page = identified_page(done)
    outside = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href)="', outside)
    assert "&lt;bench&gt; &amp; pack" in outside


def test_page_and_terminal_show_every_recording_and_what_was_held_out(done):
    page, text = identified_page(done), printed(done)
    for shown in (page, text):
        for label in ("slow", "one-C", "variable", "held out", "best possible"):
            assert label in shown
    assert [row[1] for row in quality(done)] == ["fitted", "fitted", "held out"]


def test_errors_shown_are_those_of_the_voltages_drawn(done):
    a = done.results[0].assessments[1]
    good = a.experiment.measured & (a.soc > 0.1)
    rmse = np.sqrt(np.mean((a.modelled_v - a.experiment.voltage_v)[good] ** 2))
    assert quality(done)[1][3] == f"{1e3 * rmse:.1f} mV"
    assert "a fit to it alone reaches" in headline(done)[0]


@pytest.mark.parametrize(("error_v", "tone"), [(0.008, "good"), (0.06, "warn")])
def test_a_model_that_misses_what_it_was_fitted_to_is_no_good_news(done, error_v, tone):
    first, *others = done.results[0].assessments
    assessed = (replace(first, whole=replace(first.whole, rmse=error_v)), *others)
    page = identified_page(replace(done, results=(replace(done.results[0], assessments=assessed),)))
    assert f'<p class="{tone}">circ: ' in page


@pytest.mark.parametrize(("volts", "said"), [(0.0123, True), (float("nan"), False)])
def test_what_a_varying_load_is_foretold_to_is_said_where_one_was_recorded(done, volts, said):
    (sentence,) = headline(replace(done, results=(replace(done.results[0], flying_v=volts),)))
    assert ("12.3 mV on a varying load that the other recordings foretell" in sentence) is said


def test_every_parameter_of_the_cell_has_its_spread_or_says_why_not(done):
    rows = {row.cells[0]: row for row in parameters(done.results[0])}
    assert list(rows) == ["C_max", "R_s", "R_sp0", "R_sp1", "R_sp2", "C_sp"]
    assert rows["C_max"].cells[2] == "held"
    assert all(row.cells[2] for row in rows.values())
    sd = done.battery.sd["circ"]["r_s"]
    assert rows["R_s"].cells[2] == f"{sd:.2g}"


def test_a_number_that_was_not_told_carries_no_standard_deviation(done):
    result = done.results[0]
    untold = replace(result, not_told=("r_s",))
    row = next(row for row in parameters(untold) if row.cells[0] == "R_s")
    assert not row.told
    assert row.cells[2] == "not told"


def test_the_spread_of_a_number_that_is_next_to_nothing_is_told_as_beyond_its_size(done):
    (result,) = done.results
    unknowns, x = result.solution.problem.unknowns, result.solution.x.copy()
    x[unknowns.slice_of("r_sp2")] = 1e-12
    row = next(r for r in parameters(replace(result, solution=replace(result.solution, x=x))) if r.cells[0] == "R_sp2")
    assert "> 1000%" in row.cells[4:6]


def test_what_is_left_open_is_told_by_symbols_and_of_which_effect(done):
    result = done.results[0]
    pair = Joined(effect=SlowDiffusion(resistance=1e-3, time_constant=100.0), model="circ")
    left = replace(result, joined=(pair, pair), not_told=("r_s", "slow_time", "slower_resistance"))
    (told,) = [line for line in open_questions(left) if line.startswith("not told")]
    assert told.endswith(": R_s, tau_2 of slow-diffusion, R_2 of the second slow-diffusion")


def test_step_resistance_stands_beside_the_models_own(done):
    measured, own = resistance(done)
    assert measured.startswith("measured at 2 steps")
    assert own.startswith("circ at the steps of the fit")


def test_curve_is_known_best_where_recordings_were(done):
    volts, sd = open_circuit(done.results[0])
    assert np.all(np.diff(volts) > 0.0)
    assert 0.0 < float(np.median(sd)) < 0.01
