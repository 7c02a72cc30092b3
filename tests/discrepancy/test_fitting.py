"""Fits find the numbers that made the flights, and say how well."""

from __future__ import annotations

import numpy as np
import pytest
from discrepancy.flown import SIZES, base, flown, four, noise_model, with_members
from scipy.optimize import minimize

from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.parameters import parameters_of
from bhm_service.discrepancy.fitting import _boxed_step, cost_of, fit, moved
from bhm_service.discrepancy.slopes import Slopes
from bhm_service.identification.unknowns import joined, numbers

NOISE = noise_model()


def found_again(name, model, seed=0):
    """How far each number of an effect is from the truth, in the standard deviation stated for it; and the fit."""
    joint = with_members(four(name, model, seed), {name}, model)
    fitted = fit(joint, NOISE)
    declared = {p.name: p for p in parameters_of(EFFECTS[name])}
    values = joint.values(fitted.x[None, :])
    off = []
    for key, true in SIZES[name].items():
        block = f"{name}.{key}"
        found = values[block][0] * declared[key].scale
        off.append((found - np.asarray(true)) / (fitted.sd(block) * declared[key].scale))
    return np.concatenate(off), fitted


@pytest.mark.parametrize("model", ["circ", "chem"])
@pytest.mark.parametrize("name", SIZES)
def test_a_known_effect_is_found_within_what_is_stated(name, model):
    off, fitted = found_again(name, model)
    assert np.abs(off).max() < 3.0
    (member,) = fitted.joint.members
    for u in member.amplitudes():
        assert np.all(fitted.sd(u.name) < 0.6 * fitted.joint.scale[fitted.joint.places[u.name]]), "told by the flights"


@pytest.mark.parametrize("name", ["capacity-fade", "resistance-growth"])
def test_stated_standard_deviations_are_neither_small_nor_idle_over_seeds(name):
    off = np.concatenate([found_again(name, "circ", seed)[0] for seed in range(5)])
    assert np.sqrt(np.mean(off**2)) < 1.6


def test_the_noise_explains_what_a_right_hypothesis_leaves():
    right, wrong = (fit(with_members(four("capacity-fade"), names), NOISE) for names in ({"capacity-fade"}, set()))
    assert right.misfit == pytest.approx(1.0, abs=0.15)
    assert right.cost < wrong.cost
    assert right.evidence(1.0) > wrong.evidence(1.0) + 6.0


def test_a_few_wild_readings_do_not_move_the_answer():
    flights = four("capacity-fade")
    clean = fit(with_members(flights, {"capacity-fade"}), NOISE)
    rng = np.random.default_rng(8)
    for f in flights:
        f.voltage_v[rng.integers(0, f.voltage_v.size, 4)] += 0.4 * rng.choice([-1.0, 1.0], 4)
    spoilt = fit(with_members(flights, {"capacity-fade"}), NOISE)
    where = clean.joint.places["capacity-fade.fade"]
    assert abs(spoilt.x[where][0] - clean.x[where][0]) < 1.5 * clean.sd("capacity-fade.fade")[0]


@pytest.mark.parametrize("names", [{"resistance-growth", "charge-transfer"}, {"unseen-load", "contact-resistance"}])
def test_a_fit_ends_where_the_cost_is_least(names):
    """By the cost's own differences, number by number: what Newton's step would still gain is next to none."""
    truth = [EFFECTS["resistance-growth"](growth=0.6), EFFECTS["unseen-load"](current=2.0)]
    flights = [flown(truth, seed=1, number=k, rested=False) for k in range(3)]
    at = fit(with_members(flights, names), NOISE, aim=np.inf)
    low, high = at.joint.unknowns.low, at.joint.unknowns.high
    free = np.flatnonzero((at.x > low) & (at.x < high))
    step = 1e-3 * at.joint.scale
    slopes = np.zeros(at.x.size)
    for k in free:
        moved = [at.x + by * step[k] * np.eye(at.x.size)[k] for by in (-1.0, 1.0)]
        below, above = (cost_of(at.joint, x, NOISE) for x in moved)
        slopes[k] = (above - below) / 2e-3
    half = 0.5 * slopes[free]
    assert half @ np.linalg.solve(at.curvature[np.ix_(free, free)], half) < 1.0
    assert np.abs(at.x[at.joint.of_lab] / at.joint.scale[at.joint.of_lab]).max() > 1.0, "the lab's errors are at work"


