"""A filter that is changed between flights: found with its flight and its lag, and in nothing that a pack does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, flown, noise_model, searching
from scipy.signal import lsim

from bhm_service.discrepancy.changed_lag import changed_lag
from bhm_service.discrepancy.decision import outweighed
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.selection import NOTHING
from bhm_service.discrepancy.words import left_in_words

USUAL = noise_model()
LAB = lab_of(BATTERY, "circ", None, None)


def six(seed=0, kelvin=(None,) * 6):
    return [flown(seed=seed, number=k, kelvin=warmth, samples=600, step_s=1.0) for k, warmth in enumerate(kelvin)]


def filtered(data, seconds):
    """The same read through a first-order filter, by itself."""
    rested = data.voltage_v[0]
    _, told, _ = lsim(([1.0], [seconds, 1.0]), data.voltage_v - rested, data.time_s)
    return replace(data, voltage_v=told + rested)


def found(flights):
    return changed_lag(fit(Joint(LAB, tuple(flights)), USUAL), flights)


@pytest.mark.parametrize("first", [2, 3, 4])
def test_a_filter_that_begins_with_a_flight_is_owned_up_to_with_that_flight(first):
    flights = [filtered(f, 1.0) if k >= first else f for k, f in enumerate(six())]
    chosen, left = outweighed(searching(flights, ["capacity-fade"]), NOTHING, LAB, flights)
    assert chosen.names == frozenset()
    assert left.flight == flights[first].label
    said = left_in_words(left)
    assert f"from {flights[first].label} on" in said
    assert "later" in said


def test_a_filter_that_goes_is_found_with_the_other_sign():
    flights = [filtered(f, 1.0) if k < 3 else f for k, f in enumerate(six())]
    left = found(flights)
    assert "sooner" in left_in_words(left)


@pytest.mark.parametrize("seed", range(6))
def test_flights_through_one_filter_have_none(seed):
    assert found(six(seed)) is None
    assert found([filtered(f, 1.5) for f in six(seed)]) is None


def test_one_flight_alone_is_an_odd_flight():
    flights = six()
    assert found([*flights[:-1], filtered(flights[-1], 1.5)]) is None


@pytest.mark.parametrize("seconds", [0.5, 3.0])
def test_quick_and_slow_filters_are_found_alike(seconds):
    flights = [filtered(f, seconds) if k >= 3 else f for k, f in enumerate(six())]
    assert found(flights).flight == flights[3].label


def test_a_small_part_of_a_sample_is_a_matter_of_when_within_it_the_sensors_are_read():
    many = six(kelvin=(None,) * 14)
    assert found([filtered(f, 0.2) if k >= 7 else f for k, f in enumerate(many)]) is None


@pytest.mark.parametrize("seed", range(6))
def test_flights_in_which_little_is_told_differ_by_chance(seed):
    rng = np.random.default_rng(seed)
    loud = [replace(f, voltage_v=f.voltage_v + 0.3 * rng.standard_normal(f.time_s.size)) for f in six()]
    assert found(loud) is None


def test_cold_flights_after_warm_ones_are_no_other_filter():
    assert found(six(kelvin=(300.0, 301.0, 299.0, 275.0, 276.0, 274.0))) is None
