import numpy as np
import pytest
from battery.cells import chem
from scipy.integrate import solve_ivp

from bhm_service.battery.cell import UNMODIFIED
from bhm_service.battery.ocv import CurveRest
from bhm_service.battery.pack import PackModel
from bhm_service.battery.redlich_kister import horner, polynomial
from bhm_service.units import FARADAY, GAS_CONSTANT

T = 298.15


def printed_v_int(a, x):
    """A.22 as printed (with its misprint put right): divides by zero at x = 0.5."""
    return sum(
        a_k * ((2 * x - 1) ** (k + 1) - 2 * x * k * (1 - x) / (2 * x - 1) ** (1 - k)) for k, a_k in enumerate(a)
    ) / FARADAY  # fmt: skip


def test_redlich_kister_polynomial_is_the_printed_form_away_from_one_half():
    rng = np.random.default_rng(4)
    a = rng.uniform(-5e4, 5e4, 13)
    x = np.concatenate([np.linspace(0.02, 0.45, 40), np.linspace(0.55, 0.98, 40)])
    np.testing.assert_allclose(horner(polynomial(a), 2 * x - 1), printed_v_int(a, x), rtol=1e-12, atol=1e-12)


def test_redlich_kister_is_regular_at_one_half():
    a = [1e4, -2e4, 3e4, 4e4]
    around = horner(polynomial(a), 2 * np.array([0.5 - 1e-9, 0.5, 0.5 + 1e-9]) - 1)
    assert np.ptp(around) < 1e-8


def seven_states(cell, current_at, seconds, soc, volume=2.0e-5):
    """Appendix A with its seven states and both electrodes, integrated by scipy."""
    f, q_max = cell.surface_fraction, cell.q_max
    v_s, v_b = f * volume, (1 - f) * volume
    t_diffusion = cell.t_diffusion / volume

    def overpotential(i, x, s_k):
        j_0 = s_k * np.sqrt((1 - x) * x)
        return GAS_CONSTANT * T / (FARADAY * 0.5) * np.arcsinh(i / (2 * j_0))

    def rates(t, y):
        q_sp, q_bp, q_bn, q_sn, v_o, v_p, v_n = y
        i = current_at(t)
        d_p = (q_bp / v_b - q_sp / v_s) / t_diffusion
        d_n = (q_bn / v_b - q_sn / v_s) / t_diffusion
        x_p, x_n = q_sp / (f * q_max), q_sn / (f * q_max)
        return [
            i + d_p, -d_p, -d_n, -i + d_n,
            (i * cell.r_o - v_o) / cell.tau_o,
            (overpotential(i, x_p, cell.i_p0) - v_p) / cell.tau_p,
            (overpotential(i, x_n, cell.i_n0) - v_n) / cell.tau_n,
        ]  # fmt: skip

    x_n = 0.6 * soc
    start = [(1 - x_n) * f * q_max, (1 - x_n) * (1 - f) * q_max, x_n * (1 - f) * q_max, x_n * f * q_max, 0, 0, 0]
    t = np.arange(0.0, seconds + 1.0)
    y = solve_ivp(rates, (0.0, seconds), start, t_eval=t, rtol=1e-9, atol=1e-7, max_step=1.0).y
    x_sp, x_sn = y[0] / (f * q_max), y[3] / (f * q_max)

    def v_u(u_0, x, a):
        return u_0 + GAS_CONSTANT * T / FARADAY * np.log((1 - x) / x) + printed_v_int(a, x)

    voltage = v_u(cell.u_0, x_sp, cell.a_p) - v_u(0.0, x_sn, cell.a_n) - y[4] - y[5] - y[6]
    return t, y, voltage


def test_two_charges_are_the_papers_four():
    """The whole of Appendix A, both electrodes, seven states, independent integration: same voltage, same charges."""
    cell = chem()
    seconds = np.arange(601.0)
    current = 10.0 + 5.0 * np.sin(seconds / 40.0)
    t, y, voltage = seven_states(cell, lambda t: np.interp(t, seconds, current), 600, 0.9)
    pack = PackModel(cell, 1)
    simulated = pack.simulate(t, current, 0.9)
    np.testing.assert_allclose(simulated.voltage, voltage, atol=1e-5)
    charges = cell.charges(simulated.states)
    for row, name in enumerate(("q_sp", "q_bp", "q_bn", "q_sn")):
        np.testing.assert_allclose(charges[name], y[row], rtol=2e-6)


def test_what_the_series_leaves_of_the_curve_is_read_at_the_surface():
    t = np.arange(0.0, 2400.0)
    current = np.where((t // 300) % 2 == 0, 15.0, 1.0)
    rest = CurveRest((0.0, 0.5, 0.7, 1.0), (0.004, -0.01, 0.02, 0.0))
    run, bare = (PackModel(chem(**own), 6).simulate(t, current, 0.95) for own in ({"curve_rest": rest}, {}))
    soc, gradient = bare.states[:2]
    surface = soc - (1.0 - chem().surface_fraction) / 0.6 * gradient
    assert np.max(soc - surface) > 0.01
    np.testing.assert_allclose(run.states, bare.states, rtol=1e-12)
    added = 6 * np.interp(surface, rest.soc, rest.volts)
    np.testing.assert_allclose(run.voltage - bare.voltage, added, atol=1e-12)
    np.testing.assert_allclose(
        chem(curve_rest=rest).open_circuit(soc) - chem().open_circuit(soc),
        np.interp(soc, rest.soc, rest.volts), atol=1e-12,
    )  # fmt: skip


def test_lithium_is_conserved_whatever_the_current():
    cell = chem()
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.choice([0.1, 1.0, 30.0], 400))
    states = PackModel(cell, 1).simulate(t, rng.uniform(-3.0, 40.0, 400), 0.7).states
    total = sum(cell.charges(states).values())
    np.testing.assert_allclose(total, cell.q_max, rtol=1e-12)


def test_voltage_and_slope_stay_finite_beyond_empty_and_full():
    cell = chem()
    soc = np.linspace(-0.3, 1.6, 4000)
    volts = cell.emf((soc, 0 * soc, 0 * soc, 0 * soc, 0 * soc), UNMODIFIED)
    assert np.all(np.isfinite(volts))
    assert np.all(np.isfinite(np.gradient(volts, soc)))


@pytest.mark.parametrize("soc", [0.05, 0.3, 0.9])
def test_saturation_at_the_edges_does_not_touch_the_working_range(soc):
    cell = chem()
    x = 0.6 * soc
    plain = (
        2 * GAS_CONSTANT * T / FARADAY * np.log(x / (1 - x))
        + printed_v_int(cell.a_p, 1 - x)
        - printed_v_int(cell.a_n, x)
    )
    assert cell.open_circuit(soc) == pytest.approx(cell.u_0 + plain, abs=3e-5)