def test_what_a_bound_stops_the_others_make_up_for():
    """The least of a plane's quadratic on the edge where its own least is out of reach."""
    matrix, gradient = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([-4.0, 1.0])
    reach, none = np.full(2, 1.0), np.zeros(2, dtype=bool)
    step = _boxed_step(matrix, gradient, -reach, reach, none)
    np.testing.assert_allclose(step, [1.0, -(1.0 + 1.0) / 3.0])
    np.testing.assert_allclose(_boxed_step(matrix, gradient, -9.0 * reach, 9.0 * reach, none), [2.6, -1.2])
    np.testing.assert_allclose(_boxed_step(matrix, gradient, -reach, reach, np.array([True, False])), [0.0, -1.0 / 3.0])


class Formed:
    """Residuals y - a (g + c h): what ``a`` adds has a form ``c`` that nothing shows while ``a`` is at none."""

    def __init__(self):
        self.unknowns = joined([numbers("a", np.zeros(1), 5.0, 50.0), numbers("c", np.zeros(1), 1.0, 5.0)])
        self.scale = np.array([5.0, 1.0])
        self.known = np.eye(2)
        self._plain, self._form = 0.5 * np.eye(40)[0], 5.0 * np.eye(40)[1]
        self._told = 3.0 * (self._plain + 2.0 * self._form)

    def pulls(self, x):
        return self.unknowns.pulls(x)[0]

    def leaning(self, x):
        return 0.0, np.zeros(2)

    def residuals(self, x, noise):
        return [self._told - x[0] * (self._plain + x[1] * self._form)]

    def linearised(self, x, noise):
        by = -np.column_stack([self._plain + x[1] * self._form, x[0] * self._form]) * self.scale
        return self.residuals(x, noise), [Slopes(by, np.arange(2), 2)]


def test_what_joins_at_no_effect_shows_its_form_before_a_fit_ends():
    """Its first step gains next to nothing of what there is to gain, and expected no more."""
    problem = Formed()
    found = fit(problem, NOISE, aim=0.0)
    least = minimize(lambda x: cost_of(problem, x, NOISE), [3.0, 2.0], method="Nelder-Mead", tol=1e-9)
    assert cost_of(problem, np.zeros(2), NOISE) > 20.0 * least.fun
    assert found.cost < 1.1 * least.fun


def test_blocks_that_are_not_to_move_stay():
    joint = base(four())
    fitted = fit(joint, NOISE, moving=["start_soc"])
    changed = fitted.x != joint.unknowns.start
    assert changed[joint.places["start_soc"]].any()
    changed[joint.places["start_soc"]] = False
    assert not changed.any()


def test_only_what_moves_is_found_sooner_and_the_same():
    joint = with_members(four(), {"resistance-growth"})
    names = [u.name for member in joint.members for u in member.unknowns]
    start = joint.unknowns.start
    own, all_ = moved(joint, NOISE, start, names), fit(joint, NOISE, start, moving=names).x
    assert np.any(own != start)
    np.testing.assert_allclose(own, all_, rtol=1e-9)


@pytest.mark.parametrize("name", ["capacity-fade", "resistance-growth", "unseen-load"])
def test_an_effect_that_is_not_there_fits_no_worse_and_yet_costs_evidence(name):
    flights = four()
    bare, wider = (fit(with_members(flights, names), NOISE) for names in (set(), {name}))
    assert wider.misfit < bare.misfit + 0.002
    assert wider.evidence(1.0) < bare.evidence(1.0) - 1.0
