"""What comes back with a period: found whatever its phase, and neither in noise nor where manoeuvres come back."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, four, noise, noise_model, searching

from bhm_service.discrepancy.decision import outweighed, with_the_load
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.recurring import recurring
from bhm_service.discrepancy.selection import NOTHING, Selection
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
    joint = SimpleNamespace(flights=flights, lab=LAB, whitened=lambda shapes, flight, noise: noise.whitened(shapes))
    return recurring(SimpleNamespace(joint=joint, rows=rows, noise=USUAL))


@pytest.mark.parametrize("volts", [0.03, 1.0])
def test_a_load_that_switches_by_itself_is_owned_up_to_with_its_period(volts):
    flights = [switched(f, volts, k) for k, f in enumerate(four())]
    chosen, found = outweighed(searching(flights, ["capacity-fade"]), NOTHING, LAB, flights)
    assert chosen.names == frozenset()
    assert found.period_s == pytest.approx(PERIOD_S, rel=0.03)
    assert f"every {found.period_s:.0f} s" in left_in_words(found)


def test_of_what_flights_cannot_tell_apart_a_load_past_the_sensor_comes_first_where_something_switches():
    found = searching(four("unseen-load"), ["capacity-fade", "current-gain", "unseen-load"])
    sets = [frozenset({name}) for name in ("capacity-fade", "current-gain", "unseen-load")]
    for names in sets:
        found.fitted(names)
    fade, gain, load = (Selection(n, tuple(s for s in sets if s != n), found.earned(n), {}) for n in sets)
    for chosen in (fade, gain):
        first = with_the_load(found, chosen)
        assert first.names == load.names
        assert set(first.alternatives) == set(sets) - {load.names}
        assert first.earned == found.earned(load.names)
    assert with_the_load(found, load) is load
    alone = Selection(sets[0], (sets[1],), fade.earned, {})
    assert with_the_load(found, alone) is alone


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


def test_a_load_that_pulls_the_voltage_down_may_be_heard_in_the_current():
    """At constant power a lower voltage draws more: the same current as of a manoeuvre, and far more of a voltage."""
    rng = np.random.default_rng(1)
    waves = [np.sin(2.0 * np.pi * f.time_s / PERIOD_S + k) for k, f in enumerate(four())]
    flown = [replace(f, current_a=f.current_a + 1.2 * w) for f, w in zip(four(), waves, strict=True)]
    gusts = [noise(rng, w.size) for w in waves]
    drop_v = 1.2 * LAB.ohm * LAB.series
    assert left([0.15 * drop_v * w + g for w, g in zip(waves, gusts, strict=True)], four()) is not None
    assert left([0.15 * drop_v * w + g for w, g in zip(waves, gusts, strict=True)], flown) is None
    assert left([1.5 * drop_v * w + g for w, g in zip(waves, gusts, strict=True)], flown) is not None
