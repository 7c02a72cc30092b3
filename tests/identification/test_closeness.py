"""Which samples a cell model is expected to follow closely, told by how it fits them."""

from __future__ import annotations

import numpy as np
import pytest
from battery.cells import CAPACITY_C, circ
from identification.known import one_c, slow, variable

from bhm_service.battery.pack import PackModel
from bhm_service.identification.closeness import Fitting, closeness, variances
from bhm_service.identification.families import CircFamily
from bhm_service.identification.premises import premises_of, problem_for

OWN_V, OF_DROP, OF_CHARGE = 0.003, 0.08, 0.006


def fitting(seed, own=OWN_V, of_drop=OF_DROP, of_charge=OF_CHARGE, count=4000):
    """A recording whose misfits have these three errors."""
    rng = np.random.default_rng(seed)
    drop, slope = rng.uniform(0.0, 0.5, count), rng.choice([0.5, 0.8, 6.0], count)
    sd = np.sqrt(own**2 + (of_drop * drop) ** 2 + (of_charge * slope) ** 2)
    return Fitting(sd * rng.standard_normal(count), drop, slope, np.full(count, 1.0 / count))


def test_each_error_is_told_from_the_others():
    found = np.sqrt(variances([fitting(1), fitting(2)]))
    assert found == pytest.approx([OWN_V, OF_DROP, OF_CHARGE], rel=0.2)


def test_samples_count_as_closely_as_they_are_followed():
    recording = fitting(3)
    (shares,) = closeness([recording])
    over = recording.misfit_v * shares
    small, large = recording.drop_v < 0.1, recording.drop_v > 0.4
    assert shares.max() == 1.0
    assert np.std(over[small]) == pytest.approx(np.std(over[large]), rel=0.15)


def test_where_a_model_is_right_all_samples_count_alike():
    for shares in closeness([fitting(4, 0.002, 0.0, 0.0), fitting(5, 0.002, 0.0, 0.0)]):
        assert shares.min() > 0.9


def test_what_is_missing_or_not_looked_at_tells_nothing():
    recording = fitting(6)
    recording.misfit_v[:500] = np.nan
    recording.misfit_v[500:1000] = 1.0
    recording.weight[500:1000] = 0.0
    assert np.sqrt(variances([recording])) == pytest.approx([OWN_V, OF_DROP, OF_CHARGE], rel=0.2)


def test_a_fit_says_where_its_drop_and_its_slope_are_and_doubts_by_shares():
    rng = np.random.default_rng(1)
    experiments = [make(PackModel(circ(), 1), rng).thinned(200) for make in (slow, one_c, variable)]
    premises = premises_of(experiments, CAPACITY_C / 3600.0)
    problem = problem_for(
        CircFamily(capacity_c=premises.capacity_c, curve=premises.curve, curve_sd=0.01), experiments, premises
    )
    x = problem.unknowns.start
    fits = problem.fitting(x)
    for fit, (misfit, soc), experiment in zip(fits, problem.misfits(x), experiments, strict=True):
        assert fit.misfit_v == pytest.approx(misfit)
        assert np.asarray(premises.curve.voltage(soc)) - fit.drop_v == pytest.approx(
            experiment.voltage_v + misfit, abs=1e-3
        )
        middle = (soc > 0.2) & (soc < 0.9)
        rise = np.asarray(premises.curve.voltage(soc + 0.005)) - np.asarray(premises.curve.voltage(soc - 0.005))
        assert fit.slope_v[middle] == pytest.approx(rise[middle] / 0.01, abs=0.02)
    halves = tuple(np.full(e.time_s.size, 0.5) for e in experiments)
    for alike, halved in zip(problem.doubting(x).weights, problem.doubting(x, halves).weights, strict=True):
        assert np.all(halved >= 0.5 * alike)  # half as close, so half as far from what is usual
        assert np.all(halved[alike > 0.0] < alike[alike > 0.0])
