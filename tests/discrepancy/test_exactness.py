"""Equations are as likely exact as off by what is usual: how likely measurements are over both."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from discrepancy.flown import flown, four, searching
from scipy.stats import multivariate_normal

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.exactness import EXACT, exactness


@pytest.mark.parametrize("inflation", [1.0, 2.0])
@pytest.mark.parametrize("sizes", [[], [3], [2, 4]])
def test_of_gaussians_it_is_how_likely_measurements_are_over_every_way(sizes, inflation):
    """Against scipy's own density of the measurements, everything else integrated out."""
    rng = np.random.default_rng(4)
    others, samples = 2, 12
    count = others + sum(sizes)
    design = rng.normal(size=(samples, count))
    tied = rng.normal(size=(count, count))
    tied[:others, others:] = 0.0
    before = np.eye(count) + tied.T @ tied / count
    before[:others, others:] = before[others:, :others] = 0.0
    measured = 3.0 * rng.normal(size=samples)
    ends = others + np.cumsum([0, *sizes])
    members = [np.arange(low, high) for low, high in pairwise(ends)]

    def nats(shares):
        by = np.concatenate([np.ones(others), np.repeat(shares, sizes)])
        spread = np.linalg.inv(before / np.outer(by, by))
        return multivariate_normal(np.zeros(samples), design @ spread @ design.T + np.eye(samples)).logpdf(measured)

    curvature = before + design.T @ design
    found = np.linalg.solve(curvature, design.T @ measured)
    told = exactness(curvature, before, found, members)
    ways = np.array([nats(shares) for shares in product((1.0, EXACT), repeat=len(sizes))])
    if inflation == 1.0:
        assert told.nats(1.0) == pytest.approx(
            np.logaddexp.reduce(ways) - np.log(ways.size) - nats(np.ones(len(sizes)))
        )
    np.testing.assert_allclose(told.volumes - told.costs, ways - ways[0], atol=1e-9)
    expected = np.logaddexp.reduce(told.volumes - told.costs / inflation) - np.log(ways.size)
    assert told.nats(inflation) == pytest.approx(expected)


@pytest.mark.parametrize(("right", "mimic"), [("resistance-growth", "slow-diffusion"), ("unseen-load", "current-gain")])
def test_a_right_equation_gains_by_it_and_a_mimic_that_lives_by_its_form_does_not(right, mimic):
    found = searching(four(right, seed=3), (right, mimic))

    def gain(name):
        at = found.fitted(frozenset({name}))
        return exactness(at.curvature, at.joint.known, at.joint.unknowns.pulls(at.x)[0], at.joint.forms)

    assert gain(right).nats(1.0) > 3.0
    assert gain(mimic).nats(1.0) < 0.0
    for name in (right, mimic):
        at = found.fitted(frozenset({name}))
        as_usual = -0.5 * at.cost - 0.5 * np.linalg.slogdet(np.linalg.solve(at.joint.known, at.curvature))[1]
        assert at.evidence(1.0) == pytest.approx(as_usual + gain(name).nats(1.0))


def test_an_offset_of_a_voltage_sensor_does_not_bend_until_it_is_a_load_past_the_current_sensor():
    """It is the same at any load and at once: what an equation of a cell may be off by under a load it may not."""
    flights = [flown([EFFECTS["unseen-load"](current=1.5)], number=k) for k in range(4)]
    found = searching(flights, ("unseen-load", "voltage-offset"))
    sets = [frozenset(names) for names in ((), ("unseen-load",), ("voltage-offset",))]
    for names in sets:
        found.fitted(names)
    _, right, mimic = (found.evidence(names) for names in sets)
    assert right - mimic > 60.0
