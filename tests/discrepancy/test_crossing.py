"""The other model of the cell as a witness: what it says against, and what it says the same of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, SERIES, base, catalogue, flown, told_its_form

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.confirm import Unseen
from bhm_service.discrepancy.crossing import witness
from bhm_service.discrepancy.decision import decide
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.search import search

OFFSET = frozenset({"voltage-offset"})
_VOLT = 0.6  # that the sensor reads too high


@pytest.fixture(scope="module")
def found():
    """A search for a sensor's offset on flights that have one."""
    flights = tuple(flown([EFFECTS["voltage-offset"](offset=_VOLT)], seed=11, number=k, rested=False) for k in range(3))
    return search(Joint(told_its_form(base(flights).lab), flights), catalogue(flights, only=OFFSET))


def by_a_cell_higher_by(found, volts):
    """A witness whose cells stand so much higher, together, than those of the search."""
    curve = BATTERY.circ.ocv
    higher = replace(curve, volts=tuple(v + volts / SERIES for v in curve.volts))
    lab = told_its_form(lab_of(replace(BATTERY, circ=replace(BATTERY.circ, ocv=higher)), "circ", None, None))
    return witness(lab, found.base, found.candidates, other=found)


def off_in_the_lab(second, volts):
    """The witness by a model that is off by so much in the lab, of which no more is told for it."""
    return witness(replace(second.lab, own_error_v=volts), second.base, second.candidates, other=second.other)


def decided(found, second):
    """What stands."""
    closer = witness(found.base.lab, found.base, found.candidates, near=found)
    return decide(Unseen(found), second, closer, found.base.flights, np.random.default_rng(1)).chosen.names


def test_what_both_models_lay_on_the_same_effect_stands(found):
    second = by_a_cell_higher_by(found, 0.5 * _VOLT)
    assert not second.turned_round(found, OFFSET)
    assert decided(found, second) == OFFSET


def test_what_the_other_model_turns_round_is_the_structure_of_both(found):
    """Either likes the flights far better with the effect."""
    second = by_a_cell_higher_by(found, 2.0 * _VOLT)
    assert second.earned(OFFSET)["voltage-offset"] > 20.0
    assert second.turned_round(found, OFFSET) == OFFSET
    assert decided(found, second) == frozenset()


def test_a_model_that_follows_the_lab_far_less_well_need_not_see_it(found):
    second = by_a_cell_higher_by(found, _VOLT)
    assert second.earned(OFFSET)["voltage-offset"] < 1.0
    for times, stands in ((1.9, frozenset()), (2.1, OFFSET)):
        assert decided(found, off_in_the_lab(second, times * found.base.lab.own_error_v)) == stands


def test_a_model_that_turns_it_round_is_heard_however_badly_it_follows_the_lab(found):
    second = by_a_cell_higher_by(found, 2.0 * _VOLT)
    assert decided(found, off_in_the_lab(second, 4.0 * found.base.lab.own_error_v)) == frozenset()
