"""What an explanation looks like, on the page and in the terminal."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from discrepancy.explained import MIMIC, NAME, RIVAL, explanation
from discrepancy.ridden import ridden, vehicle
from rich.console import Console

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.candidate import NotExcited
from bhm_service.discrepancy.demand_side import demand_side
from bhm_service.discrepancy.explanation import Contest
from bhm_service.discrepancy.findings import ChangePoint, EffectFound, Quantity, Region
from bhm_service.discrepancy.flights import LeftOut
from bhm_service.discrepancy.selection import Selection
from bhm_service.reporting import explained_tables as tables
from bhm_service.reporting.explained import explained_lines, explained_page
from bhm_service.reporting.explained_demand import power_figure
from bhm_service.reporting.explained_figure import held_out_figure, hidden_figure, map_figure


@pytest.fixture(scope="module")
def done():
    return explanation()


def outside(page):
    """The page without its scripts: what is read."""
    return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def printed(e, width=100):
    stream = io.StringIO()
    console = Console(file=stream, width=width, highlight=False)
    for line in explained_lines(e):
        console.print(line)
    return stream.getvalue()


def saying(e, **changes):
    """The same with other findings."""
    return replace(e, findings=e.findings.model_copy(update=changes))


def nothing_found(e, verdict):
    bare = replace(
        e, selection=Selection(frozenset(), (), {}, {}), contests=[], in_words=[], flying=[], left_out=[],
        not_excited=[], held_out=None,
    )  # fmt: skip
    return saying(bare, verdict=verdict, effects=[], localisation=[], battery_file=None)


# ---- page -----------------------------------------------------------------------------------------------------------


def test_page_needs_nothing_else_and_takes_no_name_for_markup(done):
    page = outside(explained_page(replace(done, battery=replace(done.battery, name="<worn> & old"))))
    assert not re.findall(r'(?:src|href)="', page)
    assert "&lt;worn&gt; &amp; old" in page


def test_page_begins_with_the_verdict_and_goes_from_where_to_numbers(done):
    page = outside(explained_page(done))
    heads = re.findall(r"<h2>(.*?)</h2>", page)
    assert page.index(done.sentence) < page.index("<h2>")
    assert heads == [
        "Where the battery file is off",
        "What is missing",
        "Voltage before and after",
        "What else it could have been, and why not",
        "Phantom drivers",
        "What it changes for remaining flying time",
        "What these recordings cannot show, and the next flight",
        "Recordings that were left out",
        "Numbers",
    ]


def test_an_effect_is_told_by_equation_words_and_numbers(done):
    page = outside(explained_page(done))
    for text in ("R = R_25 exp[E_a", done.in_words[0], "21.70 ± 0.83 kJ/mol", "activation energy of the resistance"):
        assert text in page


def test_what_is_not_known_is_not_shown(done):
    page = outside(explained_page(nothing_found(done, "none")))
    for absent in ("Phantom", "flying time", "What is missing", "no sensor", "left out", "nan", "None"):
        assert absent not in page
    assert "on flights that no fit saw" in page  # its numbers are there
    assert "What was tried" in page


def test_where_nothing_is_missing_unseen_flights_are_followed_by_adjusted_numbers(done):
    bare = replace(nothing_found(done, "unknown"), held_out=done.held_out)
    assert tables.fit_header(bare)[2] == "its numbers adjusted"
    assert tables.fit(bare)[1] == ("on flights that no fit saw", "402 mV", f"{1e3 * done.held_out.tuned_v:.0f} mV")
    assert tables.fit_header(done)[2] == "explanation"


@pytest.mark.parametrize("verdict", ["none", "parameter", "unknown", "not-excited", "ambiguous", "sensor-suspect"])
def test_every_verdict_has_its_page(done, verdict):
    for e in (nothing_found(done, verdict), saying(done, verdict=verdict, unexplained_rest=0.2)):
        assert "<h2>Numbers</h2>" in explained_page(e)
        assert printed(e).startswith(verdict)


def test_without_held_out_flights_the_page_says_that_it_shows_the_fit(done):
    page = outside(explained_page(replace(done, held_out=None)))
    assert "this is the fit itself" in page
    assert "predict" not in page


@pytest.mark.parametrize("assumed", [True, False])
def test_the_page_says_where_the_battery_as_it_is_begins_with_the_charge_that_is_assumed(done, assumed):
    e = replace(done, held_out=replace(done.held_out, from_assumed=assumed))
    assert ("begins with\nthe charge that is assumed" in outside(explained_page(e))) is assumed


def test_the_flights_drawn_are_those_that_are_predicted_worst_before_and_after(done):
    flights = {f.label: f for f in done.held_out.flights}
    (_, before), (_, after) = tables.worst(done)
    assert before.label == max(flights, key=lambda k: flights[k].rmse(flights[k].before_v)) == "01.tlog"
    assert after.label == max(flights, key=lambda k: flights[k].rmse(flights[k].after_v)) != "01.tlog"
    page = outside(explained_page(done))
    assert "Flight 01, which the battery file predicts worst" in page
    lines = {t.name: np.asarray(t.y, dtype=float) for t in held_out_figure(done, before).data if t.y[0] is not None}
    assert lines["explanation"] == pytest.approx(before.after_v, rel=1e-6)
    assert lines["measured - battery file"] == pytest.approx(1e3 * (before.measured_v - before.before_v), abs=1e-2)


def test_errors_in_the_table_are_those_of_the_part_that_was_predicted(done):
    told = done.held_out.flights[0]
    off = (told.measured_v - told.after_v)[told.begin :]
    assert tables.held_out(done)[0][3] == f"{1e3 * np.sqrt(np.mean(off**2)):.0f} mV"


def test_the_map_shades_what_the_findings_mark(done):
    plot = map_figure(done)
    shaded = [s for s in plot.layout.shapes if s.type == "rect"]
    axes = {plot.layout[f"xaxis{s.xref[1:]}"].title.text: (s.x0, s.x1) for s in shaded}
    assert axes == {"pack temperature [degC]": (3.0, 10.0), "flight": (-0.5, 0.5)}
    assert {m.variable for m in done.maps} >= {"temperature_C", "soc", "flight"}


def test_hidden_states_are_drawn_with_their_band_in_everyday_units(done):
    hidden = {"temperature": (done.courses[0].flight.temperature_k, np.full(150, 2.0))}
    inferred = replace(done, courses=[replace(done.courses[0], hidden=hidden), *done.courses[1:]])
    band, line = hidden_figure(inferred).data
    assert np.asarray(line.y, dtype=float) == pytest.approx(np.full(150, 4.0), abs=1e-3)
    assert np.ptp(np.asarray(band.y, dtype=float)) == pytest.approx(2 * 1.645 * 2.0, abs=1e-3)
    assert "Pack temperature" in explained_page(inferred)
    assert hidden_figure(done) is None


def test_change_points_are_drawn_on_their_flights(done):
    stepped = saying(done, change_points=[ChangePoint(flight="02.tlog", time_s=125.0)])
    page = explained_page(stepped)
    assert "<td>2:05</td>" in page
    assert "02.tlog" in {f.label for _, f in tables.worst(stepped)} or "<h3>Flight 02</h3>" in page
    assert "flight 02 at 2:05" in printed(stepped)


@pytest.mark.parametrize(("alternatives", "said"), [([[RIVAL]], ", which one of its alternatives has"), ([], "")])
def test_what_earned_less_than_is_asked_for_stands_by_a_likelier_alternative(done, alternatives, said):
    """Or by what the reader told it."""
    less = [done.findings.effects[0].model_copy(update={"evidence_nats": 2.0})]  # of a law that needs three
    page = outside(explained_page(saying(done, effects=less, alternatives=alternatives)))
    assert f"2.0 nats beyond the best explanation without it; 3 are asked for{said}." in page


def test_evidence_that_is_measured_beside_the_packs_voltage_is_told_apart(done):
    tried = tuple(replace(c, credit=21.0) if c.id == NAME else c for c in done.search.candidates)
    told = replace(done, search=replace(done.search, candidates=tried))
    said = "Of its evidence 21 nats are of the voltages of single cells."
    assert said in outside(explained_page(told))
    assert said not in outside(explained_page(done))


# ---- what else it could have been -----------------------------------------------------------------------------------


def test_rivals_stand_with_the_evidence_that_the_search_gave_them(done):
    rows = {row[0]: row for row in tables.rivals(done)}
    for name in (RIVAL, MIMIC):
        behind = done.search.evidence(frozenset({NAME})) - done.search.evidence(frozenset({name}))
        assert rows[EFFECTS[name].title][1].startswith(f"{behind:.0f}" if behind >= 10.0 else f"{behind:.1f}")
    assert rows[EFFECTS[RIVAL].title][2] == "ruled out"
    assert rows[EFFECTS[MIMIC].title][2].startswith("unlikely, 1 to ")
    assert rows[EFFECTS[MIMIC].title][3] == EFFECTS[NAME].manoeuvre


def test_alternatives_come_first_and_are_not_ruled_out(done):
    rows = tables.rivals(saying(done, alternatives=[[RIVAL], ["hysteresis", "current-gain"]]))
    assert [row[2] for row in rows[:2]] == ["cannot be told apart"] * 2
    assert rows[1][:2] == ("The current sensor's scale is off + Voltage remembers charging", "-")


def test_a_better_fit_that_was_refused_says_why(done):
    better = replace(done, selection=Selection(frozenset({MIMIC}), (), {MIMIC: 9.0}, {MIMIC: 0.1}))
    row = next(row for row in tables.rivals(better) if row[0] == EFFECTS[NAME].title)
    assert row[1].endswith("ahead")
    assert row[2].startswith("refused")


# ---- numbers --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "unit", "value", "row"),
    [
        ("activation_energy", "kJ/mol", 21.7, ("E_a", "21.70 ± 0.83 kJ/mol", "activation energy of the resistance")),
        ("self-heating.conductance", "W/K", 4.5,
         ("hA", "4.50 ± 0.83 W/K", "heat that it gives to the air, per kelvin")),
        ("self-heating.ambient[00.tlog]", "K", 278.15,
         ("T_ambient", "5.00 ± 0.83 degC", "temperature of the air around the pack (flight 00)")),
        ("self-heating.start_above[00.tlog]", "K", 3.0,
         ("dT_0", "3.00 ± 0.83 K", "what the pack is warmer than the air at the start (flight 00)")),
        ("nothing-known", "1", 2.0, ("nothing-known", "2.00 ± 0.83", "")),
    ],
)  # fmt: skip
def test_a_parameter_is_told_by_symbol_unit_meaning_and_flight(done, key, unit, value, row):
    told = {key: Quantity(value=value, sd=0.83, unit=unit)}
    found = done.findings.effects[0].model_copy(update={"parameters": told})
    (block,) = tables.effects(saying(done, effects=[found]))
    assert block.parameters == [row]


@pytest.mark.parametrize(
    ("value", "sd", "text"), [(28.93, 1.2, "28.9 ± 1.2"), (0.0932, 0.0041, "0.0932 ± 0.0041"), (3.0, 0.0, "3")]
)
def test_a_number_has_the_digits_that_its_spread_leaves(value, sd, text):
    assert tables.with_sd(value, sd) == text


def test_flying_time_that_was_promised_and_is_not_there_is_said(done):
    assert tables.flying(done)[0] == ("01", "11:40", "10:40", "-1:00")
    assert tables.flying_in_words(done) == (
        "The battery file promises up to 1:00 min more flying time than there is (flight 01)."
    )


@pytest.mark.parametrize(("verdict", "said"), [("parameter", True), ("none", False), ("unknown", False)])
def test_flying_time_is_said_of_a_pack_whose_own_numbers_moved_and_of_none_where_nothing_did(done, verdict, said):
    assert bool(tables.flying_in_words(saying(done, verdict=verdict, effects=[]))) is said


# ---- terminal -------------------------------------------------------------------------------------------------------


def test_terminal_says_verdict_effect_errors_and_what_is_left_out(done):
    text = " ".join(printed(done).split())
    for part in (done.sentence, "E_a = 21.70 ± 0.83 kJ/mol", "402 mV 13 mV", "hop.tlog", "beaten: 1 of 2"):
        assert part in text


def test_the_fullest_explanation_stays_under_forty_lines_and_within_a_hundred_columns(done):
    ids = ["partial-charge", "hysteresis", "intermittent-contact", "charge-transfer"]
    effects = [
        EffectFound(
            id=name, evidence_nats=100.0, p_familywise=0.005, share_of_misfit=0.3, decoys_beaten=None,
            parameters={
                f"{p.name}{part}": Quantity(value=1.0, sd=0.1, unit=p.unit)
                for p in EFFECTS[name].parameters() for part in ("", "[a.tlog]", "[b.tlog]", "#x")
            },
        )
        for name in ids
    ]  # fmt: skip
    region = Region(
        where={"temperature_C": (3.0, 10.0), "since_takeoff_s": (0.0, 300.0)}, flights=["01.tlog"],
        share_of_misfit=0.81, sign=-1,
    )  # fmt: skip
    full = saying(
        done,
        verdict="ambiguous",
        effects=effects,
        alternatives=[[a, b] for a in list(EFFECTS)[:4] for b in list(EFFECTS)[4:9]],
        localisation=[region] * 4,
        change_points=[ChangePoint(flight=f"a long name {k}.tlog", time_s=100.0) for k in range(20)],
        advice=["an advice that is rather long " * 5] * 6,
        unexplained_rest=0.3,
    )
    full = replace(
        full,
        sentence="a sentence that does not end soon " * 10,
        in_words=["words about the size of an effect " * 7] * 4,
        contests=[Contest("x", 10.0, True)] * 5,
        not_excited=[NotExcited(name, "because " * 20) for name in EFFECTS],
        left_out=[LeftOut(f"{k} {'very ' * 10}long.tlog", "of a reason " * 12) for k in range(9)],
    )
    lines = printed(full).splitlines()
    assert len(lines) < 40
    assert max(map(len, lines)) <= 100


# ---- demand ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def climbed(done):
    return replace(done, demand=demand_side(vehicle(), [ridden(k) for k in range(3)]))


def test_page_tells_of_power_what_it_tells_of_voltage(climbed):
    page = outside(explained_page(climbed))
    assert "Demand: The vehicle file leaves out physics of the demand: climbing costs power." in page
    assert re.search(r"Climbing at 3 m/s costs \d\d % more power", page)
    assert "On the same energy flight" in page and "vehicle.toml" in page


def test_page_tells_what_was_asked_of_each_demand_effect(climbed):
    for asked_for in (3.0, 17.0):
        page = outside(explained_page(replace(climbed, demand=replace(climbed.demand, asked_for=(asked_for,)))))
        assert f"nats beyond the best explanation without it; {asked_for:.0f} are asked for." in page


def test_power_figure_shows_measured_before_and_after_with_units(climbed):
    plot = power_figure(climbed.demand, climbed.demand.courses[0])
    assert {"measured", "vehicle file", "explanation"} <= {trace.name for trace in plot.data}
    assert plot.layout.yaxis.title.text == "Power [W]"


def test_terminal_tells_of_the_demand_and_stays_short(climbed):
    text = printed(climbed)
    assert "demand: The vehicle file leaves out" in text and "Climbing at 3 m/s" in text
    assert len(text.splitlines()) < 40


def test_demand_that_was_not_looked_at_is_one_line(done):
    assert "demand: not looked at: no vehicle file was given (--vehicle)." in printed(done)
    page = outside(explained_page(done))
    assert "Demand: not looked at" in page and "power given motion" not in page
