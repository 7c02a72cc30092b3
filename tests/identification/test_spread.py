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
    prior_sd: float = 1.0

    def blocks(self):
        return [numbers(f"r_{k}", np.array([OHM / self.count]), self.prior_sd, 1.0) for k in range(self.count)]

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
    w = solution.problem.weights()[0]
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
