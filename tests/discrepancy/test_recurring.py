"""What comes back with a period: found whatever its phase, and neither in noise nor where manoeuvres come back."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, four, noise, noise_model, searching

from bhm_service.discrepancy.decision import outweighed
from bhm_service.discrepancy.lab import lab_of
from bhm_service.discrepancy.recurring import recurring
from bhm_service.discrepancy.selection import NOTHING
from bhm_service.discrepancy.words import left_in_words

PERIOD_S = 110.0
USUAL = noise_model()
LAB = lab_of(BATTERY, "circ", None, None)


def switched(data, volts, number):
    phase = data.time_s + 37.0 * number
    return replace(data, voltage_v=data.voltage_v - volts * (phase % PERIOD_S < 0.4 * PERIOD_S))


def left(series, flights):
    """What a fit leaves, its noise taken for the usual one."""
    rows = [USUAL.whitened(s) for s in series]
    return recurring(SimpleNamespace(joint=SimpleNamespace(flights=flights), rows=rows))


def test_a_load_that_switches_by_itself_is_owned_up_to_with_its_period():
    flights = [switched(f, 0.03, k) for k, f in enumerate(four())]
    chosen, found = outweighed(searching(flights, ["capacity-fade"]), NOTHING, LAB, flights)
    assert chosen.names == frozenset()
    assert found.period_s == pytest.approx(PERIOD_S, rel=0.03)
    assert f"every {found.period_s:.0f} s" in left_in_words(found)


@pytest.mark.parametrize("phi", [0.0, 0.9, 0.98])
def test_noise_of_no_colour_comes_back(phi):
    flights = four()
    for seed in range(100):
        rng = np.random.default_rng(seed)
        assert left([noise(rng, f.time_s.size, phi, coloured_v=0.02) for f in flights], flights) is None


def test_what_comes_back_in_the_first_half_of_every_flight_only_is_a_course():
    flights = four()
    rng = np.random.default_rng(1)
    bursts = [np.sin(2.0 * np.pi * f.time_s / 60.0) * (f.time_s < 0.5 * f.time_s[-1]) for f in flights]
    assert left([0.03 * b + noise(rng, b.size) for b in bursts], flights) is None


def test_what_comes_back_with_the_manoeuvres_is_the_models_own():
    rng = np.random.default_rng(1)
    waves = [np.sin(2.0 * np.pi * f.time_s / PERIOD_S + k) for k, f in enumerate(four())]
    series = [0.02 * w + noise(rng, w.size) for w in waves]
    assert left(series, four()) is not None
    flown = [replace(f, current_a=f.current_a + 8.0 * w) for f, w in zip(four(), waves, strict=True)]
    assert left(series, flown) is None
