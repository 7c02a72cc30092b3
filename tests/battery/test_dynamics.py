import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bhm_service.battery.dynamics import Course, Follower, Step, recurrence


@pytest.mark.parametrize("tau", [0.05, 3.0, 40.0, 5000.0])
def test_recurrence_is_the_loop_it_stands_for(tau):
    rng = np.random.default_rng(1)
    ratio = rng.uniform(0.1, 3.0, 3000) / tau
    ratio[700] = 0.0
    gain = rng.standard_normal((2, 3000))
    loop = np.empty_like(gain)
    x = np.array([1.0, -2.0])
    for k in range(gain.shape[1]):
        x = np.exp(-ratio[k]) * x + gain[:, k]
        loop[:, k] = x
    solved = recurrence(np.exp(-ratio), gain, np.array([[1.0], [-2.0]]))
    np.testing.assert_allclose(solved, loop, rtol=1e-10, atol=1e-12)


def test_recurrence_takes_a_different_decay_in_every_row():
    rng = np.random.default_rng(2)
    ratio = rng.uniform(0.0, 2.0, (3, 4000)) * np.array([[0.01], [1.0], [8.0]])
    gain = rng.standard_normal((3, 4000))
    rows = [recurrence(np.exp(-ratio[k]), gain[k], 0.5) for k in range(3)]
    np.testing.assert_allclose(recurrence(np.exp(-ratio), gain, np.full((3, 1), 0.5)), rows, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("tau", [0.5, 20.0, 1e6])
def test_lag_follows_a_ramp_as_the_differential_equation_does(tau):
    dt, begin, end, start = 7.0, 1.0, 4.0, -2.0
    truth = solve_ivp(
        lambda t, x: (begin + (end - begin) * t / dt - x) / tau, (0.0, dt), [start], rtol=1e-11, atol=1e-12,
        method="Radau",
    ).y[0, -1]  # fmt: skip
    assert Step(dt).lag(start, begin, end, tau) == pytest.approx(truth, rel=1e-8)


def test_lag_with_no_time_passed_stays_where_it_is():
    assert Step(0.0).lag(0.7, 3.0, 5.0, 10.0) == pytest.approx(0.7, abs=1e-11)


def test_course_and_steps_give_the_same_counter_and_lag():
    rng = np.random.default_rng(3)
    dt = rng.choice([0.1, 1.0, 12.0, 600.0], 500)
    rate = rng.standard_normal(501)
    tau = rng.uniform(0.3, 90.0, 500)
    course = Course(dt)
    counted = course.counter(0.25, rate[:-1], rate[1:])
    lagged = course.lag(-1.0, rate[:-1], rate[1:], tau)
    c, x = 0.25, -1.0
    for k in range(500):
        step = Step(dt[k])
        c, x = step.counter(c, rate[k], rate[k + 1]), step.lag(x, rate[k], rate[k + 1], tau[k])
        assert counted[k] == pytest.approx(c, rel=1e-9)
        assert lagged[k] == pytest.approx(x, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("tau", [0.02, 0.5, 2.0])
def test_recordings_side_by_side_decay_each_at_its_own_time(tau):
    """One has its long steps early, the other late."""
    rng = np.random.default_rng(4)
    fast, slow = np.full(400, 3.0), np.full(400, 0.01)
    ratio = np.stack([np.concatenate([fast, slow]), np.concatenate([slow, fast])]) / tau
    gain = rng.standard_normal((2, 800))
    rows = [recurrence(np.exp(-ratio[k]), gain[k], 0.5) for k in range(2)]
    np.testing.assert_allclose(recurrence(np.exp(-ratio), gain, np.full((2, 1), 0.5)), rows, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("tau", [0.01, 1.0, 10.0, 480.0])
def test_a_follower_is_the_lag_of_a_course_from_zero(tau):
    rng = np.random.default_rng(5)
    dt = rng.choice([0.0, 0.5, 1.0, 12.0], (2, 500))
    series = rng.standard_normal((3, 2, 501))
    late = Follower(dt, tau)(series)
    assert not late[..., 0].any()
    same = Course(dt).lag(np.zeros(1), series[..., :-1], series[..., 1:], np.array(tau))
    np.testing.assert_allclose(late[..., 1:], same, rtol=1e-9, atol=1e-12)
