"""The describer of the unknown: a planted pattern is found where it is, noise and what the lab leaves open are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import base, four, searching, told_its_form

from bhm_service.discrepancy.decision import outweighed
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.odds import NATS
from bhm_service.discrepancy.patterns import patterns, telling
from bhm_service.discrepancy.selection import Selection
from bhm_service.discrepancy.words import left_in_words

NOISE = Noise(0.95, 0.7, 0.008)


def flights(added=lambda data: 0.0):
    return [replace(f, voltage_v=f.voltage_v + added(f)) for f in four()]


def test_nothing_is_told_of_flights_that_the_battery_explains():
    assert telling(fit(base(flights()), NOISE)) is None


def test_a_voltage_that_drifts_with_time_is_found_with_its_size_and_unit():
    drifting = fit(base(flights(lambda f: 0.3 * np.sin(f.since_takeoff_s / 60.0))), NOISE)
    found = telling(drifting)
    assert found is not None
    assert found.kind == "voltage"
    assert "mV at" in left_in_words(found)


@pytest.mark.parametrize(("error_v", "told"), [(0.003, True), (0.010, False)])
def test_what_varies_by_less_than_the_lab_is_off_by_is_the_labs(error_v, told):
    joint = base(flights(lambda f: 0.065 * np.sin(f.since_takeoff_s / 60.0)))
    drifting = fit(replace(joint, lab=replace(joint.lab, voltage_error_v=error_v)), NOISE)
    best = patterns(drifting)[0]
    assert best.nats > 30.0
    assert 6 * 0.003 < best.varies_v < 6 * 0.010
    assert (telling(drifting) is not None) is told


def test_a_resistance_that_follows_no_driver_is_a_resistance_of_single_flights():
    odd = flights()
    odd[1] = replace(odd[1], voltage_v=odd[1].voltage_v - 0.02 * odd[1].current_a)
    found = patterns(fit(base(odd), NOISE))
    best = found[0]
    assert (best.kind, best.variable) == ("resistance", "flight")
    others = np.delete(best.heights, 1)
    assert best.heights[1] - others.mean() > 0.01
    assert abs(best.heights[1] - others.mean() - 0.02) < 4.0 * float(best.sd.max())


def told(flights):
    """A fit in which the lab told what its model is off by."""
    joint = base(flights)
    return fit(replace(joint, lab=told_its_form(joint.lab)), NOISE)


def warming(data):
    """An autopilot that warms up in its own time, with the flight's number for its air. [K]"""
    return 293.15 + 3.0 * int(data.label[:2]) + 18.0 * (1.0 - np.exp(-data.time_s / 400.0))


def drifting(volts_per_k, boards=True):
    """What a voltage divider reads that follows the autopilot's own temperature."""
    return [
        replace(f, voltage_v=f.voltage_v + volts_per_k * (warming(f) - 313.15), board_k=warming(f) if boards else None)
        for f in four()
    ]


def test_a_voltage_that_follows_the_autopilots_temperature_is_a_line_over_it():
    """Within what any lab's model is off by, but no error of a cell knows how warm an autopilot is."""
    fitted = told(drifting(0.006))
    found = telling(fitted, lines_only=True)
    assert (found.kind, found.variable, found.line) == ("voltage", "board_C", True)
    assert np.diff(found.heights)[0] / np.diff(found.knots)[0] == pytest.approx(0.006, rel=0.3)
    assert found.varies_v < fitted.joint.lab.series * fitted.joint.lab.voltage_error_v
    assert "the autopilot's own temperature" in left_in_words(found)


def test_a_line_is_drawn_past_samples_that_do_not_tell_what_it_is_over():
    """An autopilot that boots with the log says how warm it is after the first sample, and then not each time."""
    whole = drifting(0.006)
    gaps = [np.where((np.arange(f.time_s.size) == 0) | (f.time_s % 50.0 < 4.0), np.nan, f.board_k) for f in whole]
    found = telling(told([replace(f, board_k=k) for f, k in zip(whole, gaps, strict=True)]), lines_only=True)
    assert found.nats == pytest.approx(telling(told(whole), lines_only=True).nats, rel=0.05)


def test_no_line_is_drawn_over_what_one_flight_does_not_tell():
    first, *others = drifting(0.006)
    assert telling(told([replace(first, board_k=None), *others]), lines_only=True) is None


def test_a_resistance_that_follows_the_autopilots_temperature_is_no_line_but_the_packs_own_warmth():
    warm = [replace(f, board_k=warming(f)) for f in four()]
    warm = [replace(f, voltage_v=f.voltage_v + 2e-4 * (f.board_k - 313.15) * f.current_a) for f in warm]
    assert all(p.kind == "voltage" for p in patterns(told(warm)) if p.line and p.variable == "board_C")


def test_what_a_lab_did_not_tell_the_form_of_may_follow_anything_by_a_little():
    assert telling(fit(base(drifting(0.006)), NOISE), lines_only=True) is None


def test_a_resistance_that_follows_the_speed_is_a_line_over_it():
    rng = np.random.default_rng(2)
    fast = [replace(f, speed_mps=np.repeat(rng.choice([0.0, 10.0], 11), 30)) for f in four()]
    fast = [replace(f, voltage_v=f.voltage_v - 0.002 * f.speed_mps / 10.0 * f.current_a) for f in fast]
    found = telling(told(fast), lines_only=True)
    assert (found.variable, found.line) == ("speed_mps", True)


def test_lines_over_what_has_nothing_to_do_with_the_battery_tell_nothing():
    """Eight fleets of packs that do as their lab says."""
    most = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        flights = [
            replace(
                f,
                board_k=warming(f),
                speed_mps=np.repeat(rng.choice([0.0, 10.0], 11), 30),
                altitude_m=np.repeat(rng.uniform(10.0, 60.0, 11), 30),
            )
            for f in four(seed=seed)
        ]
        lines = [p for p in patterns(told(flights)) if p.line]
        assert {p.variable for p in lines} == {"board_C", "speed_mps", "altitude_m"}
        most.append(max(p.nats for p in lines))
    assert max(most) < 0.5 * NATS


def standing(flights, *names):
    """What stands of a set that a search would have chosen, and what it leaves, where the lab told its form."""
    found = searching(flights, names)
    found.base = replace(found.base, lab=told_its_form(found.base.lab))
    chosen, left = outweighed(found, Selection(frozenset(names), (), {}, {}), found.base.lab, flights)
    return chosen.names, left


@pytest.mark.parametrize("volts_per_k", [-0.01, 0.006])
@pytest.mark.parametrize("names", [("voltage-gain", "voltage-offset"), ("voltage-offset",), ("current-offset",)])
def test_a_line_stands_in_place_of_sensors_that_follow_it_by_halves(volts_per_k, names):
    stands, left = standing(drifting(volts_per_k), *names)
    assert stands == frozenset()
    assert (left.variable, left.line) == ("board_C", True)


@pytest.mark.parametrize(
    "name", ["unseen-load", "capacity-fade", "resistance-growth", "partial-charge", "resistance-temperature"]
)
def test_what_a_pack_has_stands_beside_an_autopilot_that_warms_up(name):
    stands, _ = standing([replace(f, board_k=warming(f)) for f in four(name)], name)
    assert stands == {name}


def test_what_follows_a_packs_own_warmth_is_not_put_out_by_an_autopilot_as_warm():
    as_warm = [replace(f, temperature_k=f.board_k) for f in drifting(0.004)]
    stands, _ = standing(as_warm, "entropic-voltage")
    assert stands == {"entropic-voltage"}
