"""Sizes by all the courses that a driver may have had which nobody recorded."""

import numpy as np
import pytest
from discrepancy.flown import base, catalogue, flown, noise_model
from discrepancy.unrecorded import COOLS, ENERGY, days, warmed

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.marginal import likelier, likeliest

WARMTH, SIZE = "resistance-temperature", "resistance-temperature.activation_energy"
DAYS = days(14)
CANDIDATE = {"only": {WARMTH}}


@pytest.fixture(scope="module")
def fits():
    """The best fit of all numbers together, and the likeliest size."""
    flights = warmed(DAYS)
    joint = Joint(base(flights).lab, flights, tuple(catalogue(flights, **CANDIDATE)))
    best = fit(joint, noise_model())
    return best, likeliest(best)


def size(fitted):
    return float(fitted.joint.values(fitted.x[None, :])[SIZE][0, 0])


def test_the_best_fit_of_a_size_and_of_what_it_multiplies_is_too_large_and_the_likeliest_is_not(fits):
    best, likely = fits
    assert size(best) > 1.25 * ENERGY
    assert size(likely) == pytest.approx(ENERGY, rel=0.15)
    assert likely.evidence(1.0) > best.evidence(1.0)


def test_temperatures_differ_as_they_did_where_the_size_is_the_likeliest(fits):
    apart = [np.ptp(f.joint.values(f.x[None, :])["self-heating.ambient"][0]) / np.ptp(DAYS) for f in fits]
    assert apart[0] < apart[1] < 1.2


def test_a_pack_cools_as_it_did_where_that_is_the_likeliest(fits):
    """The faster it cools, the more numbers of every flight have something to say: the best fit takes them all."""
    best, likely = (f.joint.values(f.x[None, :])["self-heating.conductance"][0, 0] for f in fits)
    assert best > 1.6 * COOLS
    assert likely == pytest.approx(COOLS, rel=0.3)


def test_of_two_valleys_the_one_with_more_in_it_is_taken_not_the_deepest(fits):
    best, likely = fits
    assert best.cost < likely.cost
    assert likelier([best, likely]) is likely


def test_a_fit_that_begins_from_the_likeliest_stays_there(fits):
    _, likely = fits
    again = fit(likely.joint, likely.noise, likely.x)
    assert size(again) == pytest.approx(size(likely), rel=0.03)


def test_what_is_recorded_is_fitted_as_it_was():
    warm = tuple(flown([EFFECTS[WARMTH](activation_energy=22e3)], number=k, kelvin=278.0 + 8.0 * k) for k in range(3))
    fitted = fit(Joint(base(warm).lab, warm, tuple(catalogue(warm, **CANDIDATE))), noise_model())
    assert likeliest(fitted) is fitted
