"""Each effect against a closed form, or against something that does not know of effects."""

import numpy as np
import pytest
from battery.cells import CAPACITY_C, CURVE, chem, circ
from scipy.integrate import solve_ivp

from bhm_service.battery import effects as fx
from bhm_service.battery.effects.graphite_lag import graphite_v
from bhm_service.battery.pack import PackModel
from bhm_service.units import FARADAY, GAS_CONSTANT

N = 6
T = np.arange(0.0, 901.0)
STEADY = np.full(T.size, 10.0)
RNG = np.random.default_rng(5)
GUSTY = 10.0 + 3.0 * RNG.standard_normal(T.size)
BOTH = pytest.mark.parametrize("cell", [circ(), chem()], ids=["circ", "chem"])
OHMIC = circ(r_sp0=1e-12, r_sp1=0.0)  # nothing but a resistance behind the curve


def run(cell, *effects, current=GUSTY, soc=0.95, kelvin=None):
    temperature = None if kelvin is None else np.full(T.size, kelvin)
    return PackModel(cell, N, 1.0, effects).simulate(T, current, soc, temperature)


def difference(cell, effect, **kw):
    return run(cell, effect, **kw).voltage - run(cell, **kw).voltage


# ---- heat -----------------------------------------------------------------------------------------------------------


def test_self_heating_is_the_solution_of_its_heat_balance():
    """Ohmic losses that fall as the pack warms, by scipy's integrator."""
    arrhenius = fx.ResistanceTemperature(activation_energy=25e3)
    warm = fx.SelfHeating(heat_capacity=300.0, conductance=0.3, ambient=272.0, start_above=6.0)

    def rate(_, kelvin):
        ohm = N * 0.004 * np.exp(25e3 / GAS_CONSTANT * (1 / kelvin - 1 / 298.15))
        return (10.0**2 * ohm - 0.3 * (kelvin - 272.0)) / 300.0

    truth = solve_ivp(rate, (0.0, 900.0), [278.0], t_eval=T, rtol=1e-10, atol=1e-10).y[0]
    found = run(OHMIC, arrhenius, warm, current=STEADY).temperature
    assert np.ptp(truth) > 2.0
    np.testing.assert_allclose(found, truth, atol=2e-3)


@BOTH
def test_settled_temperature_carries_all_losses_to_the_air(cell):
    warm = fx.SelfHeating(heat_capacity=5.0, conductance=2.0, ambient=290.0)
    pack = PackModel(cell, N, 1.0, [warm])
    out = pack.simulate(T, STEADY, 0.95)
    losses = 10.0 * (pack.open_circuit(out.soc) - out.voltage)
    np.testing.assert_allclose(out.temperature[-300:] - 290.0, losses[-300:] / 2.0, rtol=0.01)


def test_measured_temperature_goes_before_the_state():
    arrhenius = fx.ResistanceTemperature(activation_energy=25e3)
    warm = fx.SelfHeating(heat_capacity=300.0, conductance=0.8, ambient=272.0)
    measured = run(circ(), arrhenius, kelvin=285.0).voltage
    np.testing.assert_allclose(run(circ(), arrhenius, warm, kelvin=285.0).voltage, measured, rtol=1e-12)
    assert np.max(np.abs(run(circ(), arrhenius, warm).voltage - measured)) > 0.05


def test_core_rises_above_the_sensor_by_losses_times_resistance():
    lag = fx.CoreLag(thermal_resistance=0.5, time_constant=200.0)
    arrhenius = fx.ResistanceTemperature(activation_energy=20e3)
    out = run(OHMIC, lag, current=STEADY, kelvin=290.0)
    rise = 0.5 * 10.0**2 * N * 0.004 * (1 - np.exp(-T / 200.0))
    np.testing.assert_allclose(out.states[-1], rise, rtol=1e-6, atol=1e-9)
    inside = run(OHMIC, lag, arrhenius, current=STEADY, kelvin=290.0)
    core = 290.0 + inside.states[2]
    ohm = N * 0.004 * np.exp(20e3 / GAS_CONSTANT * (1 / core - 1 / 298.15))
    np.testing.assert_allclose(inside.voltage, N * CURVE.voltage(inside.soc) - 10.0 * ohm, atol=1e-7)


