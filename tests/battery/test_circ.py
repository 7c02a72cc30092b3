import numpy as np
import pytest
from battery.cells import CAPACITY_C, CUBIC, circ
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from bhm_service.battery.cell import UNMODIFIED, Modifiers
from bhm_service.battery.dynamics import Step
from bhm_service.battery.ocv import monotone_cubic
from bhm_service.battery.pack import PackModel


def paper_voltage(q_b, q_sp, current, cell):
    """Table 3, written out with the charges of the paper."""
    ocv = cell.ocv
    soc = 1.0 - (ocv.q_max - q_b) / ocv.c_max
    cbp3 = ocv.q_max / ocv.v_0 - (ocv.cbp0 + ocv.cbp1 + ocv.cbp2)
    c_b = ocv.cbp0 * soc**3 + ocv.cbp1 * soc**2 + ocv.cbp2 * soc + cbp3
    return q_b / c_b - q_sp / cell.c_sp - current * cell.r_s


def test_full_rested_cell_has_v_0():
    assert CUBIC.voltage(1.0) == pytest.approx(4.2, rel=1e-12)


def test_a_discharge_is_that_of_the_papers_equations():
    cell = circ(ocv=CUBIC)
    current = 12.0
    q_b0 = CUBIC.q_max - 0.1 * CAPACITY_C

    def rates(t, q):
        soc = 1.0 - (CUBIC.q_max - q[0]) / CAPACITY_C
        r_sp = cell.r_sp0 + cell.r_sp1 * np.exp(cell.r_sp2 * (1.0 - soc))
        return [-current, current - (q[1] / cell.c_sp) / r_sp]

    t = np.arange(0.0, 1000.0, 1.0)
    truth = solve_ivp(rates, (0.0, 999.0), [q_b0, 0.0], t_eval=t, rtol=1e-10, atol=1e-8).y
    simulated = PackModel(cell, 1).simulate(t, np.full_like(t, current), 0.9)
    np.testing.assert_allclose(simulated.voltage, paper_voltage(truth[0], truth[1], current, cell), atol=2e-6)
    np.testing.assert_allclose(simulated.soc, 1.0 - (CUBIC.q_max - truth[0]) / CAPACITY_C, atol=1e-12)


def test_exact_step_is_the_printed_one_when_current_and_resistance_are_held():
    cell = circ(r_sp1=0.0)
    r_sp, dt, current, v_sp = 0.003, 37.0, 15.0, 0.011
    pack = PackModel(cell, 1)
    moved = pack.step(np.array([0.6, v_sp]), dt, current)
    a = np.exp(-dt / (cell.c_sp * r_sp))
    q_sp = a * v_sp * cell.c_sp + (1.0 - a) * cell.c_sp * r_sp * current
    assert moved[0] == pytest.approx(0.6 - current * dt / CAPACITY_C, rel=1e-13)
    assert moved[1] == pytest.approx(q_sp / cell.c_sp, rel=1e-12)


def test_spline_rises_everywhere_and_meets_its_knots():
    soc = np.linspace(-0.1, 1.1, 5000)
    curve = circ().ocv
    assert np.all(np.diff(curve.voltage(soc)) > 0.0)
    np.testing.assert_allclose(curve.voltage(np.array(curve.soc)), curve.volts, atol=5e-5)


@pytest.mark.parametrize("knots", [2, 3, 12])
def test_spline_is_scipys_monotone_cubic(knots):
    rng = np.random.default_rng(16)
    x, y = np.cumsum(rng.uniform(0.01, 0.2, knots)), np.cumsum(rng.uniform(0.001, 0.5, knots))
    at = np.linspace(x[0], x[-1], 500)
    np.testing.assert_allclose(monotone_cubic(x, y, at), PchipInterpolator(x, y)(at), rtol=1e-12)


def test_curve_that_falls_is_refused():
    with pytest.raises(ValueError, match="rise"):
        type(circ().ocv)((0.0, 0.5, 1.0), (3.5, 3.4, 4.2))


def test_effects_scale_what_they_say():
    cell = circ()
    assert cell.series_resistance(Modifiers(resistance=2.0)) == pytest.approx(0.008)
    r_sp = cell.surface_resistance(0.5, UNMODIFIED)
    assert cell.surface_resistance(0.5, Modifiers(kinetics=0.5, diffusion=0.5)) == pytest.approx(2.0 * r_sp)


def test_faded_capacity_empties_faster():
    cell = circ()
    whole = cell.advance(Step(100.0), (0.8, 0.0), 10.0, 10.0, UNMODIFIED)[0]
    faded = cell.advance(Step(100.0), (0.8, 0.0), 10.0, 10.0, Modifiers(capacity=0.8))[0]
    assert (0.8 - faded) == pytest.approx((0.8 - whole) / 0.8)
