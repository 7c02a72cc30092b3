from dataclasses import replace

import numpy as np
import pytest
from battery.cells import CAPACITY_C, chem, circ

from bhm_service.battery.effects import (
    CapacityFade,
    CurrentGain,
    Hysteresis,
    RateCapacity,
    ResistanceTemperature,
    SelfHeating,
    UnseenLoad,
    VoltageGain,
    WeakCell,
)
from bhm_service.battery.ocv import MonotoneSpline
from bhm_service.battery.pack import PackModel
from bhm_service.messages import Ending
from bhm_service.prediction.end_of_discharge import ENDINGS, Limits, end_of_discharge

CELLS = [circ(), chem()]
NAMES = ["circ", "chem"]
LIMITS = Limits(threshold_soc=0.2, cutoff_v=6 * 3.3)


def second_by_second(pack, states, power, limits, temperature=None, dt=1.0):
    """Algorithm 1 as printed, the event interpolated within its second."""
    count = states.shape[0]
    ended, elapsed = np.full(count, np.inf), 0.0
    soc_before, volts_before = states[:, 0], None
    while np.isinf(ended).any():
        current, deliverable = pack.current_at_power(states, power, 1.0, temperature)
        volts = power / current - pack.below_average(states, current, temperature)
        soc = states[:, 0]
        share = np.ones(count)
        if volts_before is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                by_soc = (soc_before - limits.threshold_soc) / (soc_before - soc)
                by_volts = (volts_before - limits.cutoff_v) / (volts_before - volts)
            share = np.where(soc <= limits.threshold_soc, by_soc, np.where(volts <= limits.cutoff_v, by_volts, 1.0))
        over = (soc <= limits.threshold_soc) | (volts <= limits.cutoff_v) | ~deliverable
        new = over & np.isinf(ended)
        ended[new] = (elapsed - dt * (1.0 - share))[new]
        soc_before, volts_before = soc, volts
        states = pack.step(states, dt, current, temperature=temperature)
        elapsed += dt
    return np.maximum(ended, 0.0)


def spread(pack, count=20, seed=9):
    rng = np.random.default_rng(seed)
    states = np.tile(np.array(pack.rest(0.9)), (count, 1))
    states[:, 0] = rng.uniform(0.3, 0.98, count)
    return states, rng.uniform(400.0, 1400.0, count)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
@pytest.mark.parametrize("kelvin", [None, 268.0])
def test_it_agrees_with_steps_of_one_second_to_half_a_second(cell, kelvin):
    pack = PackModel(cell, 6, 3.0, [ResistanceTemperature(activation_energy=22e3)])
    states, power = spread(pack)
    times, _ = end_of_discharge(pack, states, power, LIMITS, kelvin)
    np.testing.assert_allclose(times, second_by_second(pack, states, power, LIMITS, kelvin), atol=0.5)


JOINED = [
    [UnseenLoad(current=2.5)],
    [CurrentGain(gain=0.1), VoltageGain(gain=-0.01)],
    [RateCapacity(exponent=1.06)],
    [WeakCell(loss=0.15, resistance=0.3)],
    [Hysteresis(amplitude=0.02, begin=-1.0)],
    [ResistanceTemperature(activation_energy=22e3), SelfHeating(heat_capacity=2e3, conductance=4.0, ambient=278.0)],
]


@pytest.mark.parametrize("effects", JOINED, ids=lambda effects: effects[-1].id)
def test_it_agrees_with_steps_of_one_second_whatever_has_joined_the_pack(effects):
    pack = PackModel(circ(), 6, 3.0, effects)
    states = np.tile(np.array(pack.rest(0.9), dtype=float), (8, 1))
    power = np.linspace(600.0, 1400.0, 8)
    times, _ = end_of_discharge(pack, states, power, LIMITS)
    np.testing.assert_allclose(times, second_by_second(pack, states, power, LIMITS), atol=0.5)


