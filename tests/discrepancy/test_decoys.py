"""Phantom drivers lose against the temperature that was the cause, and win against one that was not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import four, searching

from bhm_service.discrepancy.decoys import contests

COLD = frozenset({"resistance-temperature"})
FLIGHTS = four("resistance-temperature", seed=4)


@pytest.fixture(scope="module")
def true():
    return contests(searching(FLIGHTS, COLD), COLD, np.random.default_rng(0))


def test_the_true_temperature_beats_every_phantom(true):
    assert len(true) >= 5
    assert all(c.beaten for c in true)
    assert min(c.nats for c in true) > 6.0


def test_a_temperature_of_the_wrong_flight_loses_to_that_of_the_right_one():
    shuffled = [replace(f, temperature_k=FLIGHTS[(k + 1) % 4].temperature_k) for k, f in enumerate(FLIGHTS)]
    found = contests(searching(shuffled, COLD), COLD, np.random.default_rng(0))
    assert np.mean([c.beaten for c in found]) < 0.8
    assert min(c.nats for c in found) < -6.0


def test_an_effect_that_follows_no_temperature_has_no_contest():
    growth = frozenset({"resistance-growth"})
    assert contests(searching(FLIGHTS, growth), growth, np.random.default_rng(0)) == []
