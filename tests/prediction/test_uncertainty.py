import numpy as np
import pytest

from bhm_service.estimation.ukf import Belief
from bhm_service.prediction.uncertainty import Samples, SigmaPoints

MEAN = np.array([0.6, 0.01, -0.2])
COVARIANCE = np.array([[4e-4, 1e-5, 2e-4], [1e-5, 1e-6, 0.0], [2e-4, 0.0, 9e-3]])
BELIEF = Belief(MEAN, COVARIANCE)


def test_samples_have_the_beliefs_mean_and_covariance():
    states = Samples(2000, 3, seed=1).states(BELIEF)
    np.testing.assert_allclose(states.mean(axis=0), MEAN, atol=2e-3)
    np.testing.assert_allclose(np.cov(states.T), COVARIANCE, rtol=0.12, atol=2e-5)


def test_samples_are_the_same_every_time_and_others_with_another_seed():
    one, same, other = (Samples(50, 3, seed).states(BELIEF) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.allclose(one, other)


@pytest.mark.parametrize("points", [Samples(4000, 3, 1), SigmaPoints(3)], ids=["samples", "sigma points"])
def test_a_linear_outcome_has_its_closed_form_quantiles(points):
    weights, by_load = np.array([1000.0, 300.0, -50.0]), 20.0
    times = 100.0 + points.states(BELIEF) @ weights + by_load * points.load()
    outcomes = points.outcomes(times)
    mean = 100.0 + MEAN @ weights
    sd = np.sqrt(weights @ COVARIANCE @ weights + by_load**2)
    assert np.median(outcomes) == pytest.approx(mean, abs=0.05 * sd)
    assert np.quantile(outcomes, 0.95) == pytest.approx(mean + 1.645 * sd, abs=0.1 * sd)


def test_sigma_points_are_few():
    assert SigmaPoints(9).load().size == 21