def test_resistance_near_full_charge_falls_by_e_with_every_width_and_heats_the_cells():
    near_full = fx.FullChargeResistance(resistance=0.003, width=0.05)
    aged = fx.ResistanceGrowth(growth=0.4, age=1.0)
    soc = run(OHMIC, soc=1.0).soc
    closed = -GUSTY * N * 0.003 * np.exp((soc - 1.0) / 0.05)
    np.testing.assert_allclose(difference(OHMIC, near_full, soc=1.0), closed, atol=1e-9)
    both = run(OHMIC, near_full, aged, soc=1.0).voltage - run(OHMIC, aged, soc=1.0).voltage
    np.testing.assert_allclose(both, 1.4 * closed, atol=1e-9)
    out = run(OHMIC, near_full, fx.SelfHeating(heat_capacity=5.0, conductance=2.0, ambient=290.0), current=STEADY)
    losses = 10.0 * (N * CURVE.voltage(out.soc) - out.voltage)
    np.testing.assert_allclose(out.temperature[-300:] - 290.0, losses[-300:] / 2.0, rtol=0.01)


def test_charge_transfer_behind_the_double_layer_follows_butler_volmer_with_a_lag():
    layer = fx.DoubleLayer(exchange_current=3.0, time_constant=5.0)
    settled = 2.0 * GAS_CONSTANT * 298.15 / FARADAY * np.arcsinh(10.0 / 6.0)
    closed = -N * settled * (1.0 - np.exp(-T / 5.0))
    np.testing.assert_allclose(difference(OHMIC, layer, current=STEADY), closed, atol=1e-7)
    worn = fx.ResistanceGrowth(growth=1.0, age=1.0)  # half as fast
    slower = fx.DoubleLayer(exchange_current=1.5, time_constant=5.0)
    added = run(OHMIC, layer, worn, current=STEADY).voltage - run(OHMIC, worn, current=STEADY).voltage
    np.testing.assert_allclose(added, difference(OHMIC, slower, current=STEADY), atol=1e-7)
    out = run(OHMIC, layer, fx.SelfHeating(heat_capacity=5.0, conductance=2.0, ambient=290.0), current=STEADY)
    losses = 10.0 * (N * CURVE.voltage(out.soc) - out.voltage)
    np.testing.assert_allclose(out.temperature[-300:] - 290.0, losses[-300:] / 2.0, rtol=0.01)


def diffused(rate, tau, shells=400):
    """Of the charge of a sphere, what its surface lags behind its mean, by finite volumes; ``rate`` (T,) [1/s].

    Flux leaves its surface so that its mean falls by ``rate``; ``tau`` is of its slowest mode, R^2 / D = 20.19 tau, at
    every moment (T,) where it changes.
    """
    at = np.broadcast_to(tau, T.shape)
    tau = float(at[0])
    slower = at / tau
    edges = np.linspace(0.0, 1.0, shells + 1)
    volumes, middle = np.diff(edges**3) / 3.0, 0.5 * (edges[1:] + edges[:-1])
    exchange = edges[1:-1] ** 2 / np.diff(middle) / (4.493409458**2 * tau)
    moved = np.zeros((shells, shells))
    for k, flow in enumerate(exchange):
        moved[k, k : k + 2] += np.array([-flow, flow]) / volumes[k]
        moved[k + 1, k : k + 2] += np.array([flow, -flow]) / volumes[k + 1]
    out = np.zeros(shells)
    out[-1] = -1.0 / (3.0 * volumes[-1])

    def jacobian(t, held):
        return moved / np.interp(t, T, slower)

    def slope(t, held):
        return jacobian(t, held) @ held + out * np.interp(t, T, rate)

    known = {"method": "BDF", "jac": jacobian, "max_step": 5.0, "rtol": 1e-7, "atol": 1e-10}
    found = solve_ivp(slope, (T[0], T[-1]), np.zeros(shells), t_eval=T, **known)
    # The gradient at the surface is what leaves there.
    surface = found.y[-1] - rate / 3.0 * (4.493409458**2 * at) * (1.0 - middle[-1])
    return 3.0 * volumes @ found.y - surface


