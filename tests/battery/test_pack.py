from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from battery.cells import CAPACITY_C, chem, circ

from bhm_service.battery.effects import ResistanceTemperature
from bhm_service.battery.effects.base import Effect
from bhm_service.battery.pack import PackModel
from bhm_service.units import GAS_CONSTANT

CELLS = [circ(), chem()]
NAMES = ["circ", "chem"]
ARRHENIUS = ResistanceTemperature(activation_energy=22e3)


@dataclass(frozen=True)
class SelfWarming(Effect):
    """A temperature of its own that feeds back on the resistance: what a later effect will do."""

    id: ClassVar[str] = "test-self-warming"
    state_names: ClassVar[tuple[str, ...]] = ("warmth",)
    feedback: ClassVar[bool] = True

    def start(self):
        return (0.0,)

    def temperature_rise(self, state):
        return state[0]

    def advance(self, solver, start, interval):
        return (solver.lag(start[0], interval.losses / 0.4, interval.losses / 0.4, 600.0),)


def recording(seed=6, length=600):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([0.5, 1.0, 10.0], length))
    current = np.where(rng.random(length) < 0.2, 0.0, rng.uniform(3.0, 30.0, length)) * 0.3
    return t, current, 275.0 + 30.0 * np.linspace(0, 1, length)


def stepped(pack, t, current, soc, temperature=None):
    states = np.array(pack.start(soc))
    at = (lambda k: None) if temperature is None else (lambda k: temperature[k])
    volts = [float(pack.voltage(states, current[0], at(0)))]
    for k in range(1, t.size):
        states = pack.step(states, t[k] - t[k - 1], current[k - 1], current[k], at(k))
        volts.append(float(pack.voltage(states, current[k], at(k))))
    return np.array(volts)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
@pytest.mark.parametrize(
    "effects",
    [(), (ARRHENIUS,), (ARRHENIUS, SelfWarming())],
    ids=["bare", "temperature", "feedback"],
)
def test_steps_and_whole_recording_agree(cell, effects):
    t, current, temperature = recording()
    pack = PackModel(cell, 6, 3.0, effects)
    whole = pack.simulate(t, current, 0.93, temperature)
    np.testing.assert_allclose(whole.voltage, stepped(pack, t, current, 0.93, temperature), rtol=1e-9)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_pack_is_its_cells_in_series_and_parallel(cell):
    t, current, _ = recording()
    one = PackModel(cell, 1).simulate(t, current, 0.9)
    many = PackModel(cell, 6, 2.5).simulate(t, 2.5 * current, 0.9)
    np.testing.assert_allclose(many.voltage, 6.0 * one.voltage, rtol=1e-12)
    np.testing.assert_allclose(many.soc, one.soc, rtol=1e-12)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_many_columns_of_parameters_go_through_one_call(cell):
    t, current, _ = recording()
    scales = np.array([0.9, 1.0, 1.3])
    pack = PackModel(cell, 6, scales[:, None])
    together = pack.simulate(t, current, np.array([[0.9], [0.8], [0.7]]))
    for row, (scale, soc) in enumerate(zip(scales, (0.9, 0.8, 0.7), strict=True)):
        alone = PackModel(cell, 6, float(scale)).simulate(t, current, soc)
        np.testing.assert_allclose(together.voltage[row], alone.voltage, rtol=1e-12)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
