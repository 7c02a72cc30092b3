"""How alike flights are expected to be in a course that nobody recorded."""

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import base, catalogue, flown, noise_model
from discrepancy.unrecorded import days, warmed

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.alikeness import FlightSpread
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.joint import Joint

WARMTH = "resistance-temperature"
ROOM, SEASONS = np.full(6, 288.0), days(6)


def alone(flights):
    (candidate,) = catalogue(flights, only={WARMTH})
    joint = Joint(base(flights).lab, flights, (candidate,))
    return candidate, fit(joint, noise_model())


def fitted_with(candidate, at):
    return fit(replace(at.joint, members=(candidate,)), at.noise, at.x)


def apart(candidate):
    """How far flights are expected to lie from each other at the start. [K]"""
    of = {u.declared.name: u for u in candidate.unknowns}
    return of["ambient"].apart, of["start_above"].prior[1]


@pytest.fixture(scope="module")
def room():
    return alone(warmed(ROOM))


def test_packs_from_one_room_are_expected_as_alike_as_they_are(room):
    candidate, at = room
    alike = FlightSpread(candidate, at).told()
    assert max(apart(alike)) < 0.3 * min(apart(candidate))
    fits = [fitted_with(c, at) for c in (candidate, alike)]
    plain, paid = (f.evidence(1.0) - c.price for c, f in zip((candidate, alike), fits, strict=True))
    assert paid > plain + 5.0


def test_days_that_differ_stay_as_far_apart_as_days_do():
    candidate, at = alone(warmed(SEASONS))
    ambient, above = apart(FlightSpread(candidate, at).told())
    assert ambient > 0.5 * np.std(SEASONS)
    assert above <= apart(candidate)[1]


def test_what_it_chooses_is_what_fits_of_the_choices_say(room):
    """The fits themselves, in place of the linear problem that one of them leaves."""
    candidate, at = room
    of = {u.declared.name: k for k, u in enumerate(candidate.unknowns)}

    def evidence(share):
        unknowns = list(candidate.unknowns)
        for name in ("ambient", "start_above"):
            unknowns[of[name]] = unknowns[of[name]].closer(share)
        return fitted_with(replace(candidate, unknowns=tuple(unknowns)), at).evidence(1.0)

    assert evidence(0.1) > evidence(0.4) > evidence(1.0)


def test_what_is_recorded_is_expected_as_declared():
    flights = tuple(replace(f, temperature_k=np.full(f.time_s.size, 290.0 + k)) for k, f in enumerate(warmed(ROOM)))
    candidate, at = alone(flights)
    assert FlightSpread(candidate, at).told() is candidate


@pytest.mark.parametrize("ambients", [ROOM, SEASONS], ids=["one room", "days"])
def test_without_a_flight_it_is_as_the_others_by_themselves_say(ambients):
    """One flight is of a hot day: it alone would have all flights lie far apart."""
    hot = np.append(ambients, 312.0)
    candidate, at = alone(warmed(hot))
    _, of_others = alone(warmed(hot)[:-1])
    seen, unseen = (apart(FlightSpread(candidate, at).told(left)) for left in (None, hot.size - 1))
    expected = apart(FlightSpread(candidate, of_others).told())
    np.testing.assert_allclose(np.log(unseen), np.log(expected), atol=0.47)  # one of the steps that are tried
    assert ambients is SEASONS or max(unseen) < 0.6 * max(seen)


def test_sizes_of_single_flights_are_expected_without_the_one_that_is_unseen():
    deficits = (0.01, 0.02, 0.015, 0.07)
    physics = [[EFFECTS["partial-charge"](deficit=own)] for own in deficits]
    flights = tuple(flown(own, seed=2, number=k) for k, own in enumerate(physics))
    (candidate,) = catalogue(flights, only={"partial-charge"})
    at = fit(Joint(base(flights).lab, flights, (candidate,)), noise_model())
    spread = FlightSpread(candidate, at)

    def sd(told):
        return told.amplitudes()[0].prior[1]

    assert sd(spread.told(int(np.argmax(deficits)))) < 0.7 * sd(spread.told())
