"""A contact that goes bad for a while is found in its flight, at its times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import base, flown, noise_model, with_members

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.noise import doubt_of_alike
from bhm_service.discrepancy.steps import contact_candidate, episodes

KIND = EFFECTS["intermittent-contact"]
NOISE = noise_model()


def three(bad, begin, end, milliohm=10.0):
    """Three flights, of which one has a bad contact."""
    return [
        flown([KIND(resistance=1e-3 * milliohm, begin=begin, end=end)] if k == bad else (), seed=5, number=k)
        for k in range(3)
    ]


@pytest.mark.parametrize("flights", [3, 9])
def test_how_many_flights_had_none_says_nothing_against_an_episode(flights):
    """What a model gets wrong alike in many flights is not what one of them has alone."""
    others = [flown(seed=5, number=k) for k in range(3, flights)]
    found = episodes(fit(base([*three(1, 250.0, 520.0, 2.5), *others]), replace(NOISE, doubt=doubt_of_alike(flights))))
    assert [e.flight for e in found] == [1]


@pytest.mark.parametrize(
    ("bad", "begin", "end", "milliohm"),
    [
        (1, 250.0, 520.0, 10.0),
        (0, 400.0, 460.0, 10.0),
        (2, 130.0, 800.0, 10.0),
        (0, 400.0, 460.0, 25.0),
        (1, 250.0, 520.0, 25.0),
    ],
)
def test_an_episode_is_found_within_ten_seconds_in_its_flight_and_no_other(bad, begin, end, milliohm):
    found = episodes(fit(base(three(bad, begin, end, milliohm)), NOISE))
    assert {e.flight for e in found} == {bad}
    assert found[0].begin_s == pytest.approx(begin, abs=10.0)
    assert found[0].end_s == pytest.approx(end, abs=10.0)
    assert not found[0].open_end


def test_a_small_one_is_found_beside_numbers_that_the_other_flights_tell():
    """What a lab leaves open could take it up in its own flight, but then it would be in all of them."""
    flights = [*three(1, 250.0, 520.0, 1.6), *(flown(seed=5, number=k) for k in range(3, 6))]
    (found,) = episodes(fit(base(flights), replace(NOISE, doubt=doubt_of_alike(6))))
    assert found.flight == 1
    assert (found.begin_s, found.end_s) == pytest.approx((250.0, 520.0), abs=10.0)
    assert found.ohm == pytest.approx(1.6e-3, rel=0.3)


def test_two_or_three_samples_of_an_averaged_recording_are_no_episode():
    """Of samples that are 15 s apart they may be one peak of the current."""
    found = episodes(fit(base([f.thinned(70) for f in three(1, 400.0, 430.0, 25.0)]), NOISE))
    assert all(e.end_s - e.begin_s > 70.0 for e in found)


def test_a_contact_that_stays_bad_has_no_end():
    (found,) = episodes(fit(base(three(1, 500.0, 1e6)), NOISE))
    assert found.begin_s == pytest.approx(500.0, abs=10.0)
    assert found.open_end


@pytest.mark.parametrize("seed", range(3))
def test_flights_without_one_have_none(seed):
    flights = [flown(seed=seed, number=k) for k in range(3)]
    assert episodes(fit(base(flights), NOISE)) == []


def test_resistance_that_is_higher_all_along_is_no_episode():
    flights = [flown([EFFECTS["resistance-growth"](growth=0.5)], seed=5, number=k) for k in range(3)]
    assert episodes(fit(with_members(flights, {"resistance-growth"}), NOISE)) == []


def test_as_an_effect_it_has_the_resistance_that_was_added():
    flights = three(1, 250.0, 520.0)
    found = contact_candidate(episodes(fit(base(flights), NOISE)), 3)
    joint = base(flights)
    fitted = fit(type(joint)(joint.lab, joint.flights, (found,)), NOISE)
    (unknown,) = found.unknowns
    where = joint.places | fitted.joint.places
    assert fitted.x[where[unknown.name]][0] == pytest.approx(10.0, abs=4.0 * fitted.sd(unknown.name)[0])
    assert np.all(fitted.sd(unknown.name) < 5.0)
    assert found.price > 0.0