@pytest.mark.parametrize("effects", [(ARRHENIUS,), (ARRHENIUS, SelfWarming())], ids=["temperature", "feedback"])
def test_recordings_side_by_side_run_as_each_alone(cell, effects):
    """The second is shorter: it stands still at its end, and neither hears of the other's times."""
    ours = [recording(seed, length) for seed, length in ((6, 600), (7, 430))]
    wide = [np.stack([np.pad(r[k], (0, 600 - r[k].size), mode="edge") for r in ours]) for k in range(3)]
    scales = np.array([0.9, 1.3])[:, None, None]
    starts = np.array([[0.93], [0.8]])
    together = PackModel(cell, 6, 3.0 * scales, effects).simulate(*wide[:2], starts, wide[2])
    for row, scale in enumerate((0.9, 1.3)):
        for k, (t, current, temperature) in enumerate(ours):
            alone = PackModel(cell, 6, 3.0 * scale, effects).simulate(t, current, float(starts[k, 0]), temperature)
            np.testing.assert_allclose(together.voltage[row, k, : t.size], alone.voltage, rtol=1e-9)
    assert np.isfinite(together.voltage).all()


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_charge_is_counted(cell):
    t, current, _ = recording()
    out = np.trapezoid(current, t)
    assert 0.95 - PackModel(cell, 4).simulate(t, current, 0.95).soc[-1] == pytest.approx(out / CAPACITY_C, rel=1e-10)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_cold_pack_sags_by_the_arrhenius_factor(cell):
    """At steady state the drop under load grows by exp(Ea/R (1/T - 1/T25)); exactly so where it is ohmic."""
    effect = ResistanceTemperature(activation_energy=25e3)
    growth = np.exp(25e3 / GAS_CONSTANT * (1 / 273.15 - 1 / 298.15))
    pack = PackModel(cell, 1, 1.0, [effect])
    drops = []
    for kelvin in (298.15, 273.15):
        states = pack.step(np.array(pack.rest(0.8)), 400.0, 0.05, temperature=kelvin)
        drops.append(float(pack.open_circuit(states[0]) - pack.voltage(states, 0.05, kelvin)))
    assert drops[1] / drops[0] == pytest.approx(growth, rel=0.01)


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_at_the_reference_temperature_the_effect_does_nothing(cell):
    t, current, _ = recording()
    bare = PackModel(cell, 6).simulate(t, current, 0.9)
    warm = PackModel(cell, 6, 1.0, [ARRHENIUS]).simulate(t, current, 0.9, np.full(t.size, 298.15))
    np.testing.assert_allclose(warm.voltage, bare.voltage, rtol=1e-12)


def test_unknown_temperature_is_the_reference():
    pack = PackModel(circ(), 6, 1.0, [ResistanceTemperature(activation_energy=25e3)])
    states = np.array(pack.rest(0.8))
    assert pack.voltage(states, 10.0) == pytest.approx(pack.voltage(states, 10.0, 298.15))


@pytest.mark.parametrize("cell", CELLS, ids=NAMES)
def test_power_is_current_times_the_voltage_that_it_leaves(cell):
    pack = PackModel(cell, 6, 2.0)
    states = pack.step(np.tile(np.array(pack.rest(0.7)), (5, 1)), 20.0, 15.0)
    power = np.array([0.0, 50.0, 300.0, 900.0, -20.0])
    current, deliverable = pack.current_at_power(states, power, 10.0)
    assert np.all(deliverable)
    np.testing.assert_allclose(current * pack.voltage(states, current), power, rtol=1e-9, atol=1e-9)


def test_power_that_the_pack_cannot_deliver_is_said_to_be_so():
    pack = PackModel(circ(r_s=0.05), 6)
    states = np.array([pack.rest(0.5)])
    most = float(pack.open_circuit(0.5)) ** 2 / (4 * 6 * 0.05)
    assert bool(pack.current_at_power(states, most * 0.999, 1.0)[1][0])
    current, deliverable = pack.current_at_power(states, most * 1.001, 1.0)
    assert not deliverable[0]
    assert np.isfinite(current[0])


def test_every_hook_is_the_identity_unless_overridden():
    t, current, temperature = recording()
    bare = PackModel(circ(), 6).simulate(t, current, 0.9, temperature)
    idle = PackModel(circ(), 6, 1.0, [Effect()]).simulate(t, current, 0.9, temperature)
    np.testing.assert_array_equal(bare.voltage, idle.voltage)


def test_hooks_reach_current_charge_and_voltage():
    class Sensors(Effect):
        def true_current(self, measured):
            return 1.1 * measured + 0.5

        def initial_soc(self, soc):
            return soc - 0.1

        def extra_voltage(self, state, now):
            return -0.01 * now.current

        def measured_voltage(self, voltage):
            return 1.02 * voltage + 0.1

    t, current, _ = recording()
    plain = PackModel(circ(), 6).simulate(t, 1.1 * current + 0.5, 0.8)
    sensed = PackModel(circ(), 6, 1.0, [Sensors()]).simulate(t, current, 0.9)
    expected = 1.02 * (plain.voltage - 0.01 * (1.1 * current + 0.5)) + 0.1
    np.testing.assert_allclose(sensed.voltage, expected, rtol=1e-12)
    np.testing.assert_allclose(sensed.soc, plain.soc, rtol=1e-12)
