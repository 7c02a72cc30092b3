"""Flights that begin at rest say by their voltage what charge they begin with."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from discrepancy.flown import base, catalogue, flown, noise_model, told_its_form

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.before_load import before_load, begins_as_read, unloaded_a
from bhm_service.discrepancy.confirm import Unseen
from bhm_service.discrepancy.crossing import witness
from bhm_service.discrepancy.decision import decide, with_the_zero
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.search import Search, search
from bhm_service.discrepancy.selection import Selection

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


LOAD, ZERO, FADE = frozenset({"unseen-load"}), frozenset({"current-offset"}), frozenset({"capacity-fade"})


def missing(effect, amps, idle_a=0.3):
    """Flights on which a sensor misses a current, for one reason or the other, and what it reads at rest."""
    number = {"unseen-load": "current", "current-offset": "offset"}[effect]
    return tuple(flown([EFFECTS[effect](**{number: amps})], seed=5, number=k, idle_a=idle_a) for k in range(4))


@pytest.mark.parametrize(("effect", "idle_a", "zeroed"), [
    ("current-offset", -1.7, True), ("current-offset", -0.4, False), ("unseen-load", 0.3, False),
])  # fmt: skip
@pytest.mark.parametrize("chosen", [LOAD, FADE], ids=["load", "fade"])
def test_a_sensor_that_reads_far_less_than_nothing_at_rest_has_its_zero_off(chosen, effect, idle_a, zeroed):
    """What the avionics draw there may hide the most of an offset: then nothing tells it from a load."""
    flights = missing(effect, 2.0, idle_a)
    found = Search(base(flights), tuple(catalogue(flights, only=LOAD | ZERO | FADE)), noise_model())
    for names in (frozenset(), LOAD, FADE):
        found.fitted(names)
    selected = Selection(chosen, ((LOAD | FADE) - chosen,), found.earned(chosen), {})
    first = with_the_zero(found, selected)
    assert (first.names == ZERO) is zeroed
    assert set(first.alternatives) == {FADE} if zeroed else first is selected


def test_a_zero_that_is_off_is_named_though_a_load_of_its_size_is_more_usual():
    flights = missing("current-offset", 3.0, -2.7)
    found = search(Joint(told_its_form(base(flights).lab), flights), catalogue(flights, only=LOAD | ZERO))
    closer = witness(found.base.lab, found.base, found.candidates, near=found)
    assert found.evidence(LOAD) > found.evidence(ZERO)
    decided = decide(Unseen(found), None, closer, flights, np.random.default_rng(1)).chosen
    assert (decided.names, decided.alternatives) == (ZERO, ())


def test_only_what_is_read_before_the_load_is_read_at_rest():
    assert unloaded_a(missing("current-offset", 2.0, -1.7)) == pytest.approx(-1.7)
    assert (
        unloaded_a([replace(f, current_a=np.full(f.current_a.shape, 12.0)) for f in missing("unseen-load", 1.0)])
        is None
    )
