"""What the numbers of an effect may be off by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import catalogue, flown, four, noise_model, with_members

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.quantities import measured, parameters, teller

FADE, LOAD = "capacity-fade", "unseen-load"


@pytest.fixture(scope="module")
def faded():
    """A fit of four flights of a pack that has lost a tenth."""
    return fit(with_members(four(FADE, seed=2), {FADE}), noise_model())


def moved(fitted, step):
    """The fit of another model that puts the lost capacity that far from there."""
    x = fitted.x.copy()
    x[fitted.joint.places[f"{FADE}.fade"]] += step
    return replace(fitted, x=x, rows=[1.001 * row for row in fitted.rows])


def test_two_models_of_the_cell_are_two_halves_of_what_is_known(faded):
    """The spread is that of draws from both, about what the likelier one says, in whichever order they come."""
    alone = parameters([faded], FADE)["fade"]
    both = parameters([faded, moved(faded, 0.03)], FADE)["fade"]
    assert both == parameters([moved(faded, 0.03), faded], FADE)["fade"]
    assert both.value == alone.value
    rng = np.random.default_rng(1)
    drawn = rng.normal(np.where(rng.random(200_000) < 0.5, 0.0, 0.03), alone.sd)
    assert both.sd == pytest.approx(float(np.sqrt(np.mean(drawn**2))), rel=0.01)


def test_models_of_the_cell_that_agree_add_nothing(faded):
    alone, both = parameters([faded], FADE), parameters([faded, moved(faded, 0.0)], FADE)
    assert both == alone


def test_the_model_that_follows_the_flights_tells_the_numbers():
    """A pack that lost a tenth, and a lab with twice its resistance: the other one's model is the pack's."""
    flights = four(FADE, seed=2)
    right = with_members(flights, {FADE})
    wrong = replace(right, lab=replace(right.lab, cell=replace(right.lab.cell, r_s=2.0 * right.lab.cell.r_s)))
    # How far a noise is doubted is no sign of its model.
    fits = [fit(wrong, noise_model()), fit(right, replace(noise_model(), doubt=4.0))]
    assert teller(fits, FADE) is fits[1]
    assert teller(fits[::-1], FADE) is fits[1]


def test_a_model_at_the_end_of_what_is_physical_tells_no_numbers(faded):
    """However likely it makes the flights."""
    where = faded.joint.places[f"{FADE}.fade"]
    high = float(faded.joint.unknowns.high[where][0])
    most = replace(moved(faded, high - float(faded.x[where][0])), rows=[0.5 * row for row in faded.rows])
    assert teller([most, faded], FADE) is faded
    assert teller([faded, most], FADE) is faded


def test_what_was_found_is_as_large_as_the_flights_say_and_not_as_expected():
    """Loads past the sensor are expected to be of 1.2 A, give or take 0.8 A; here it is of 4 A."""
    flights = [flown([EFFECTS[LOAD](current=4.0)], seed=2, number=k, rested=False) for k in range(4)]
    found = fit(with_members(flights, {LOAD}), noise_model())
    as_expected, as_measured = parameters([found], LOAD)["current"], parameters([measured(found)], LOAD)["current"]
    assert as_expected.value < as_measured.value
    assert abs(as_measured.value - 4.0) < as_measured.sd < 0.4


@pytest.mark.parametrize("name", ["weak-cell", "resistance-temperature"])
def test_what_flights_cannot_tell_apart_stays_as_expected(name):
    """How much capacity one cell has lost and how much resistance it has; how cold it was and what the cold does."""
    (candidate,) = catalogue(four(seed=2), only={name})
    assert len(candidate.amplitudes()) > 1 or candidate.inferred
    assert candidate.unexpected() is candidate
