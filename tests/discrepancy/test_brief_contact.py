"""A contact that fails for a while is named by how it comes and goes, whatever is off slowly beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import SERIES, flown, off_by_its_curve, searching

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.courses import courses_of
from bhm_service.discrepancy.selection import LEAST_V, added, select, share
from bhm_service.discrepancy.steps import contact_candidate, episodes
from bhm_service.discrepancy.summary import shares_of

CONTACT = frozenset({"intermittent-contact"})
FLIGHTS = 4


def failing(ohm, begin=400.0, end=520.0):
    """Flights of which one has a contact that fails."""
    bad = EFFECTS["intermittent-contact"](resistance=ohm, begin=begin, end=end)
    return tuple(flown([bad] if k == 1 else (), number=k) for k in range(FLIGHTS))


def looked_for(flights):
    """A search that has met the episodes of these flights."""
    found = searching(flights, set())
    bare = found.fitted(frozenset())
    found.candidates = (contact_candidate(episodes(bare), FLIGHTS),)
    found.fitted(CONTACT, bare)
    return found


@pytest.mark.parametrize("ohm", [0.004, 0.012])
@pytest.mark.parametrize("by_v", [-0.05, 0.05])
def test_a_slow_misfit_beside_a_contact_is_not_its_to_explain(by_v, ohm):
    found = looked_for(tuple(off_by_its_curve(failing(ohm), by_v=by_v)))
    assert select(found).names == CONTACT


def test_a_slow_misfit_gives_a_contact_no_size():
    found = looked_for(tuple(off_by_its_curve(failing(0.004), by_v=-0.1)))
    assert found.alone(CONTACT) == pytest.approx(found.added(CONTACT), rel=0.05)


def test_what_is_below_the_noise_is_explained_as_far_as_the_equation_has_its_size():
    """The noise is never given less than the floor of a cell's: what there is to explain may come to less than none."""
    found = looked_for(failing(0.002))
    found.noise = replace(found.noise, sigma_v=10.0 * found.noise.sigma_v)
    assert share(found, CONTACT) == pytest.approx(1.0, abs=0.3)


def test_a_small_contact_matters_while_it_lasts():
    """However long has been flown without it: over all flights its RMS is below what anybody cares for."""
    found = looked_for(failing(0.004, end=440.0))
    assert added(found, CONTACT)["intermittent-contact"] < SERIES * LEAST_V
    assert select(found).names == CONTACT


@pytest.mark.parametrize("over_s", [15.0, 25.0, 60.0])
def test_what_comes_and_goes_slowly_is_no_contact(over_s):
    """An episode from half its depth to half its depth would explain most of it, but a contact has no slopes."""
    flights = list(failing(0.0))
    dip = 0.4 * np.exp(-0.5 * ((flights[1].time_s - 500.0) / over_s) ** 2)
    flights[1] = replace(flights[1], voltage_v=flights[1].voltage_v - dip)
    assert episodes(searching(tuple(flights), set()).fitted(frozenset())) == []


def test_what_the_lab_left_open_takes_up_is_not_said_to_go_with_the_contact():
    assert share_of_contact(failing(0.012)) > 0.9
    assert share_of_contact(off_by_its_curve(failing(0.012), by_v=0.05)) < 0.2


def share_of_contact(flights):
    found = looked_for(tuple(flights))
    fitted = found.fitted(CONTACT)
    return shares_of(fitted, courses_of(found.base, fitted))["intermittent-contact"]
