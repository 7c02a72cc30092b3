"""Voltages that are told late: a skew, what only looks like one, and by how much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, SERIES, base, catalogue, flown, off_by_its_curve, searching

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.dynamics import Follower
from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.crossing import witness
from bhm_service.discrepancy.first_order import geometry_of
from bhm_service.discrepancy.odds import NATS, needed
from bhm_service.discrepancy.search import _beyond_the_lab
from bhm_service.discrepancy.selection import MUCH, select, share
from bhm_service.discrepancy.timing import by_samples, timed

FADE = frozenset({"capacity-fade"})
SKEW = frozenset({"time-skew"})


def told(seconds_late=0.0, relaxing=0.0, faded=0.0, noise_v=0.0):
    """Flights once a second whose voltage is told so late.

    Of the ohmic drop a share relaxes within a second, which no lab at one hertz knows.
    """
    flights, rng = [], np.random.default_rng(1)
    for k in range(4):
        data = flown([EFFECTS["capacity-fade"](fade=faded)], seed=7, number=k, samples=990, step_s=1.0, rested=False)
        ohm = relaxing * SERIES * float(BATTERY.cell("circ").ohmic_resistance(Modifiers()))
        slow = ohm * (data.current_a - Follower(np.diff(data.time_s), 1.0)(data.current_a))
        volts = np.interp(data.time_s - seconds_late, data.time_s, data.voltage_v + slow)
        flights.append(replace(data, voltage_v=volts + noise_v * rng.standard_normal(volts.size)))
    return flights


def over_averages(flights, *sets):
    """A search for a skew and lost capacity with samples that were averaged to three seconds."""
    found = searching(tuple(f.thinned(330) for f in flights), {*SKEW, *FADE})
    for names in (frozenset(), *sets):
        found.fitted(names)
    return found


def test_a_voltage_told_late_is_a_skew_by_which_it_is_late():
    found = over_averages(told(seconds_late=1.0), SKEW)
    assert select(found).names == SKEW
    fitted = found.fitted(SKEW)
    assert fitted.x[fitted.joint.places["time-skew.skew"]][0] == pytest.approx(-1.0, abs=0.2)


@pytest.mark.parametrize("seconds_late", [1.4, 2.0])
def test_a_skew_of_more_than_a_sample_is_found_though_its_cost_has_many_valleys(seconds_late):
    """From no skew at all a fit ends in the first of them, with the most that it may make of the lab's own."""
    flights = told(seconds_late=seconds_late)
    found = over_averages(flights, SKEW)
    over = found.fitted(SKEW)
    assert over.x[over.joint.places["time-skew.skew"]][0] == pytest.approx(-seconds_late, abs=0.15)
    closer = witness(base(flights).lab, base(flights), catalogue(flights, only=SKEW))
    assert timed(closer, SKEW)
    at = by_samples(over, closer, SKEW)
    assert at.x[at.joint.places["time-skew.skew"]][0] == pytest.approx(-seconds_late, rel=0.02)


def test_a_skew_is_told_from_what_relaxes_within_a_second_by_the_logs_own_samples():
    """Of what relaxes, a part comes at once; averages of three seconds do not show which it is."""
    skewed, relaxing = told(seconds_late=1.0), told(relaxing=0.5)
    found = over_averages(relaxing, SKEW)
    assert found.evidence(SKEW) > needed("time-skew")
    chosen = select(over_averages(skewed, SKEW))
    tried = catalogue(skewed, only=SKEW)
    assert timed(witness(base(skewed).lab, base(skewed), tried), chosen.names)
    assert not timed(witness(base(relaxing).lab, base(relaxing), tried), chosen.names)


def test_what_is_later_than_any_filter_is_not_laid_on_the_lab():
    """All of an ohmic drop a second late would do for a skew of that much: no cell relaxes so."""
    flights = told(seconds_late=1.2, noise_v=0.15)
    assert timed(witness(base(flights).lab, base(flights), catalogue(flights, only=SKEW)), SKEW)


def test_the_logs_own_samples_are_fitted_from_where_the_averages_are():
    """A fit of many samples that begins far from them may stop on the way: how far it comes is of the processor."""
    flights = told(seconds_late=1.3, faded=0.3)
    found = over_averages(flights, SKEW | FADE)
    closer = witness(base(flights).lab, base(flights), catalogue(flights, only=SKEW | FADE), near=found)
    assert timed(closer, SKEW | FADE)
    fitted = closer.fitted(SKEW | FADE)
    assert fitted.x[fitted.joint.places["capacity-fade.fade"]][0] == pytest.approx(0.3, abs=0.01)


