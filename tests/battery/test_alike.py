"""Rows that are the same are worked out once, and come out as if each had been."""

import numpy as np
import pytest

from bhm_service.battery.alike import once
from bhm_service.battery.dynamics import Course

FOLLOWED = np.random.default_rng(3).normal(size=(4, 2, 30))


def scaled_sum(size, *series):
    return size * np.cumsum(sum(series), axis=-1)


@pytest.mark.parametrize(
    ("of", "distinct"), [([0, 1, 2], 3), ([0, 0, 0, 0], 1), ([2, 0, 2, 1, 0], 3), ([0], 1)], ids=str
)
def test_a_function_is_asked_for_the_rows_that_differ_and_gives_all_of_them(of, distinct):
    asked = []

    def function(*series):
        asked.append(np.broadcast_shapes(*map(np.shape, series))[0])
        return scaled_sum(*series)

    sizes, along = np.arange(1.0, 5.0)[of][:, None, None], FOLLOWED[:1]
    series = sizes, FOLLOWED[of], along, 0.5
    np.testing.assert_array_equal(once(function, *series), scaled_sum(*series))
    assert asked == [distinct]


def test_rows_that_end_alike_and_differ_before_are_told_apart():
    rows = np.tile(FOLLOWED[0], (6, 1, 1))
    rows[1, 0, 7] += 1e-9
    rows[4] = rows[1]
    np.testing.assert_array_equal(once(np.arcsinh, rows), np.arcsinh(rows))


def test_rows_that_differ_in_one_series_only_are_told_apart():
    alike, sizes = np.tile(FOLLOWED[0], (3, 1, 1)), np.array([1.0, 2.0, 1.0])[:, None, None]
    np.testing.assert_array_equal(once(np.multiply, sizes, alike), sizes * alike)


def test_readings_that_are_no_number_stay_none():
    rows = np.tile(FOLLOWED[0], (3, 1, 1))
    rows[:, 1, -1] = np.nan
    np.testing.assert_array_equal(once(np.arcsinh, rows), np.arcsinh(rows))


def test_a_lag_of_many_rows_is_that_of_each_to_the_last_bit():
    course, of = Course(np.full((2, 30), 1.5)), [0, 1, 0, 2, 2, 0]
    tau, start = np.array([3.0, 3.0, 40.0])[of][:, None, None], np.array([0.0, 0.2, 0.0])[of][:, None, None]
    target = FOLLOWED[:2][[0, 0, 1]][of]
    together = course.lag(start, target, 1.1 * target, tau)
    for k in range(len(of)):
        np.testing.assert_array_equal(together[k], course.lag(start[k], target[k], 1.1 * target[k], tau[k]))


def test_a_lag_whose_rows_differ_by_their_intervals_only_is_that_of_each():
    dt = np.array([1.0, 2.0, 1.0])[:, None, None] * np.ones((3, 2, 30))
    target = np.repeat(FOLLOWED[:1], 3, axis=0)
    together = Course(dt).lag(0.0, target, target, 9.0)
    for k in range(3):
        np.testing.assert_array_equal(together[k], Course(dt[k]).lag(0.0, target[k], target[k], 9.0))
