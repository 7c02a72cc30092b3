"""A curve that is not the lab's is owned up to where flights bend it further than a lab is off by, and said where."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from battery.cells import CAPACITY_C
from discrepancy.flown import BATTERY, SERIES, four, searching, told_its_form

from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.discrepancy.bent_curve import bent_curve, bumped_curve
from bhm_service.discrepancy.decision import outweighed
from bhm_service.discrepancy.explain import Request, explain
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.search import search
from bhm_service.discrepancy.selection import NOTHING, select
from bhm_service.discrepancy.words import left_in_words

AT, WIDTH = 0.8, 0.03
LAB = lab_of(BATTERY, "circ", None, None)
TOLD = replace(told_its_form(LAB), voltage_error_v=0.004)


def bumped(cell_v, width=WIDTH, seed=0, at=AT):
    """Flights of a pack whose open-circuit curve has a bump that its lab did not see."""
    flights = [
        replace(
            f,
            voltage_v=f.voltage_v + SERIES * cell_v * np.exp(-0.5 * ((1 - f.charge_c / CAPACITY_C - at) / width) ** 2),
        )
        for f in four(seed=seed)
    ]
    return searching(flights, ["capacity-fade"])


def bumped_where_told(cell_v, **where):
    """A fit of no effect to such flights, where the lab told what its model is off by."""
    found = bumped(cell_v, **where)
    found.base, found.fits = replace(found.base, lab=TOLD), {}
    return found.fitted(frozenset())


@pytest.mark.parametrize("cell_v", [-0.035, 0.035])
def test_a_bump_that_no_lab_misses_is_owned_up_to_with_its_place_and_size(cell_v):
    found = bumped(cell_v)
    chosen, left = outweighed(found, NOTHING, LAB, found.base.flights)
    assert chosen.names == frozenset()
    assert left == bent_curve(found.fitted(frozenset()), LAB)
    assert left.soc == pytest.approx(AT, abs=0.04)
    assert left.cell_v == pytest.approx(cell_v, rel=0.4)
    said = left_in_words(left)
    assert ("above" if cell_v > 0 else "below") in said
    assert "80 % of charge" in said or "80% of charge" in said


@pytest.mark.parametrize("cell_v", [0.0, 0.006])
def test_what_a_lab_may_be_off_by_is_left_to_it(cell_v):
    assert bent_curve(bumped(cell_v).fitted(frozenset()), LAB) is None


def test_what_a_poor_model_is_off_by_somewhere_is_that_models():
    """A bump of 35 mV says nothing where the lab's own recordings are followed to 20 mV."""
    found = bumped(0.035).fitted(frozenset())
    assert bent_curve(found, LAB) is not None
    assert bent_curve(found, replace(LAB, voltage_error_v=0.020)) is None


def test_of_a_pack_that_no_lab_has_seen_nothing_is_said():
    assert bent_curve(bumped(0.035).fitted(frozenset()), replace(LAB, identified=False)) is None


@pytest.mark.parametrize("cell_v", [-0.014, 0.014])
def test_a_small_bump_is_none_of_the_labs_errors_where_it_is_narrow(cell_v):
    left = bumped_curve(bumped_where_told(cell_v), TOLD)
    assert left.soc == pytest.approx(AT, abs=0.03)
    assert left.cell_v == pytest.approx(cell_v, rel=0.4)
    assert "within some percent of charge only" in left_in_words(left)


def test_what_a_poor_model_is_off_by_somewhere_may_be_narrow():
    assert bumped_curve(bumped_where_told(0.014), replace(TOLD, voltage_error_v=0.012)) is None


def test_near_full_no_model_is_held_to_millivolts():
    """Where what it relaxes from, how full it is and the knee of its curve come together."""
    assert bumped_curve(bumped_where_told(0.014, at=0.98), TOLD) is None


def test_the_same_over_tenths_of_charge_is_a_labs():
    assert bumped_curve(bumped_where_told(0.014, width=0.2), TOLD) is None


def test_no_bump_is_seen_in_flights_that_do_as_the_lab_says():
    assert all(bumped_curve(bumped_where_told(0.0, seed=seed), TOLD) is None for seed in range(8))


def test_a_lab_that_did_not_tell_its_form_may_have_missed_it():
    assert bumped_curve(bumped(0.035).fitted(frozenset()), LAB) is None


WIDE = 0.1
SHAPE = frozenset({"ocv-shape"})


def test_a_curve_bent_further_than_any_labs_needs_no_longer_odds_than_other_effects():
    """A course that is free at every knot has to earn more, unless the flights say by themselves that it is there."""
    begun = searching(bumped(0.026, width=WIDE, at=0.65).base.flights, SHAPE)
    found = search(replace(begun.base, lab=TOLD), begun.candidates)
    assert 10.0 < found.evidence(SHAPE) < 30.0
    assert select(found).names == SHAPE
    found.bent = False
    assert select(found).names == frozenset()


@pytest.mark.parametrize(("cell_v", "bent"), [(0.036, True), (0.0, False)])
def test_flights_say_by_themselves_whether_their_curve_is_bent_further(cell_v, bent):
    known = replace(BATTERY, uncertainty=Uncertainty(voltage_error_v=0.004))
    told = explain(Request(battery=known, flights=bumped(cell_v, width=WIDE, at=0.65).base.flights))
    assert told.search.bent is bent
    assert [e.id for e in told.findings.effects] == (["ocv-shape"] if bent else [])