def test_a_skew_that_is_known_to_be_absent_leaves_what_explains_the_larger_part_of_it_without():
    """What flights like far less than the skew they do not have is no explanation either."""
    for faded, left in ((0.1, frozenset()), (0.2, FADE)):
        found = over_averages(told(seconds_late=1.0, faded=faded), SKEW, FADE, SKEW | FADE)
        assert found.evidence(SKEW) > found.evidence(FADE) + NATS
        assert select(found, [SKEW]).names == SKEW | FADE
        assert select(found, [SKEW], absent=SKEW).names == left


def test_half_a_sample_is_a_matter_of_filters_and_no_skew():
    """Of logs that have a sample every three seconds a second is no more than that."""
    chosen = select(over_averages(told(seconds_late=1.0), SKEW))
    seldom = [f.thinned(330) for f in told(seconds_late=1.0)]
    closer = witness(base(seldom).lab, base(seldom), catalogue(seldom, only=SKEW))
    assert closer.earned(SKEW)["time-skew"] > needed("time-skew")
    assert not timed(closer, chosen.names)


def test_a_slow_misfit_does_not_hide_a_skew():
    """It is seen at few steps, at which lost capacity is off by as much: each explains its own."""
    found = over_averages(told(seconds_late=1.0, faded=0.2), SKEW, FADE, SKEW | FADE)
    assert select(found).names == SKEW | FADE
    skew = [m.id == "time-skew" for m in found.joint(SKEW | FADE).members]
    found._alone[SKEW] = found.alone(SKEW | FADE)[skew]
    assert share(found, SKEW) > MUCH


@pytest.mark.parametrize(("seconds_late", "tried"), [(0.0, []), (0.85, ["time-skew"])])
def test_a_skew_is_tried_beside_what_has_as_much_made_of_the_labs_own_as_may_be(seconds_late, tried):
    """There the lab's own has taken all that one step shows, and another valley lies beyond it."""
    at = over_averages(told(seconds_late=seconds_late, faded=0.1), FADE).fitted(FADE)
    assert _beyond_the_lab(at, {"time-skew", "weak-cell"}) == tried
    assert _beyond_the_lab(at, {"weak-cell"}) == []


def test_what_stands_at_its_bound_makes_up_for_no_more_of_what_a_candidate_adds():
    at = over_averages(told(seconds_late=1.0)).fitted(frozenset())
    (skew,) = np.flatnonzero(~at.free)
    assert at.joint.places["lab_skew"] == slice(skew, skew + 1)
    like_it = at.along(np.eye(at.x.size)[:, [skew]])
    # Of what it might still make up for, no more would be left than was known of it before: one.
    assert geometry_of(at, like_it)[0].information[0, 0] > 10.0


def test_nor_does_a_curve_that_is_off_move_a_skew_from_where_the_lab_explains_that():
    """With nobody but itself to explain the slow misfit it would be a sixth larger, to take something of that."""
    found = over_averages(off_by_its_curve(told(seconds_late=1.0), 0.05), SKEW)
    at = found.fitted(SKEW)
    x, own = at.joint.unknowns.start.copy(), at.joint.places["time-skew.skew"]
    x[own] = at.x[own]
    assert x[own] == pytest.approx(-1.0, abs=0.05)
    adds = np.concatenate([p.members[0] for p in at.joint.all_predicted(x[None, :])])
    np.testing.assert_allclose(found.alone(SKEW)[0], adds)
    assert share(found, SKEW) > MUCH


@pytest.mark.parametrize(("earned", "stands"), [(1.5 * NATS, True), (0.5 * NATS, False)])
def test_the_logs_own_samples_have_to_like_a_skew_that_averages_told(earned, stands):
    """How large it is they tell better than whether it is there, which averages have shown by as much as it takes."""
    flights = told(seconds_late=1.0)
    closer = witness(base(flights).lab, base(flights), catalogue(flights, only=SKEW))
    own = closer._search(SKEW)
    has = closer.earned(SKEW)["time-skew"]
    own.fits[SKEW] = replace(own.fits[SKEW], cost=own.fits[SKEW].cost + 2.0 * own.inflation * (has - earned))
    assert closer.earned(SKEW)["time-skew"] == pytest.approx(earned)
    assert timed(closer, SKEW) is stands
