import numpy as np
import pytest
from discrepancy.test_joint import FLIGHTS, NOISE, with_members

from bhm_service.discrepancy.fitting import fit, weights
from bhm_service.discrepancy.slopes import Slopes, parted

FLOWN = with_members(FLIGHTS, {"partial-charge"})
FITTED = fit(FLOWN, NOISE, rounds=2)
FULL = np.vstack([s.full() for s in FITTED.slopes])


def test_a_flight_keeps_no_slopes_by_what_belongs_to_others():
    """So the derivatives of twice as many flights are twice as many, not four times."""
    kept = {k: sum(s.by.size for s in with_members(FLIGHTS[:k], {"partial-charge"}).linearised(
        with_members(FLIGHTS[:k], {"partial-charge"}).unknowns.start, NOISE)[1]) for k in (1, 2)}  # fmt: skip
    assert kept[2] == pytest.approx(2 * kept[1], rel=0.02)


def test_products_are_those_of_the_slopes_with_their_zeros():
    dice = np.random.default_rng(3)
    rows, steps = dice.normal(size=(FULL.shape[0], 4)), dice.normal(size=(FULL.shape[1], 4))
    np.testing.assert_allclose(FITTED.back(rows), FULL.T @ rows, atol=1e-9 * np.abs(FULL).max())
    np.testing.assert_allclose(FITTED.along(steps), FULL @ steps, atol=1e-9 * np.abs(FULL).max())
    np.testing.assert_allclose(FITTED.known_curvature, FULL.T @ FULL + FLOWN.known, rtol=1e-9, atol=1e-6)
    row = np.concatenate(FITTED.rows)
    weighted = FULL * np.sqrt(weights(row))[:, None]
    np.testing.assert_allclose(FITTED.curvature, weighted.T @ weighted + FLOWN.known, rtol=1e-9, atol=1e-6)


def test_of_the_first_residuals_only():
    slopes = Slopes(np.arange(6.0).reshape(3, 2), np.array([3, 1]), 5)
    np.testing.assert_allclose(slopes.until(2).full(), [[0, 1, 0, 0, 0], [0, 3, 0, 2, 0]])
    np.testing.assert_allclose(slopes.until(1).back(np.ones((2, 1))), [[0, 1, 0, 0, 0]] * 2)
    first, second = parted(np.arange(5.0), [slopes, slopes.until(2)])
    assert (first.size, second.size) == (3, 2)
