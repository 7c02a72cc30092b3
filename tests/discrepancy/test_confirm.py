"""A flight that is held out teaches nothing that is then held against it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import flown, four, searching, told_its_form, with_steps_that_come_earlier
from discrepancy.unrecorded import days, warmed

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.confirm import Unseen, harmful, held_out, predicted_from_quarter
from bhm_service.discrepancy.sidecar import Notes
from bhm_service.discrepancy.steps import Episode, contact_candidate

FADE = frozenset({"capacity-fade"})
FLIGHTS = four("capacity-fade", seed=3)


def changed_later(flight, volts):
    """The same flight until a quarter of it, another after it, and another rested voltage."""
    voltage = flight.voltage_v.copy()
    voltage[int(np.ceil(0.25 * voltage.size)) :] -= volts
    rested = replace(flight.notes, rest_voltage_v=flight.notes.rest_voltage_v - volts)
    return replace(flight, voltage_v=voltage, notes=rested)


@pytest.fixture(scope="module")
def proof():
    return held_out(Unseen(searching(FLIGHTS, FADE)), FADE)


def test_the_effect_is_confirmed_on_every_flight(proof):
    for flight in proof.flights:
        assert flight.rmse(flight.after_v) < 0.5 * flight.rmse(flight.before_v)
    assert proof.after_v < 0.02
    assert not proof.from_assumed
    assert max(proof.after_v, proof.tuned_v) < proof.before_v


def test_only_what_was_not_seen_is_scored(proof):
    flight = proof.flights[0]
    assert flight.begin == int(np.ceil(0.25 * flight.after_v.size))
    spoilt = flight.after_v.copy()
    spoilt[: flight.begin] += 10.0
    assert flight.rmse(spoilt) == flight.rmse(flight.after_v)


def test_a_pack_that_waits_on_the_ground_is_seen_for_a_quarter_of_its_flight():
    """For five minutes of sixteen it shows its charge."""
    waiting = [replace(f, airborne=f.airborne & (f.time_s >= 300.0)) for f in FLIGHTS]
    flight = held_out(Unseen(searching(waiting, FADE)), FADE).flights[0]
    assert flight.begin == 100 + int(np.ceil(0.25 * (flight.after_v.size - 100)))


@pytest.mark.parametrize("volts", [0.05, 0.3])
def test_what_a_held_out_flight_measured_later_does_not_reach_its_prediction(proof, volts):
    """Its last three quarters are put off; what is predicted of it must not follow."""
    other = [changed_later(FLIGHTS[0], volts), *FLIGHTS[1:]]
    found = held_out(Unseen(searching(other, FADE)), FADE)
    moved = found.flights[0].after_v - proof.flights[0].after_v
    assert np.abs(moved).max() < 0.001
    # What the others are told by it does change, so it is not simply ignored.
    assert np.abs(found.flights[1].after_v - proof.flights[1].after_v).max() > 0.001


def test_nor_does_it_where_nobody_recorded_what_drives_the_effect():
    """How large all flights together make such a size is nothing that the others alone say."""
    warmth = frozenset({"resistance-temperature"})
    flights = warmed(days(6))
    was, now = (
        held_out(Unseen(searching(others, warmth)), warmth).flights
        for others in (flights, (changed_later(flights[0], 0.3), *flights[1:]))
    )
    assert np.abs(now[0].after_v - was[0].after_v).max() < 0.001 * 0.3
    assert np.abs(now[1].after_v - was[1].after_v).max() > 0.001


def test_a_flight_of_which_nobody_recorded_how_cold_it_was_is_foretold_though_steps_of_the_curve_come_earlier():
    """What its own first quarter shows of them has to be no temperature."""
    law, joules = frozenset({"resistance-temperature"}), 30e3
    cold = [
        flown([EFFECTS["resistance-temperature"](activation_energy=joules)], seed=3, number=k, kelvin=kelvin)
        for k, kelvin in enumerate((272.0, 282.0, 292.0, 302.0, 287.0))
    ]
    flights = tuple(replace(with_steps_that_come_earlier(f, joules), temperature_k=None) for f in cold)
    found = searching(flights, law)
    found.base = replace(found.base, lab=told_its_form(found.base.lab))
    foretold = held_out(Unseen(found), law)
    assert foretold.after_v < 0.4 * foretold.before_v


def test_the_one_worn_pack_among_new_ones_shows_in_its_own_first_quarter():
    """Nothing of it is in the other flights: what they leave of its wear is what was known before."""
    growth = frozenset({"resistance-growth"})
    ages, true = (1.0, 2.0, 3.0, 300.0), 1.2
    flights = [
        replace(
            flown([EFFECTS["resistance-growth"](growth=true, age=age / ages[-1])], seed=5, number=k),
            notes=Notes(cycles=age),
        )
        for k, age in enumerate(ages)
    ]
    worn = held_out(Unseen(searching(flights, growth)), growth).flights[-1]
    assert worn.rmse(worn.before_v) > 0.1
    assert worn.rmse(worn.after_v) < 0.2 * worn.rmse(worn.before_v)


@pytest.mark.parametrize("missing", [True, False])
def test_a_start_that_the_first_quarter_shows_does_not_speak_against_charge_that_is_missing(missing):
    """A battery that is right otherwise follows such flights from there as well as any explanation does."""
    partly = frozenset({"partial-charge"})
    flights = four("partial-charge", seed=3) if missing else [flown(seed=3, number=k) for k in range(4)]
    unseen = Unseen(searching(flights, partly))
    assert harmful(unseen, partly) is not missing
    assert held_out(unseen, partly).from_assumed


@pytest.mark.parametrize(("deep", "refused"), [(True, False), (False, True)])
def test_beyond_the_charges_of_all_other_flights_nothing_speaks_for_or_against_an_effect(deep, refused):
    """One flight goes on where the others have landed; there the lab may be off by what nothing has taught."""
    fade = EFFECTS["capacity-fade"](fade=0.1, area=0.0, settled=1.0)
    flights = [flown([fade], seed=3, number=k, samples=1100 if k == 1 else 800) for k in range(4)]
    found = searching(flights, FADE)
    told, bare = Unseen(found).by(FADE), Unseen(found).as_it_is(FADE)
    at = found.fitted(FADE)
    soc = [flight.soc for flight in at.joint.all_predicted(at.x[None, :])]
    alone = soc[1] < min(course.min() for k, course in enumerate(soc) if k != 1)
    assert 100 < alone.sum() < 400
    where = alone if deep else ~alone
    far = 10.0 * float(np.abs(told[1] - bare[1]).max())
    doctored = [np.where(where, v - far, v) if k == 1 else v for k, v in enumerate(told)]
    assert harmful(Unseen(found, {FADE: doctored}), FADE) is refused


@pytest.mark.parametrize(("begin", "foreseen"), [(100.0, True), (400.0, False)])
def test_a_contact_that_goes_bad_later_is_not_foreseen(begin, foreseen):
    """Its time is known from having seen it; of one that is bad already the size is told by the first quarter."""
    contact, name = EFFECTS["intermittent-contact"], frozenset({"intermittent-contact"})
    flights = [flown([contact(resistance=0.010, begin=begin, end=800.0)] if k == 1 else (), number=k) for k in range(3)]
    found = searching(flights, frozenset())
    found.candidates = (contact_candidate([Episode(1, begin, 800.0, 0.010, 10.0, open_end=False)], 3),)
    unseen = Unseen(found)
    does = np.abs(unseen.by(name)[1] - unseen.by(frozenset())[1])[flights[1].airborne].max()
    assert (does > 0.05) == foreseen
    assert not harmful(unseen, name)


@pytest.mark.parametrize(("pulled", "told"), [(0.5, False), (2.5, True)])
def test_a_size_that_the_others_pull_away_from_what_was_expected_is_told_by_them(pulled, told):
    """However loosely: with it stands all else that they taught, and no first quarter takes it back alone."""
    growth, size = frozenset({"resistance-growth"}), "resistance-growth.growth"
    flights = [replace(flown((), seed=6, number=k), notes=Notes(cycles=100.0 * (k + 1))) for k in range(4)]
    found = searching(flights, growth)
    learnt = found.fitted(growth)
    at = learnt.joint.places[size]
    there = learnt.x.copy()
    there[at] = learnt.joint.unknowns.start[at] + pulled * learnt.joint.scale[at]
    loosely = replace(learnt, x=there, curvature=learnt.joint.known)
    by_them = predicted_from_quarter(learnt.joint, loosely, 3, found.noise)
    by_all = predicted_from_quarter(learnt.joint, learnt, 3, found.noise)
    # The pack is as new: a quarter that may move the size finds so, one that may not has the wear of the others.
    off = np.sqrt(np.nanmean((by_them - by_all)[flights[3].airborne] ** 2))
    assert (off > 0.05) == told


def test_a_flight_in_which_a_contact_fails_unforeseen_does_not_speak_against_it():
    """It outweighs the others, and is foretold a little worse with it; they are foretold better."""
    contact, name = EFFECTS["intermittent-contact"], frozenset({"intermittent-contact"})
    flights = [flown([contact(resistance=0.05, begin=400.0, end=800.0)] if k == 1 else (), number=k) for k in range(4)]
    found = searching(flights, frozenset())
    bare = Unseen(found).as_it_is(name)

    def foretold_worse_by(shares):
        doctored = [m + s * (m - f.voltage_v) for s, m, f in zip(shares, bare, flights, strict=True)]
        return Unseen(found, {name: doctored})

    assert not harmful(foretold_worse_by([-0.03, 0.02, -0.03, -0.03]), name)
    assert harmful(foretold_worse_by([0.02, 0.02, 0.02, 0.02]), name)


def test_what_a_fit_foretells_is_foretold_anew_where_a_better_one_is_found():
    found = searching(FLIGHTS, FADE)
    unseen = Unseen(found)
    once = unseen.by(FADE)
    assert unseen.by(FADE) is once
    found.fits[FADE] = replace(found.fits[FADE])
    assert unseen.by(FADE) is not once


def test_two_flights_are_too_few_to_hold_one_out():
    assert held_out(Unseen(searching(FLIGHTS[:2], FADE)), FADE) is None


def test_a_single_effect_is_nobodys_harmful_companion():
    assert not harmful(Unseen(searching(FLIGHTS, FADE)), FADE)


@pytest.mark.parametrize(
    ("name", "share", "refused"),
    [
        ("capacity-fade", 0.97, True),
        ("capacity-fade", 0.93, False),
        ("time-skew", 0.97, False),
        ("time-skew", 1.01, True),
        ("capacity-fade+time-skew", 0.97, True),
    ],
)
def test_what_explains_lowers_the_error_on_unseen_flights_by_a_twentieth(name, share, refused):
    """A name that only fits, however well, is none; what lasts for seconds adds little to the error of a flight."""
    names = frozenset(name.split("+"))
    unseen = Unseen(searching(FLIGHTS, names))
    as_it_is = unseen.as_it_is(names)
    measured = [f.voltage_v for f in FLIGHTS]
    doctored = [v - share * (v - m) for v, m in zip(measured, as_it_is, strict=True)]
    unseen = Unseen(unseen.found, dict.fromkeys((names, *(names - {m} for m in names)), doctored))
    assert harmful(unseen, names) is refused


def test_a_companion_that_helps_is_not_harmful():
    both = frozenset({"capacity-fade", "resistance-growth"})
    assert not harmful(Unseen(searching(FLIGHTS, both)), FADE | {"resistance-growth"})
