import subprocess
import sys

import numpy as np
import pytest
from battery.cells import chem, circ
from filterpy.kalman import KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from bhm_service.battery.pack import PackModel
from bhm_service.estimation.ukf import Belief, FilterDivergedError, UnscentedFilter, factor


def linear(seed=1, steps=60):
    rng = np.random.default_rng(seed)
    f = np.array([[1.0, 0.1, 0.0], [0.0, 0.95, 0.2], [0.0, -0.1, 0.9]])
    h = np.array([[1.0, 0.5, -0.2]])
    q = np.diag([1e-3, 2e-3, 5e-4])
    return f, h, q, 0.04, rng.standard_normal(steps).cumsum()


def test_on_a_linear_model_it_is_the_kalman_filter():
    f, h, q, r, measured = linear()
    exact = KalmanFilter(dim_x=3, dim_z=1)
    exact.F, exact.H, exact.Q, exact.R = f, h, q, np.array([[r]])
    exact.x, exact.P = np.zeros((3, 1)), np.eye(3)
    ours, belief = UnscentedFilter(3), Belief(np.zeros(3), np.eye(3))
    for z in measured:
        exact.predict()
        exact.update(z)
        belief = ours.predict(belief, lambda points: points @ f.T, q)
        belief = ours.update(ours.innovate(belief, lambda points: points @ h[0], float(z), r))
        np.testing.assert_allclose(belief.mean, exact.x[:, 0], atol=1e-9)
        np.testing.assert_allclose(belief.covariance, exact.P, atol=1e-9)


def theirs(n, fx, hx, mean, covariance, q, r):
    points = MerweScaledSigmaPoints(n, 1.0, 0.0, 1.0)
    ukf = UnscentedKalmanFilter(dim_x=n, dim_z=1, dt=1.0, hx=hx, fx=fx, points=points)
    ukf.x, ukf.P, ukf.Q, ukf.R = mean.copy(), covariance.copy(), q, np.array([[r]])
    return ukf


@pytest.mark.parametrize("cell", [circ(), chem()], ids=["circ", "chem"])
def test_on_the_battery_models_it_is_filterpys_own_filter(cell):
    """filterpy pushes its points one by one through the same model: mean and covariance agree to 1e-9."""
    pack = PackModel(cell, 6, 3.0)
    rng = np.random.default_rng(7)
    current = np.where(np.arange(300) % 60 < 45, 20.0, 0.5) + rng.uniform(-2.0, 2.0, 300)
    truth = pack.simulate(np.arange(300.0), current, 0.9).voltage + 0.02 * rng.standard_normal(300)
    n = pack.n_states
    mean, covariance = np.array(pack.rest(0.85)), np.diag([0.05**2] + [0.005**2] * (n - 1))
    q, r = np.diag([1e-8] + [1e-7] * (n - 1)), 0.02**2
    at = {"k": 0}

    def fx(x, dt):
        return pack.step(x, dt, current[at["k"] - 1], current[at["k"]])

    def hx(x):
        return np.array([float(pack.voltage(x, current[at["k"]]))])

    peer = theirs(n, fx, hx, mean, covariance, q, r)
    ours, belief = UnscentedFilter(n), Belief(mean, covariance)
    for k in range(1, 300):
        at["k"] = k
        peer.predict()
        peer.update(np.array([truth[k]]))
        belief = ours.predict(belief, lambda points, k=k: pack.step(points, 1.0, current[k - 1], current[k]), q)
        seen = ours.innovate(belief, lambda points, k=k: pack.voltage(points, current[k]), float(truth[k]), r)
        belief = ours.update(seen)
        np.testing.assert_allclose(belief.mean, peer.x, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, peer.P, atol=1e-9)


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1.0, 1e-18, 0.0]),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
        -np.eye(3),
        np.zeros((2, 2)),
        np.array([[1.0, 1.0], [1.0, 1.0]]) * 1e-20,
    ],
    ids=["singular", "indefinite", "negative", "zero", "tiny"],
)
def test_factor_of_a_covariance_cannot_fail(matrix):
    upper = factor(matrix)
    assert np.all(np.isfinite(upper))
    rebuilt = upper.T @ upper
    assert np.all(np.linalg.eigvalsh(rebuilt) > -1e-12)
    if np.linalg.eigvalsh(matrix)[0] >= 0.0:
        np.testing.assert_allclose(rebuilt, matrix, atol=1e-9)


def test_covariance_that_is_not_a_number_is_a_typed_failure():
    with pytest.raises(FilterDivergedError):
        factor(np.array([[np.nan, 0.0], [0.0, 1.0]]))


def test_states_that_are_held_keep_their_mean_and_variance():
    ours = UnscentedFilter(2)
    belief = Belief(np.zeros(2), np.array([[1.0, 0.6], [0.6, 1.0]]))
    seen = ours.innovate(belief, lambda points: points[:, 0], 2.0, 0.1)
    free, held = ours.update(seen), ours.update(seen, held=(1,))
    assert free.mean[1] != 0.0
    assert held.mean[1] == 0.0
    assert held.covariance[1, 1] == pytest.approx(1.0)
    assert held.covariance[0, 0] == pytest.approx(free.covariance[0, 0])
    assert np.linalg.eigvalsh(held.covariance)[0] > 0.0


def test_sigma_points_stay_inside_what_is_physical():
    ours = UnscentedFilter(1, constrain=lambda points: np.clip(points, 0.0, 1.0))
    points = ours.draw(Belief(np.array([0.99]), np.array([[0.04]])))
    assert points.min() >= 0.0
    assert points.max() <= 1.0


def test_the_filter_is_loaded_without_the_rest_of_filterpy():
    """45 MB that an onboard service has no use for."""
    code = (
        "import sys, bhm_service.estimation.tracker;"
        "assert 'scipy.stats' not in sys.modules, 'scipy.stats is loaded';"
        "import filterpy.kalman; filterpy.kalman.KalmanFilter"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
