"""What the power of flights says of a vehicle's demand model, against momentum theory written down by hand."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from discrepancy.explained import findings
from discrepancy.flown import base, flown, with_members
from discrepancy.ridden import CLIMB, EFFICIENCY, ridden, vehicle

from bhm_service.battery.effects import EFFECTS
from bhm_service.config import Vehicle
from bhm_service.discrepancy.demand_drift import drifting
from bhm_service.discrepancy.demand_findings import joined_findings
from bhm_service.discrepancy.demand_model import Demand, craft_of, flown_of
from bhm_service.discrepancy.demand_release import releases
from bhm_service.discrepancy.demand_search import choose, search
from bhm_service.discrepancy.demand_side import DemandSide, NotLooked, demand_side
from bhm_service.discrepancy.explain import missing_a
from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.odds import NATS, STRONG
from bhm_service.discrepancy.sidecar import Notes
from bhm_service.errors import BadInputError
from bhm_service.prediction.demand_file import known_demand, with_demand

RELEASED_S = {0: 220.0, 2: 260.0}


def looked(flights, *demand, **about):
    found = demand_side(vehicle(*demand, **about), flights)
    assert isinstance(found, DemandSide)
    return found


@pytest.fixture(scope="module")
def complete():
    return looked([ridden(k) for k in range(4)], CLIMB)


@pytest.fixture(scope="module")
def climbing():
    return looked([ridden(k) for k in range(4)])


@pytest.fixture(scope="module")
def loaded():
    flights = [ridden(k, heavier=0.1 * (k in RELEASED_S), released_s=RELEASED_S.get(k)) for k in range(4)]
    return looked(flights, CLIMB)


def ids(found):
    return [e.id for e in found.effects]


def test_what_a_sensor_reads_too_little_at_all_times_is_no_power_that_nothing_explains():
    """It is less of the power the lower the voltage, as if flights took more and more."""
    flights = [ridden(k) for k in range(4)]
    volts = np.linspace(25.0, 19.0, flights[0].time_s.size)
    flights = [replace(f, voltage_v=volts, current_a=f.voltage_v * f.current_a / volts - 3.0) for f in flights]
    as_read, known = (demand_side(vehicle(CLIMB), flights, missing_a) for missing_a in (0.0, 3.0))
    assert as_read.verdict == "unknown" and as_read.rest > 0.5
    assert known.verdict == "none" and known.rest == 0.0
    # Power stays what the sensor reads: the vehicle file is used beside the same sensor.
    assert known.level.value == pytest.approx(as_read.level.value, abs=0.01)


def test_a_sensor_reads_too_little_by_what_the_battery_file_says_and_what_was_found_beside():
    offset = frozenset({"current-offset"})
    joint = with_members([flown(samples=60)], offset)
    joint = replace(joint, lab=replace(joint.lab, effects=(*joint.lab.effects, EFFECTS["current-offset"](offset=1.5))))
    x = joint.unknowns.start.copy()
    x[joint.places["current-offset.offset"]] = -0.25
    assert missing_a(Fitted(joint, Noise(0.5, 0.0, 0.02), x, 0.0, [], np.eye(x.size), 0.0 * x)) == pytest.approx(1.25)
    assert missing_a(fit(base([flown(samples=60)]), Noise(0.5, 0.0, 0.02))) == 0.0


def test_a_vehicle_that_flies_as_its_file_says_lacks_nothing(complete):
    assert complete.verdict == "none"
    assert complete.effects == () and complete.change_points == () and complete.repaired is None
    assert abs(complete.level.value) < 0.02


def test_climb_power_that_the_file_lacks_comes_back_within_its_spread(climbing):
    assert (climbing.verdict, ids(climbing)) == ("named", ["climb-power"])
    told = climbing.effects[0].parameters["induced"]
    assert abs(told.value - 0.85) < 2.0 * told.sd < 0.1
    before, after = climbing.unseen_w
    assert after < 0.7 * before
    assert "Climbing at 3 m/s costs" in climbing.in_words[0]


def test_thin_air_is_held_against_flights_of_which_nothing_was_seen():
    """Two from high fields take 2 % less later on, as in calmer air: their own start tells less than the law."""
    flights = [ridden(k, metres=metres) for k, metres in enumerate((0.0, 2500.0, 800.0, 1700.0, 400.0, 2100.0))]
    for k in (1, 5):
        calmer = np.where(flights[k].time_s > 200.0, 0.98, 1.0)
        flights[k] = replace(flights[k], current_a=calmer * flights[k].current_a)
    found = looked(flights, CLIMB)
    assert ids(found) == ["air-density"]
    told = found.effects[0].parameters["exponent"]
    assert abs(told.value - 0.5) < 2.0 * told.sd < 0.3


def in_seasons(board):
    """At one place, in air of -5 to 35 degC, with boards that begin ``board`` warmer than that."""
    warmer = (0.0, 20.0, -20.0, 10.0, -10.0, 5.0)
    flights = [ridden(k, warmer_k=w) for k, w in enumerate(warmer)]
    return [replace(f, cold_board_k=288.15 + w + board) for f, w in zip(flights, warmer, strict=True)]


def test_warm_air_is_told_by_boards_that_were_cold_at_boot_by_however_much_these_are_off():
    found = looked(in_seasons(board=8.0), CLIMB)
    assert (found.verdict, ids(found)) == ("named", ["air-density"])
    told = found.effects[0].parameters["exponent"]
    assert abs(told.value - 0.5) < 2.0 * told.sd < 0.3


def test_air_that_one_flight_does_not_tell_is_taken_for_the_standard_one_in_all():
    first, *others = in_seasons(board=0.0)
    assert looked([replace(first, cold_board_k=None), *others], CLIMB).effects == ()


def test_what_the_air_is_noted_to_be_goes_before_what_a_board_says():
    wrong = [replace(f, cold_board_k=300.0 - 2.0 * k) for k, f in enumerate(in_seasons(board=0.0))]
    right = [
        replace(f, notes=Notes(ambient_k=there.cold_board_k))
        for f, there in zip(wrong, in_seasons(board=0.0), strict=True)
    ]
    assert ids(looked(right, CLIMB)) == ["air-density"]


@pytest.mark.parametrize(("scatter", "named"), [(0.001, ["air-density"]), (0.02, [])])
def test_how_far_flights_differ_by_themselves_is_what_they_say(scatter, named):
    """Thin air that costs 2.4 % between the lowest field and the highest."""
    fields = (0.0, 500.0, 125.0, 375.0, 250.0, 437.5)
    assert ids(looked([ridden(k, metres=m, scatter=scatter) for k, m in enumerate(fields)], CLIMB)) == named


def test_a_payload_that_is_let_go_is_found_in_time_and_in_weight(loaded):
    assert (loaded.verdict, ids(loaded)) == ("named", ["payload-mass"])
    times = {c.flight: c.time_s for c in loaded.change_points}
    assert times == {f"{k:02d}.tlog": pytest.approx(at, abs=5.0) for k, at in RELEASED_S.items()}
    told = loaded.effects[0].parameters["payload"]
    assert abs(told.value - 0.1) < 3.0 * told.sd < 0.03
    assert "flights 00 and 02" in loaded.in_words[0]


@pytest.mark.parametrize(("let_go", "chosen"), [(True, {"payload-mass:some"}), (False, set())])
def test_what_is_let_go_needs_little_beside_the_steps_that_show_it(let_go, chosen):
    """Each of them has earned its place in a flight by itself; what only differs between flights has not."""
    flights = [ridden(k, heavier=0.06 * (k in (0, 2)), released_s=240.0 if let_go else None) for k in range(4)]
    found = search(Demand(craft_of(vehicle(CLIMB), "known"), tuple(flown_of(f) for f in flights)))
    some = frozenset({"payload-mass:some"})
    while found.evidence(some) > 0.9 * NATS:
        found = replace(found, noise=replace(found.noise, doubt=1.1 * found.noise.doubt), fits={})
        found.fitted(some)
    assert found.evidence(some) > STRONG
    assert choose(found, np.random.default_rng(1)).names == chosen


def test_a_step_costs_as_many_times_as_it_may_have_come_at_and_less_where_it_does_not_tell_which():
    """A time in the whole flight by Laplace: the log of how many there are, and of how many are as good as the best."""
    flown = flown_of(ridden(0))
    clear, faint = (
        releases([np.where(flown.time_s < 220.0, size, 0.0)], [flown], Noise(0.5, 0.0, 0.02))[0].price
        for size in (0.1, 0.035)
    )
    assert clear == pytest.approx(np.log(flown.time_s.size), abs=0.1)
    assert np.log(1.5) < clear - faint < np.log(10.0)


def test_a_payload_that_is_let_go_in_a_gap_of_the_log_is_found_beside_it():
    flight = ridden(0)
    flown = flown_of(flight.part(np.abs(flight.time_s - 220.0) > 15.0))
    misfit = np.where(flown.time_s < 220.0, 0.1, 0.0)  # of the hover's power
    (found,) = releases([misfit], [flown], Noise(0.5, 0.0, 0.02))
    assert found.time_s == pytest.approx(220.0, abs=17.0)


def test_a_payload_on_some_flights_is_told_from_wear_that_grows_over_all():
    some = looked([ridden(k, heavier=0.15 * (k in (1, 2, 4))) for k in range(6)], CLIMB)
    wear = looked([ridden(k, worn=0.15 * k / 5) for k in range(6)], CLIMB)
    assert (ids(some), ids(wear)) == (["payload-mass"], ["propulsion-efficiency"])
    told = wear.effects[0].parameters["loss"]
    assert abs(told.value - 0.15) < 3.0 * told.sd


def in_known_air(flights):
    return [replace(f, cold_board_k=293.15) for f in flights]


def test_a_little_wear_has_a_name_where_the_air_is_known_and_none_where_the_day_may_have_grown_warmer():
    worn = [ridden(k, worn=0.03 * k / 5, scatter=0.001) for k in range(6)]
    known, unknown = looked(in_known_air(worn), CLIMB), looked(worn, CLIMB)
    assert (ids(known), ids(unknown)) == (["propulsion-efficiency"], [])
    told = known.effects[0].parameters["loss"]
    assert abs(told.value - 0.03) < 3.0 * told.sd < 0.03


@pytest.mark.parametrize("scatter", [0.0025, 0.01, 0.02])
def test_hovers_that_only_scatter_are_hardly_ever_worn(scatter):
    """200 sets of six levels as they were measured: fewer than one in fifty earns what is asked of wear."""
    found = search(Demand(craft_of(vehicle(CLIMB), "known"), tuple(map(flown_of, (ridden(k) for k in range(6))))))
    rng, passing, worn = np.random.default_rng(7), 0, frozenset({"propulsion-efficiency"})
    base = [f.power_w for f in found.base.flights]
    for _ in range(200):
        levels = 1.0 + scatter * rng.standard_normal(6)
        flights = tuple(replace(f, power_w=p * x) for f, p, x in zip(found.base.flights, base, levels, strict=True))
        fresh = replace(found, base=replace(found.base, flights=flights), fits={})
        for names in (worn, frozenset[str]()):
            fresh.fitted(names)
        passing += fresh.evidence(worn) > STRONG
    assert passing < 4


def test_more_power_on_all_flights_alike_is_no_physics_but_a_wrong_figure():
    found = looked([ridden(k, heavier=0.3) for k in range(4)], CLIMB)
    assert (found.verdict, found.effects) == ("parameter", ())
    assert found.level.value == pytest.approx(1.3**1.5 - 1.0, rel=0.1)
    assert found.efficiency == pytest.approx(EFFICIENCY / (1.0 + found.level.value))


def test_power_that_no_effect_explains_is_owned_up_to():
    flights = [ridden(k) for k in range(4)]
    iced = 1.0 + 0.25 * np.clip((flights[1].time_s - 200.0) / 150.0, 0.0, 1.0) * flights[1].airborne
    found = looked([flights[0], replace(flights[1], current_a=flights[1].current_a * iced), *flights[2:]], CLIMB)
    assert found.verdict == "unknown" and found.rest > 0.5


def growing(flight, per_minute):
    by = 1.0 + per_minute * np.maximum(flight.since_takeoff_s, 0.0) / 60.0
    return replace(flight, current_a=flight.current_a * by)


def test_power_that_grows_with_the_time_in_the_air_has_no_name_and_is_owned_up_to():
    found = looked([growing(ridden(k), 0.006) for k in range(5)], CLIMB)
    assert (found.verdict, ids(found), found.repaired) == ("unknown", [], None)
    assert found.rest > 0.1
    assert re.search(r"they take [345]\.\d % more of the hover's power at their end", found.sentence)


def test_gusts_alone_grow_with_no_time():
    """Of forty crafts whose files are right none says so; by its odds one in twenty thousand may."""
    craft = craft_of(vehicle(CLIMB), "known")
    for seed in range(40):
        flights = tuple(flown_of(ridden(k, seed=seed)) for k in range(4))
        assert drifting(fit(Demand(craft, flights), Noise(0.5, 0.0, 0.02))) is None


@pytest.mark.parametrize(
    ("given", "flights", "said"),
    [
        (None, [ridden(0), ridden(1)], "no vehicle file"),
        (Vehicle.model_validate({"name": "x", "battery": {"file": "b"}}), [ridden(0), ridden(1)], r"no \[rotors\]"),
        (vehicle(), [ridden(0), replace(ridden(1), climb_mps=ridden(1).climb_mps * np.nan)], "1 of the flights tell"),
    ],
    ids=["no vehicle", "no figures of the rotors", "no motion"],
)
def test_what_cannot_be_looked_at_is_said_and_changes_no_finding(given, flights, said):
    found = demand_side(given, flights)
    assert isinstance(found, NotLooked)
    assert re.search(said, found.because)
    assert joined_findings(findings(), found) == findings()


@pytest.mark.parametrize(
    ("battery", "demand", "both"),
    [
        ("none", "none", "none"),
        ("none", "named", "named"),
        ("ambiguous", "named", "ambiguous"),
        ("named", "ambiguous", "ambiguous"),
        ("unknown", "named", "named"),
        ("named", "unknown", "named"),
        ("none", "parameter", "parameter"),
        ("not-excited", "none", "not-excited"),
        ("sensor-suspect", "none", "sensor-suspect"),
    ],
)
def test_a_verdict_is_of_both_sides(complete, battery, demand, both):
    of_battery = findings().model_copy(update={"verdict": battery})
    assert joined_findings(of_battery, replace(complete, verdict=demand)).verdict == both


def test_what_cannot_be_told_apart_is_a_whole_set_of_both_sides(climbing):
    of_battery = findings().model_copy(update={"alternatives": [["contact-resistance"]]})
    both = joined_findings(of_battery, replace(climbing, alternatives=(("payload-mass",),)))
    assert [e.id for e in both.effects] == ["resistance-temperature", "climb-power"]
    assert both.alternatives == [["climb-power", "contact-resistance"], ["payload-mass", "resistance-temperature"]]


def test_the_repaired_vehicle_file_holds_what_was_found(climbing, tmp_path):
    text = '# mine\nname = "v"\n[battery]\nfile = "b.toml"\n[rotors]\nmass_kg = 5.0\nrotors = 4\nrotor_radius_m = 0.2\n'
    fresh = with_demand(text, climbing.repaired, climbing.efficiency)
    assert fresh.startswith("# mine")
    (known,) = known_demand(Vehicle.model_validate(tomllib.loads(fresh)), "v.toml")
    assert known.effect.id == "climb-power"
    assert float(known.effect.induced) == pytest.approx(climbing.effects[0].parameters["induced"].value, rel=1e-6)
    assert known.sd == pytest.approx(climbing.effects[0].parameters["induced"].sd, rel=0.1)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"id": "climb"}, "'climb' is not known"),
        ({"id": "climb-power"}, "'induced' is missing"),
        ({"id": "climb-power", "induced": 9.0}, "9 is outside 0 ... 2"),
        ({"id": "climb-power", "induced": 0.8, "indused": 0.8}, "did you mean 'induced'"),
    ],
)
def test_a_wrong_demand_table_is_named(table, said):
    with pytest.raises(BadInputError, match=r"v\.toml") as told:
        known_demand(vehicle(table), "v.toml")
    assert said in str(told.value)
