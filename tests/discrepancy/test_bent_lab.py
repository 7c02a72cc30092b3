"""A lab that would have to be off in everything at once is owned up to: a little each is too much together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, SERIES, flown, four, searching, told_its_form
from scipy.stats import chi2

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.bent_lab import BentLab, bent_lab, unlikely
from bhm_service.discrepancy.decision import outweighed
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.odds import NATS
from bhm_service.discrepancy.selection import NOTHING
from bhm_service.discrepancy.verdict import moved
from bhm_service.discrepancy.words import left_advice, left_in_words

LAB = told_its_form(lab_of(BATTERY, "circ", None, None))
NONE = frozenset()


def together(growth, fade, offset_v):
    """A resistance, a charge and a voltage that are not the lab's."""
    sizes = ("resistance-growth", {"growth": growth}), ("capacity-fade", {"fade": fade})
    return [*(EFFECTS[name](**size) for name, size in sizes), EFFECTS["voltage-offset"](offset=offset_v)]


def looked(flights):
    """A search in which nothing but the lab's errors has been fitted."""
    found = searching(flights, ["capacity-fade"])
    found.base = replace(found.base, lab=LAB)
    found.fitted(NONE)
    return found


def drifting(cell_v):
    """Flights whose voltage comes back minutes after the log's start, as what a warming board reads may."""
    return [replace(f, voltage_v=f.voltage_v - SERIES * cell_v * np.exp(-f.time_s / 200.0)) for f in four(seed=3)]


@pytest.mark.parametrize("total", [20.0, 45.0, 90.0, 300.0])
def test_odds_of_plain_squares_are_bounded_within_a_few_nats(total):
    told, exact = unlikely(total, np.ones(20)), -float(chi2.logsf(total, 20))
    assert exact - 6.0 < told <= exact


def test_odds_of_squares_that_are_seen_in_part_are_bounded():
    shares = np.linspace(0.02, 1.0, 25)
    drawn = np.random.default_rng(1).standard_normal((400_000, 25)) ** 2 @ shares
    for total in np.quantile(drawn, [0.9, 0.99, 0.9999]):
        exact = -np.log(np.mean(drawn > total))
        assert exact - 4.0 < unlikely(float(total), shares) <= exact


def test_what_is_expected_is_not_unlikely():
    assert unlikely(9.9, np.full(20, 0.5)) == 0.0


def test_flights_that_bend_much_at_once_are_owned_up_to():
    """Less resistance, less charge and a curve that is higher, none of them so far that a lab could not miss it."""
    found = looked([flown(together(-0.3, 0.07, 0.23), seed=3, number=k) for k in range(4)])
    chosen, left = outweighed(found, NOTHING, LAB, found.base.flights)
    assert chosen.names == NONE
    assert isinstance(left, BentLab) and left.nats > NATS
    assert "off at once" in left_in_words(left)
    assert "Identify the pack again" in left_advice(left)
    assert bent_lab(found.fitted(NONE), replace(LAB, identified=False)) is None


@pytest.mark.parametrize("cell_v", [0.0, 0.02])
def test_what_a_lab_leaves_open_is_left_to_it(cell_v):
    found = looked(drifting(cell_v))
    assert bent_lab(found.fitted(NONE), LAB) is None
    assert outweighed(found, NOTHING, LAB, found.base.flights)[1] is None


def test_a_capacity_that_moved_far_is_a_verdict_by_itself():
    found = looked([flown(together(0.3, 0.12, 0.05), seed=3, number=k) for k in range(4)])
    fitted = found.fitted(NONE)
    assert moved(fitted) and bent_lab(fitted, LAB) is not None
    assert outweighed(found, NOTHING, LAB, found.base.flights)[1] is None


def test_odds_are_told_in_whole_powers_of_ten():
    assert "odds below one in 1 000 000)" in left_in_words(BentLab(nats=14.0))
    assert "odds below one in 10 000)" in left_in_words(BentLab(nats=10.0))
    assert "odds below one in 1 000 000 000)" in left_in_words(BentLab(nats=500.0))
