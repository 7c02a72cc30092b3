"""Flights that begin at rest say by their voltage what charge they begin with."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from discrepancy.flown import base, catalogue, flown, noise_model, told_its_form

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.before_load import before_load, begins_as_read
from bhm_service.discrepancy.confirm import Unseen
from bhm_service.discrepancy.crossing import witness
from bhm_service.discrepancy.decision import decide
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.search import Search, search

NAMES = frozenset({"partial-charge"})
DEFICITS = (0.12, 0.18)


def less_full(k):
    return [EFFECTS["partial-charge"](deficit=DEFICITS[k])]


def smaller(k):
    """The other pack's like that lacks charge: it holds less, by as much in each flight."""
    return [EFFECTS["capacity-fade"](fade=DEFICITS[k])]


def begun_from(flights):
    found = Search(base(flights), tuple(catalogue(flights, only=NAMES)), noise_model())
    return begins_as_read(found.fitted(NAMES), found.added_by(NAMES))


@pytest.mark.parametrize(("made", "as_read"), [(less_full, True), (smaller, False)])
def test_packs_that_were_not_full_read_less_before_their_load_and_smaller_ones_do_not(made, as_read):
    assert begun_from([flown(made(k), seed=3, number=k) for k in range(2)]) is as_read


@pytest.mark.parametrize(("made", "names"), [(less_full, NAMES), (smaller, frozenset())])
def test_what_flights_deny_at_rest_is_not_named(made, names):
    flights = tuple(flown(made(k), seed=3, number=k, rested=False) for k in range(2))
    found = search(Joint(told_its_form(base(flights).lab), flights), catalogue(flights, only=NAMES))
    assert found.evidence(NAMES) > 100.0  # either way
    closer = witness(found.base.lab, found.base, found.candidates, near=found)
    decided = decide(Unseen(found), None, closer, flights, np.random.default_rng(1))
    assert decided.chosen.names == names


def test_flights_that_begin_under_load_deny_nothing():
    def aloft(flight):
        kept = flight.time_s >= 60.0
        every = {field.name: getattr(flight, field.name) for field in fields(flight)}
        return replace(flight, **{name: own[kept] for name, own in every.items() if np.shape(own) == kept.shape})

    assert begun_from([aloft(flown(smaller(k), seed=3, number=k)) for k in range(2)])


def test_what_is_read_before_the_load_is_what_comes_before_it():
    flight = flown(seed=1)
    rests = before_load(flight)
    assert flight.time_s[rests].tolist() == flight.time_s[flight.time_s < 30.0].tolist()
    blind = replace(flight, voltage_v=np.where(flight.time_s < 9.0, np.nan, flight.voltage_v))
    assert before_load(blind).sum() == rests.sum() - 3
