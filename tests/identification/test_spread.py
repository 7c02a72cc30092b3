"""Uncertainty against a closed form: a cell of which only the resistance is not known is a linear fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from battery.cells import CAPACITY_C, CURVE, circ

from bhm_service.battery.pack import PackModel
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.families import Family
from bhm_service.identification.problem import problem_of
from bhm_service.identification.solve import solve
from bhm_service.identification.spread import not_told, spread
from bhm_service.identification.unknowns import numbers

NOISE_V, OHM = 0.003, 0.004
KNOWN = 1e-7  # as good as given


@dataclass(frozen=True, kw_only=True)
class Resistance(Family):
    """A cell of which ``count`` resistances in series are looked for; their sum is all that a recording shows."""

    name = "circ"
    time_constants: ClassVar[tuple[str, ...]] = ()
    count: int = 1
    first: float = OHM  # what was known of their sum before
    prior_sd: float = 1.0

    def blocks(self):
        return [numbers(f"r_{k}", np.array([self.first / self.count]), self.prior_sd, 1.0) for k in range(self.count)]

    def cell(self, values):
        total = sum(values[f"r_{k}"] for k in range(self.count))
        return circ(ocv=CURVE, c_max=self.capacity_c, r_s=total, r_sp0=1e-9, r_sp1=0.0)

    def finished(self, values):
        return self.cell(values)

    def stages(self):
        return ()


def family(**changes):
    return Resistance(capacity_c=CAPACITY_C, curve=CURVE, curve_sd=0.001, **changes)


def fitted(rng, make=family, noise=None):
    """The fit of a switched load under white noise, or under ``noise``; the load has as many rests as loads."""
    t = np.arange(0.0, 1200.0)
    current = np.where(t % 20.0 < 10.0, 10.0, 0.0)
    clean = PackModel(circ(r_s=OHM, r_sp0=1e-9, r_sp1=0.0), 1).simulate(t, current, 0.9).voltage
    volts = clean + (NOISE_V * rng.standard_normal(t.size) if noise is None else noise)
    run = Experiment(label="switched", kind=Kind.VARIABLE, time_s=t, current_a=current, voltage_v=volts)
    problem = problem_of(make(), [run], [(0.9, KNOWN)], [KNOWN])
    return solve(problem), run


def test_covariance_and_bootstrap_are_those_of_the_linear_fit():
    rng = np.random.default_rng(3)
    solution, run = fitted(rng)
    # Weighted least squares of v = ... - R i: var R = sum w^4 i^2 s^2 / (sum w^2 i^2)^2, w the fit's own weights.
    w = solution.problem.weights[0]
    i = run.current_a
    exact = NOISE_V * np.sqrt(np.sum(w**4 * i**2)) / np.sum(w**2 * i**2)
    found = spread(solution)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(exact, rel=0.2)
    assert found.bootstrap_sd[0] == pytest.approx(exact, rel=0.4)


def test_stated_spread_is_how_far_fits_scatter():
    rng = np.random.default_rng(4)
    stated, off = [], []
    for _ in range(60):
        solution, _ = fitted(rng)
        stated.append(spread(solution).sd(0))
        off.append(float(solution.x[0]) - OHM)
    assert np.std(off) == pytest.approx(np.mean(stated), rel=0.35)


def test_errors_that_last_widen_the_spread():
    rng = np.random.default_rng(5)
    white = NOISE_V * rng.standard_normal(1200)
    lasting = np.convolve(rng.standard_normal(1200 + 19), np.ones(20) / 20**0.5, mode="valid") * NOISE_V
    narrow, wide = (spread(fitted(rng, noise=noise)[0]).covariance[0, 0] for noise in (white, lasting))
    assert wide > 4.0 * narrow


@dataclass(frozen=True, kw_only=True)
class OhmAndPair(Resistance):
    """Ohmic resistance and that of a pair, which only the seconds after a step tell apart."""

    def blocks(self):
        return [numbers("r_s", np.array([0.004]), 0.02, 1.0), numbers("r_sp0", np.array([0.003]), 0.02, 1.0)]

    def cell(self, values):
        return circ(ocv=CURVE, c_max=self.capacity_c, r_s=values["r_s"], r_sp0=values["r_sp0"], r_sp1=0.0)


def test_the_bootstrap_is_not_led_by_draws_that_lack_what_tells_a_number():
    """Two steps in sixteen segments: a draw that has neither tells nothing of which resistance is which."""
    t = np.arange(1600.0)
    current = np.where((t >= 140.0) & (t < 440.0), 7.0, 4.0)
    clean = PackModel(circ(r_s=OHM, r_sp0=0.003, r_sp1=0.0), 1).simulate(t, current, 0.9).voltage
    for seed in range(12, 15):
        volts = clean + NOISE_V * np.random.default_rng(seed).standard_normal(t.size)
        run = Experiment(label="steps", kind=Kind.VARIABLE, time_s=t, current_a=current, voltage_v=volts)
        unknown = OhmAndPair(capacity_c=CAPACITY_C, curve=CURVE, curve_sd=0.001)
        found = spread(solve(problem_of(unknown, [run], [(0.9, KNOWN)], [KNOWN])))
        by_covariance = np.sqrt(np.diag(found.covariance)[:2])
        assert np.all(found.bootstrap_sd[:2] < 2.0 * by_covariance), (seed, found.bootstrap_sd, by_covariance)


def off_and_sd(solution):
    return abs(float(solution.x[0]) - OHM), spread(solution).sd(0)


def test_a_prior_pulls_no_harder_than_it_is_known_where_recordings_know_better():
    """A cell that is followed to 0.3 mV, not to the 4 mV that a fit begins with; a prior off by three of its sd."""
    rng = np.random.default_rng(9)
    solution, _ = fitted(rng, lambda: family(first=1.3 * OHM, prior_sd=0.1 * OHM), 0.0003 * rng.standard_normal(1200))
    pulled, sd = off_and_sd(solution)
    assert pulled > 3.0 * sd
    closer = solution.problem.as_followed(solution.x)
    free, sd = off_and_sd(solve(closer, starts=[solution.x]))
    assert free < 3.0 * sd


def test_that_a_slow_discharge_begins_full_keeps_its_say():
    """Nothing else tells where on the charge the curve lies: the whole of it may move along."""
    solution, run = fitted(np.random.default_rng(10), noise=0.0003 * np.random.default_rng(10).standard_normal(1200))
    for kind, keeps in ((Kind.SLOW, True), (Kind.VARIABLE, False)):
        problem = replace(solution.problem, experiments=(replace(run, kind=kind),))
        closer = problem.as_followed(solution.x)
        by = closer.weights[0][0] / problem.weights[0][0]
        assert by > 5.0
        assert closer.soc_prior[0] == pytest.approx((0.9, KNOWN / by if keeps else KNOWN))


def test_recordings_that_a_model_does_not_follow_keep_the_weight_that_they_had():
    rng = np.random.default_rng(10)
    wave = 0.02 * np.sin(np.arange(1200.0) / 60.0)
    solution, _ = fitted(rng, noise=wave + 0.0003 * rng.standard_normal(1200))
    weights, followed = solution.problem.weights[0], solution.problem.as_followed(solution.x).weights[0]
    assert np.array_equal(weights, followed)


def test_two_resistances_in_series_are_not_told_apart_and_neither_is_told():
    rng = np.random.default_rng(6)
    solution, _ = fitted(rng, make=lambda: family(count=2, prior_sd=0.01))
    found = spread(solution)
    ((one, other, correlation),) = found.alike
    assert {one, other} == {"r_0", "r_1"}
    assert correlation < -0.95
    assert not_told(found) == ["r_0", "r_1"]


def test_a_told_number_is_not_called_untold():
    assert not_told(spread(fitted(np.random.default_rng(7))[0])) == []


def test_the_seed_of_the_bootstrap_decides_its_draws_alone():
    solution, _ = fitted(np.random.default_rng(8))
    first, again = spread(solution, seed=1), spread(solution, seed=1)
    assert np.array_equal(first.bootstrap_sd, again.bootstrap_sd)
    other = spread(replace(solution), seed=2)
    assert not np.array_equal(first.bootstrap_sd, other.bootstrap_sd)
    assert np.array_equal(first.covariance, other.covariance)