def test_the_weakest_cell_ends_the_flight():
    """Beside it the same cells apart: five as they are, one of less capacity, under the one current that all share."""
    loss, limits = 0.22, Limits(threshold_soc=0.05, cutoff_v=6 * 3.3)
    pack = PackModel(circ(), 6, 3.0, [WeakCell(loss=loss)])
    others = PackModel(circ(), 5, 3.0)
    weak = PackModel(replace(circ(), c_max=CAPACITY_C * (1.0 - loss)), 1, 3.0)
    powers = np.array([400.0, 700.0])
    ends = []
    for power in powers:
        strong_state, weak_state = np.array(others.rest(0.9)), np.array(weak.rest(0.9))
        current, elapsed = power / 24.0, 0.0
        while True:
            volts = float(others.voltage(strong_state, current)), float(weak.voltage(weak_state, current))
            if volts[1] < limits.cutoff_v / 6 or strong_state[0] < limits.threshold_soc:
                break
            current = power / sum(volts)
            strong_state, weak_state = others.step(strong_state, 1.0, current), weak.step(weak_state, 1.0, current)
            elapsed += 1.0
        ends.append(elapsed)
    times, endings = end_of_discharge(pack, np.tile(np.array(pack.rest(0.9), dtype=float), (2, 1)), powers, limits)
    as_one, _ = end_of_discharge(
        PackModel(circ(), 6, 3.0), np.tile(np.array(others.rest(0.9), dtype=float), (2, 1)), powers, limits
    )
    assert [ENDINGS[k] for k in endings] == [Ending.VOLTAGE] * 2
    np.testing.assert_allclose(times, ends, rtol=0.03)
    assert np.all(times < 0.95 * as_one)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_it_agrees_when_the_voltage_ends_the_flight(cell):
    pack = PackModel(cell, 6, 3.0)
    states, power = spread(pack, seed=10)
    power = 0.6 * power
    limits = Limits(threshold_soc=0.02, cutoff_v=6 * 3.45)
    times, endings = end_of_discharge(pack, states, power, limits)
    assert (np.array(ENDINGS)[endings] == Ending.VOLTAGE).sum() > 10
    np.testing.assert_allclose(times, second_by_second(pack, states, power, limits, dt=0.5), atol=0.5)


def test_at_a_voltage_that_does_not_move_it_is_charge_over_current():
    flat = circ(ocv=MonotoneSpline((0.0, 1.0), (3.7999, 3.8001)), r_s=1e-5, r_sp0=1e-9, r_sp1=0.0)
    pack = PackModel(flat, 6, 2.0)
    states = np.tile(np.array(pack.rest(0.8)), (3, 1))
    power = np.array([100.0, 200.0, 400.0])
    times, endings = end_of_discharge(pack, states, power, LIMITS)
    np.testing.assert_allclose(times, 0.6 * 2.0 * CAPACITY_C * 6 * 3.8 / power, rtol=1e-3)
    assert set(endings) == {0}


def test_a_pack_below_a_limit_has_no_time_left():
    pack = PackModel(circ(), 6, 3.0)
    empty, sagging = np.array([pack.rest(0.1)]), np.array([pack.rest(0.3)])
    assert end_of_discharge(pack, empty, np.array([200.0]), LIMITS)[0][0] == 0.0
    high = Limits(threshold_soc=0.2, cutoff_v=6 * 3.9)
    times, endings = end_of_discharge(pack, sagging, np.array([200.0]), high)
    assert times[0] == 0.0
    assert ENDINGS[endings[0]] is Ending.VOLTAGE


def test_power_that_cannot_be_delivered_ends_the_flight():
    pack = PackModel(circ(r_s=0.08), 6)
    times, endings = end_of_discharge(pack, np.array([pack.rest(0.9)]), np.array([900.0]), LIMITS)
    assert times[0] == 0.0
    assert ENDINGS[endings[0]] is Ending.POWER


@pytest.mark.parametrize("power", [0.0, 1e-9, 0.05])
def test_without_a_load_the_prediction_returns(power):
    pack = PackModel(circ(), 6, 3.0)
    times, endings = end_of_discharge(pack, np.array([pack.rest(0.9)]), np.array([power]), LIMITS)
    assert times[0] == 86400.0
    assert ENDINGS[endings[0]] is Ending.HORIZON


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_states_from_nowhere_do_not_hang_it(cell):
    pack = PackModel(cell, 6, 3.0)
    states = np.tile(np.array(pack.rest(0.9)), (4, 1))
    states[0, 0], states[1, 0], states[2, 1], states[3, 1] = 1.5, -0.5, 0.4, -0.4
    times, _ = end_of_discharge(pack, states, np.full(4, 250.0), LIMITS)
    assert np.all(np.isfinite(times))
    assert np.all(times >= 0.0)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_more_power_and_less_charge_never_last_longer(cell):
    pack = PackModel(cell, 6, 3.0)
    states = np.tile(np.array(pack.rest(0.9)), (30, 1))
    by_power = end_of_discharge(pack, states, np.linspace(50.0, 900.0, 30), LIMITS)[0]
    assert np.all(np.diff(by_power) < 0.0)
    states[:, 0] = np.linspace(0.25, 1.0, 30)
    by_charge = end_of_discharge(pack, states, np.full(30, 250.0), LIMITS)[0]
    assert np.all(np.diff(by_charge) > 0.0)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_a_pack_that_has_lost_electrode_area_ends_when_a_smaller_one_does(cell):
    worn = PackModel(cell, 6, 1.0, [CapacityFade(fade=0.3, area=1.0), WeakCell(loss=0.1, resistance=0.2)])
    small = PackModel(cell, 6, 0.7, [WeakCell(loss=0.1, resistance=0.2)])
    states, power = spread(worn)
    for own, other in zip(
        end_of_discharge(worn, states, power, LIMITS), end_of_discharge(small, states, power, LIMITS), strict=True
    ):
        np.testing.assert_allclose(own, other, rtol=1e-9)
