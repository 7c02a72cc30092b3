"""What the lab's own error allows to be said."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discrepancy.flown import BATTERY, flown, four, searching, told_its_form

from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.discrepancy.decision import told_from_lab
from bhm_service.discrepancy.explain import Request, explain
from bhm_service.discrepancy.first_order import saturated_noise
from bhm_service.discrepancy.verdict import beyond_lab

NONE = frozenset()


def of_lab(found, volts):
    """The same search with a battery of another error in the lab. [V] of a cell"""
    return replace(found, base=replace(found.base, lab=replace(found.base.lab, voltage_error_v=volts)), fits={})


def off_by(found):
    """What a cell is off by over all flights, noise apart. [V]"""
    misfit = sum(float((m**2).sum()) for m in found.base.misfits) / sum(m.size for m in found.base.misfits)
    return (misfit - found.noise.sigma_v**2) ** 0.5 / found.base.lab.series


def test_flights_are_beyond_the_lab_when_they_are_off_by_more_than_its_unseen_recordings():
    found = searching(four("resistance-growth"), {"resistance-growth"})
    cell = off_by(found)
    assert beyond_lab(of_lab(found, 0.9 * cell))
    assert not beyond_lab(of_lab(found, 1.1 * cell))


@pytest.mark.parametrize(("volts", "times"), [(0.010, 1.0), (0.024, 2.0), (0.1, 3.0)])
def test_flights_of_a_pack_that_its_model_follows_poorly_in_the_lab_are_weaker_witnesses(volts, times):
    found = searching(four("resistance-growth"), {"resistance-growth"})
    good, poor = (of_lab(found, v) for v in (0.003, volts))
    doubts = [saturated_noise(s.fitted(NONE), s.candidates).doubt for s in (good, poor)]
    assert doubts[1] == pytest.approx(times * doubts[0])


def test_a_battery_that_is_as_wrong_in_the_lab_as_in_flight_leaves_nothing_to_explain():
    flights = [flown([EFFECTS["resistance-growth"](growth=0.1)], seed=4, number=k) for k in range(4)]
    poor = replace(BATTERY, uncertainty=Uncertainty(voltage_error_v=0.05))
    found = explain(Request(battery=poor, flights=flights)).findings
    assert (found.verdict, found.effects, found.unexplained_rest) == ("none", [], 0.0)


def test_what_a_battery_is_off_by_in_the_lab_as_well_gets_no_name_though_some_effect_is_always_near():
    flights = [flown([EFFECTS["contact-resistance"](resistance=0.02)], seed=4, number=k) for k in range(4)]
    cell = off_by(searching(flights, {"contact-resistance"}))
    beyond, within = (
        explain(Request(battery=replace(BATTERY, uncertainty=Uncertainty(voltage_error_v=v)), flights=flights)).findings
        for v in (0.9 * cell, 1.1 * cell)
    )
    assert beyond.effects
    assert within.effects == []


@pytest.mark.parametrize("name", ["time-skew", "intermittent-contact"])
def test_what_is_there_for_seconds_only_is_no_lasting_error_of_the_lab(name):
    found = searching(four("resistance-growth"), {"resistance-growth"})
    poor = of_lab(found, 2.0 * off_by(found))
    assert told_from_lab(poor, frozenset({name, "resistance-growth"}))
    assert not told_from_lab(poor, frozenset({"resistance-growth"}))


def test_what_beat_the_errors_that_the_lab_told_of_is_none_of_them():
    found = searching(four("resistance-growth"), {"resistance-growth"})
    poor = of_lab(found, 2.0 * off_by(found))
    poor.base = replace(poor.base, lab=told_its_form(poor.base.lab))
    assert told_from_lab(poor, frozenset({"resistance-growth"}))