def test_charge_lags_at_the_surface_as_diffusion_in_a_sphere_has_it():
    current = np.where((T // 200) % 2 == 0, 15.0, 4.0)
    lag = fx.SurfaceLag(time_constant=70.0, share=0.6)
    out = run(OHMIC, lag, current=current)
    found = np.sum(out.states[-3:], axis=0)
    truth = 0.6 * diffused(current / CAPACITY_C, 70.0)
    assert np.max(truth) > 0.03
    step = np.abs(T % 200 - 2.0) > 12.0  # all modes but two are one: they differ for seconds after a step
    np.testing.assert_allclose(found[step], truth[step], atol=0.02 * np.max(truth))
    closed = N * (CURVE.voltage(out.soc - found) - CURVE.voltage(out.soc))
    np.testing.assert_allclose(out.voltage - run(OHMIC, current=current).voltage, closed, atol=1e-9)
    two = run(OHMIC, lag, fx.SurfaceLag(time_constant=300.0, share=0.2), current=current)
    of_both = N * (CURVE.voltage(out.soc - np.sum(two.states[-6:], axis=0)) - CURVE.voltage(out.soc))
    np.testing.assert_allclose(two.voltage - run(OHMIC, current=current).voltage, of_both, atol=1e-9)
    bend = fx.OcvShape(at_60=0.03, at_70=-0.02)
    read = N * np.interp(out.soc - found, bend.knots, [0.0] * 6 + [0.03, -0.02] + [0.0] * 3)
    np.testing.assert_allclose(run(OHMIC, lag, bend, current=current).voltage - out.voltage, read, atol=1e-9)


def test_slower_diffusion_makes_the_lag_at_the_surface_larger_and_later_and_its_losses_heat_the_cells():
    lag, longer = fx.SurfaceLag(time_constant=70.0, share=0.6), fx.SurfaceLag(time_constant=140.0, share=0.6)
    slower = fx.SlowDiffusion(resistance=0.0, time_constant=100.0, slowing=2.0)
    both = run(OHMIC, lag, slower).voltage - run(OHMIC, slower).voltage
    np.testing.assert_allclose(both, difference(OHMIC, longer), atol=1e-9)
    out = run(OHMIC, lag, fx.SelfHeating(heat_capacity=5.0, conductance=2.0, ambient=290.0), current=STEADY)
    losses = 10.0 * (N * CURVE.voltage(out.soc) - out.voltage)
    np.testing.assert_allclose(out.temperature[-300:] - 290.0, losses[-300:] / 2.0, rtol=0.01)


def test_lithium_lags_at_the_surface_of_graphite_the_more_the_fuller_it_is():
    current = np.where((T // 200) % 2 == 0, 15.0, 4.0)
    numbers = {"steepness": 4.0, "share": 0.7, "empty": 0.05, "full": 0.8}
    out = run(OHMIC, fx.GraphiteLag(time_constant=40.0, **numbers), current=current)
    lithium = 0.05 + 0.75 * out.soc
    lag = np.sum(out.states[-3:], axis=0)
    truth = 0.7 * diffused(0.75 * current / CAPACITY_C, 40.0 * np.exp(4.0 * (lithium - 0.5)))
    assert np.max(truth) > 0.03
    step = np.abs(T % 200 - 2.0) > 40.0
    np.testing.assert_allclose(lag[step], truth[step], atol=0.02 * np.max(truth))
    dropped = N * (graphite_v(lithium - lag) - graphite_v(lithium))
    np.testing.assert_allclose(run(OHMIC, current=current).voltage - out.voltage, dropped, atol=1e-5)
    # As Doyle and Newman's curve is in PyBaMM's set of Marquis (2019).
    np.testing.assert_allclose(graphite_v(np.array([0.02, 0.2, 0.9])), [0.4526830, 0.2431244, 0.1303149], atol=1e-6)
    slower = fx.SlowDiffusion(resistance=0.0, time_constant=100.0, slowing=2.0)
    twice = run(OHMIC, fx.GraphiteLag(time_constant=80.0, **numbers), current=current)
    both = run(OHMIC, fx.GraphiteLag(time_constant=40.0, **numbers), slower, current=current)
    np.testing.assert_allclose(both.states[-2], twice.states[-1], atol=1e-12)
    warm = fx.SelfHeating(heat_capacity=5.0, conductance=2.0, ambient=290.0)
    heated = run(OHMIC, fx.GraphiteLag(time_constant=4.0, **numbers), warm, current=STEADY)
    losses = 10.0 * (N * CURVE.voltage(heated.soc) - heated.voltage)
    np.testing.assert_allclose(heated.temperature[-300:] - 290.0, losses[-300:] / 2.0, rtol=0.01)


@BOTH
def test_the_order_in_which_effects_join_does_not_matter(cell):
    joined = [
        fx.ResistanceTemperature(activation_energy=24e3),
        fx.SelfHeating(heat_capacity=400.0, conductance=1.0, ambient=275.0),
        fx.CoreLag(thermal_resistance=0.5),
        fx.CapacityFade(fade=0.1),
    ]
    np.testing.assert_allclose(run(cell, *joined).voltage, run(cell, *joined[::-1]).voltage, rtol=1e-9)


@BOTH
def test_strong_feedback_still_settles_to_what_steps_give(cell):
    """A cold small pack under a load that heats it by tens of kelvin."""
    joined = [
        fx.ResistanceTemperature(activation_energy=35e3),
        fx.SelfHeating(heat_capacity=120.0, conductance=0.3, ambient=263.0),
        fx.CoreLag(thermal_resistance=2.0),
    ]
    pack = PackModel(cell, N, 1.0, joined)
    whole = pack.simulate(T, STEADY, 0.95)
    states = np.array(pack.start(0.95))
    for _ in T[1:]:
        states = pack.step(states, 1.0, 10.0, 10.0)
    assert whole.states[-2][-1] > 15.0
    np.testing.assert_allclose([s[-1] for s in whole.states], states, rtol=1e-8, atol=1e-9)


@BOTH
def test_a_step_of_differences_begins_where_it_differs_from_and_says_the_same(cell):
    """The derivative by the air's temperature, from a run of its own and from one that starts beside the other."""

    def cold(ambient):
        heating = fx.SelfHeating(heat_capacity=400.0, conductance=1.0, ambient=ambient)
        return PackModel(cell, N, 1.0, [fx.ResistanceTemperature(activation_energy=24e3), heating])

    step = 0.01
    here, there = (cold(275.0 + by).simulate(T, STEADY, 0.95) for by in (0.0, step))
    beside = cold(275.0 + step).simulate(T, STEADY, 0.95, near=here.swept)
    slopes = [(run.voltage - here.voltage) / step for run in (there, beside)]
    np.testing.assert_allclose(slopes[1], slopes[0], atol=2e-3 * np.abs(slopes[0]).max())
    assert np.abs(slopes[0]).max() > 0.005


@BOTH
def test_less_is_left_of_a_warmth_that_takes_away_from_its_own_heat(cell):
    """Of the air's temperature all is left, of a warmth alone exp(-dt hA / C); a warmer cell has a lower resistance."""
    heating = fx.SelfHeating(heat_capacity=200.0, conductance=2.0, ambient=268.0)
    run = PackModel(cell, N, 1.0, [fx.ResistanceTemperature(activation_energy=30e3), heating]).simulate(T, STEADY, 0.95)
    of_ambient, of_warmth = run.swept.following
    assert (of_ambient == 1.0).all()
    fed = np.exp(-2.0 / 200.0) - of_warmth[T.size // 3 : T.size // 2]
    assert 1e-3 < fed.min() < fed.max() < 5e-3  # 60 W that change by 3 % a kelvin, over 200 J/K


def test_entropy_moves_the_resting_voltage_and_heats():
    entropy = fx.EntropicVoltage(slope=-0.3e-3)
    rest = np.zeros(T.size)
    np.testing.assert_allclose(difference(circ(), entropy, current=rest, kelvin=278.15), N * 0.3e-3 * 20.0, rtol=1e-9)
    tilted = fx.EntropicVoltage(slope=-0.1e-3, tilt=0.5e-3)
    for soc, by_kelvin in ((1.0, 0.15e-3), (0.5, -0.1e-3), (0.1, -0.3e-3)):
        moved = difference(circ(), tilted, current=rest, kelvin=278.15, soc=soc)
        np.testing.assert_allclose(moved, -N * by_kelvin * 20.0, rtol=1e-9)
    warm = fx.SelfHeating(heat_capacity=5.0, conductance=2.0, ambient=290.0)
    hot = run(OHMIC, entropy, warm, current=STEADY).temperature[-1]
    assert 2.0 * (hot - 290.0) == pytest.approx(10.0**2 * N * 0.004 + 10.0 * N * 0.3e-3 * hot, rel=1e-6)


# ---- charge and age -------------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize(
    ("effect", "kelvin", "capacity"),
    [
        (fx.CapacityFade(fade=0.12), None, 0.88),
        (fx.CapacityFade(fade=0.06, age=2.0), None, 0.88),
        (fx.ColdCapacity(per_kelvin=0.006), 278.15, 0.88),
        (fx.ColdCapacity(per_kelvin=0.006), 308.15, 1.0),
        (fx.RateCapacity(exponent=1.05), None, 2.0**-0.05),
    ],
    ids=["fade", "older", "cold", "warm", "rate"],
)
def test_capacity_is_what_charge_falls_by(cell, effect, kelvin, capacity):
    used = run(cell, effect, current=STEADY, kelvin=kelvin).soc  # 2C
    np.testing.assert_allclose(0.95 - used, 10.0 * T / (capacity * CAPACITY_C), rtol=1e-10, atol=1e-13)


def test_grown_resistance_is_ohmic_and_of_charge_transfer():
    grown = run(circ(), fx.ResistanceGrowth(growth=0.5, age=0.6))
    by_hand = run(circ(r_s=0.004 * 1.3, r_sp0=0.003 * np.sqrt(1.3), r_sp1=1e-5 * np.sqrt(1.3)))
    np.testing.assert_allclose(grown.voltage, by_hand.voltage, rtol=1e-12)
    grown = run(chem(), fx.ResistanceGrowth(growth=0.3))
    by_hand = run(chem(r_o=0.004 * 1.3, i_p0=20.0 / 1.3, i_n0=60.0 / 1.3))
    np.testing.assert_allclose(grown.voltage, by_hand.voltage, rtol=1e-12)


@BOTH
def test_a_start_below_the_assumed_charge_is_that_start(cell):
    there = run(cell, soc=0.87).voltage
    np.testing.assert_allclose(run(cell, fx.PartialCharge(deficit=0.08)).voltage, there, rtol=1e-12)
    stored = fx.SelfDischarge(rate=0.004 / 86400.0, storage=20 * 86400.0)
    np.testing.assert_allclose(run(cell, stored).voltage, there, rtol=1e-12)


@pytest.mark.parametrize("others", [(), (fx.SurfaceLag(time_constant=70.0, share=0.6),)], ids=["bulk", "surface"])
def test_a_weak_cell_is_one_cell_of_smaller_capacity_and_more_resistance(others):
    """Five good cells and a weak one, each simulated on its own."""
    plain = {"r_sp1": 0.0}
    good = PackModel(circ(**plain), 1, effects=others).simulate(T, GUSTY, 0.95)
    cell = circ(**plain, c_max=0.8 * CAPACITY_C, r_s=0.004 * 1.4)
    weak = PackModel(cell, 1, effects=others).simulate(T, GUSTY, 0.95)
    pack = run(circ(**plain), fx.WeakCell(loss=0.2, resistance=0.4), *others)
    np.testing.assert_allclose(pack.voltage, 5 * good.voltage + weak.voltage, rtol=1e-10)


# ---- voltage --------------------------------------------------------------------------------------------------------


@BOTH
def test_slow_diffusion_builds_up_as_one_exponential(cell):
    slow = fx.SlowDiffusion(resistance=0.002, time_constant=250.0)
    expected = -N * 0.002 * 10.0 * (1 - np.exp(-T / 250.0))
    np.testing.assert_allclose(difference(cell, slow, current=STEADY), expected, rtol=1e-9, atol=1e-12)


def test_slower_diffusion_of_chem_is_a_longer_diffusion_time():
    slow = run(chem(), fx.SlowDiffusion(resistance=0.0, time_constant=300.0, slowing=1.7))
    np.testing.assert_allclose(slow.voltage, run(chem(t_diffusion=140.0 * 1.7)).voltage, rtol=1e-12)


def test_charge_transfer_bends_the_drop_around_the_hover():
    effect = fx.ChargeTransfer(bend=2.5, straight=1.0)
    i_0 = 5.0 / 2.5
    np.testing.assert_allclose(difference(circ(), effect, current=STEADY), 0.0, atol=1e-12)  # 2C
    for amps in (1.0, 5.0, 25.0):
        scale = 2 * GAS_CONSTANT * 298.15 / FARADAY
        bent, chord = np.arcsinh(amps / (2 * i_0)), np.arcsinh(10.0 / (2 * i_0)) * amps / 10.0
        found = difference(circ(), effect, current=np.full(T.size, amps), soc=0.9)
        np.testing.assert_allclose(found, N * scale * (chord - bent), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("speed", [0.2, 0.7, 1.5])
def test_the_other_electrode_transfers_charge_at_another_speed_as_well(speed):
    """A cell whose ohmic drop at 2C, 10 A, is for a share of 0.6 that of an electrode's Butler-Volmer equation."""
    scale = 2 * GAS_CONSTANT * 298.15 / FARADAY
    i_u = 10.0 / (2 * np.sinh(0.6 * 0.004 * 10.0 / scale))
    layer = fx.DoubleLayer(exchange_current=3.0, time_constant=1e-2)
    slower = fx.ChargeTransfer(speed=speed, other=0.6)
    for amps in (1.0, 10.0, 25.0):
        steady = np.full(T.size, amps)
        in_lab = np.arcsinh(amps / (2 * 3.0)) + np.arcsinh(amps / (2 * i_u))
        now = np.arcsinh(amps / (2 * speed * 3.0)) + np.arcsinh(amps / (2 * speed * i_u))
        alone = run(circ(), layer, current=steady, soc=0.9).voltage
        found = run(circ(), layer, slower, current=steady, soc=0.9).voltage - alone
        np.testing.assert_allclose(found[50:], N * scale * (in_lab - now), rtol=1e-7)


@pytest.mark.parametrize("speed", [0.2, 0.7, 1.5])
def test_another_speed_of_charge_transfer_is_another_exchange_current_than_that_of_the_lab(speed):
    """Between the lab's kinetics and others the chord drops out."""
    lab, now = (fx.ChargeTransfer(bend=2.5, straight=0.6, speed=s) for s in (1.0, speed))
    rate = GUSTY / (CAPACITY_C / 3600.0)
    scale = N * 2 * GAS_CONSTANT * 298.15 / FARADAY
    more = scale * (np.arcsinh(1.25 * rate / speed) - np.arcsinh(1.25 * rate))
    np.testing.assert_allclose(difference(circ(), lab) - difference(circ(), now), more, rtol=1e-9, atol=1e-12)


@BOTH
def test_another_speed_of_charge_transfer_is_another_exchange_current_of_the_double_layer_and_nothing_else(cell):
    """What a lab told from the rest of the drop is all that changes."""
    layer, faster = (fx.DoubleLayer(exchange_current=i, time_constant=0.8) for i in (3.0, 4.5))
    changed = run(cell, layer, fx.ChargeTransfer(speed=1.5)).voltage
    np.testing.assert_allclose(changed, run(cell, faster).voltage, rtol=1e-12)


@BOTH
def test_hysteresis_changes_branch_with_charge_not_with_time(cell):
    effect = fx.Hysteresis(amplitude=0.02, reach=0.05, begin=-1.0)
    current = np.where((T > 100) & (T < 400), 0.0, 8.0)
    used = np.concatenate([[0.0], np.cumsum(0.5 * (current[1:] + current[:-1]))])
    branch = 1.0 - 2.0 * np.exp(-used / (0.05 * CAPACITY_C))
    np.testing.assert_allclose(difference(cell, effect, current=current), -N * 0.02 * branch, rtol=1e-8, atol=1e-10)


@BOTH
def test_sensors_read_straight_lines(cell):
    plain, more = run(cell).voltage, run(cell, current=GUSTY + 1.5).voltage
    np.testing.assert_allclose(run(cell, fx.UnseenLoad(current=1.5)).voltage, more, rtol=1e-12)
    np.testing.assert_allclose(run(cell, fx.CurrentOffset(offset=1.5)).voltage, more, rtol=1e-12)
    scaled = run(cell, current=1.05 * GUSTY).voltage
    np.testing.assert_allclose(run(cell, fx.CurrentGain(gain=0.05)).voltage, scaled, rtol=1e-12)
    np.testing.assert_allclose(run(cell, fx.VoltageGain(gain=-0.01)).voltage, 0.99 * plain, rtol=1e-12)
    np.testing.assert_allclose(run(cell, fx.VoltageOffset(offset=0.12)).voltage, plain + 0.12, rtol=1e-12)


@BOTH
def test_contacts_drop_in_proportion_to_the_current_and_only_while_bad(cell):
    lasting = difference(cell, fx.ContactResistance(resistance=0.006))
    np.testing.assert_allclose(lasting, -0.006 * GUSTY, rtol=1e-8)
    episode = difference(cell, fx.IntermittentContact(resistance=0.006, begin=200.0, end=260.0))
    bad = (T > 200) & (T < 260)
    np.testing.assert_allclose(episode, np.where(bad, -0.006 * GUSTY, 0.0), rtol=1e-8, atol=1e-11)
    unknown = difference(cell, fx.IntermittentContact(resistance=0.006))
    np.testing.assert_array_equal(unknown, 0.0)


@pytest.mark.parametrize("skew", [-0.3, 0.3])
def test_skewed_voltage_has_the_drop_of_another_moment(skew):
    def load(at):
        return 10.0 + 5.0 * np.sin(2 * np.pi * at / 40.0)

    shifted = -N * 0.004 * (load(T + skew) - load(T))
    found = difference(OHMIC, fx.TimeSkew(skew=skew), current=load(T))
    largest = np.max(np.abs(shifted))
    np.testing.assert_allclose(found[60:], shifted[60:], atol=0.2 * largest)


@BOTH
def test_bent_curves_are_straight_between_their_knots(cell):
    millivolts = [-8.0, 5.0, 12.0, 4.0, -9.0, -3.0, 7.0, 2.0, -5.0, 1.0, 6.0]
    names = [f"at_{k}" for k in range(0, 101, 10)]
    effect = fx.OcvShape(**{n: 1e-3 * v for n, v in zip(names, millivolts, strict=True)})
    soc = run(cell, soc=0.7).soc
    bend = 1e-3 * N * np.interp(soc, effect.knots, millivolts)
    np.testing.assert_allclose(difference(cell, effect, soc=0.7), bend, rtol=1e-8, atol=1e-12)


def test_resistance_follows_its_shape_over_charge():
    effect = fx.ResistanceShape(at_5=0.8, at_25=0.2, at_55=-0.1, at_90=0.1)
    soc = run(circ(), soc=0.6).soc
    shape = np.interp(soc, effect.knots, [0.8, 0.2, -0.1, 0.1])
    np.testing.assert_allclose(difference(circ(), effect, soc=0.6), -N * 0.004 * shape * GUSTY, rtol=1e-8, atol=1e-11)


@BOTH
def test_a_pack_that_has_lost_electrode_area_is_one_of_fewer_cells_side_by_side(cell):
    """Its wires and what warms it stay as they are, and so does the effect of a worn cell in it."""
    others = [
        fx.ResistanceTemperature(activation_energy=25e3),
        fx.SelfHeating(heat_capacity=300.0, conductance=0.3, ambient=272.0),
        fx.ContactResistance(resistance=0.01),
        fx.WeakCell(loss=0.1, resistance=0.2),
        fx.SlowDiffusion(resistance=2e-3, time_constant=200.0),
    ]
    worn = run(cell, fx.CapacityFade(fade=0.2, area=1.0), *others)
    small = PackModel(cell, N, 0.8, others).simulate(T, GUSTY, 0.95)
    np.testing.assert_allclose(worn.voltage, small.voltage, atol=1e-6)
    np.testing.assert_allclose(worn.soc, small.soc, atol=1e-9)
    np.testing.assert_allclose(worn.temperature, small.temperature, atol=1e-6)


@BOTH
@pytest.mark.parametrize("area", [0.0, 0.4, 1.0])
def test_a_share_of_a_lost_capacity_takes_area_with_it(cell, area):
    """Charge falls as with any loss; with all of it area, the cell is as if a larger current went through it."""
    worn = run(cell, fx.CapacityFade(fade=0.2, area=area))
    np.testing.assert_allclose(worn.soc, run(cell, current=GUSTY / 0.8).soc, atol=1e-9)
    lithium = (1.0 - 0.2) / (1.0 - 0.2 * area)
    other = run(cell, fx.CapacityFade(fade=1.0 - lithium), current=GUSTY / (1.0 - 0.2 * area))
    np.testing.assert_allclose(worn.voltage, other.voltage, atol=1e-9)
