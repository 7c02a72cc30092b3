"""The describer of the unknown: a planted pattern is found where it is, noise and what the lab leaves open are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import base, four

from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.patterns import patterns, telling
from bhm_service.discrepancy.words import left_in_words

NOISE = Noise(0.95, 0.7, 0.008)


def flights(added=lambda data: 0.0):
    return [replace(f, voltage_v=f.voltage_v + added(f)) for f in four()]


def test_nothing_is_told_of_flights_that_the_battery_explains():
    assert telling(fit(base(flights()), NOISE)) is None


def test_a_voltage_that_drifts_with_time_is_found_with_its_size_and_unit():
    drifting = fit(base(flights(lambda f: 0.3 * np.sin(f.since_takeoff_s / 60.0))), NOISE)
    found = telling(drifting)
    assert found is not None
    assert found.kind == "voltage"
    assert "mV at" in left_in_words(found)


@pytest.mark.parametrize(("error_v", "told"), [(0.003, True), (0.010, False)])
def test_what_varies_by_less_than_the_lab_is_off_by_is_the_labs(error_v, told):
    joint = base(flights(lambda f: 0.065 * np.sin(f.since_takeoff_s / 60.0)))
    drifting = fit(replace(joint, lab=replace(joint.lab, voltage_error_v=error_v)), NOISE)
    best = patterns(drifting)[0]
    assert best.nats > 30.0
    assert 6 * 0.003 < best.varies_v < 6 * 0.010
    assert (telling(drifting) is not None) is told


def test_a_resistance_that_follows_no_driver_is_a_resistance_of_single_flights():
    odd = flights()
    odd[1] = replace(odd[1], voltage_v=odd[1].voltage_v - 0.02 * odd[1].current_a)
    found = patterns(fit(base(odd), NOISE))
    best = found[0]
    assert (best.kind, best.variable) == ("resistance", "flight")
    others = np.delete(best.heights, 1)
    assert best.heights[1] - others.mean() > 0.01
    assert abs(best.heights[1] - others.mean() - 0.02) < 4.0 * float(best.sd.max())
