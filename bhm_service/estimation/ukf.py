"""An unscented Kalman filter that maps a belief to a belief and knows no battery.

Sigma points and the unscented transform are filterpy's; all points go through the model in one call. It differs from
filterpy's own filter (to 1e-9 where nothing of the following acts) in three things: the factor of the covariance
cannot fail, sigma points can be held inside what is physical, and a measurement is only used when asked to.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bhm_service.estimation.sigma_points import MerweScaledSigmaPoints, unscented_transform
from bhm_service.units import Array

# Eigenvalues of a covariance that lost definiteness are lifted to this share of the largest.
_FLOOR = 1e-12


class FilterDivergedError(Exception):
    """The belief is no longer a number."""


@dataclass(frozen=True, slots=True)
class Belief:
    """A Gaussian: mean (n,) and covariance (n, n)."""

    mean: Array
    covariance: Array


@dataclass(frozen=True, slots=True)
class Innovation:
    """What a measurement was expected to be, and how it differs."""

    prior: Belief  # the belief that expected it: that of the sigma points after they were held inside
    expected: float
    variance: float
    difference: float
    cross: Array  # (n,) covariance of the states with it

    @property
    def nis(self) -> float:
        """Squared difference over its expected variance: chi-square with one degree of freedom if all is well."""
        return self.difference * self.difference / self.variance


def factor(covariance: Array) -> Array:
    """Upper factor U with U^T U = covariance, for any finite symmetric matrix.

    Cholesky where the matrix is positive definite; else its eigenvalues are lifted off zero first.
    Raises FilterDivergedError for what is not finite.
    """
    if not math.isfinite(covariance.sum()):
        raise FilterDivergedError("covariance is not finite")
    try:
        return np.asarray(np.linalg.cholesky(covariance).T)
    except np.linalg.LinAlgError:
        pass
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    lifted = np.maximum(values, _FLOOR * max(float(values[-1]), 1e-30))
    return np.asarray(np.sqrt(lifted)[:, None] * vectors.T)


class UnscentedFilter:
    """The filter for ``n`` states.

    alpha = 1, beta = 0, kappa = 1 give every point a positive weight, so a covariance stays one; with the usual small
    alpha the centre weighs about -1e6 and rounding alone can turn it indefinite.
    """

    def __init__(
        self,
        n: int,
        *,
        alpha: float = 1.0,
        beta: float = 0.0,
        kappa: float = 1.0,
        constrain: Callable[[Array], Array] | None = None,
    ) -> None:
        self.points = MerweScaledSigmaPoints(n, alpha, beta, kappa, sqrt_method=factor)
        self._constrain = constrain

    def draw(self, belief: Belief) -> Array:
        """Sigma points (2n + 1, n) of a belief, held inside what is physical."""
        return self._drawn(belief)[0]

    def _drawn(self, belief: Belief) -> tuple[Array, bool]:
        points: Array = self.points.sigma_points(belief.mean, belief.covariance)
        if self._constrain is None:
            return points, False
        inside = self._constrain(points)
        return inside, not np.array_equal(inside, points)

    def predict(self, belief: Belief, move: Callable[[Array], Array], noise: Array) -> Belief:
        """Push a belief through ``move``, which maps all sigma points (2n + 1, n) in one call."""
        moved = move(self.draw(belief))
        mean, covariance = unscented_transform(moved, self.points.Wm, self.points.Wc, noise)
        return Belief(mean, covariance)

    def innovate(
        self, belief: Belief, measure: Callable[[Array], Array], measured: float, variance: float
    ) -> Innovation:
        """Compare a measured number with what ``measure`` makes of the sigma points, (2n + 1, n) -> (2n + 1,)."""
        points, moved = self._drawn(belief)
        if moved:
            # What was cut off is gone from the belief too: a gain from the one and a covariance from the other could
            # take out more than there is.
            belief = Belief(*unscented_transform(points, self.points.Wm, self.points.Wc))
        seen = measure(points)
        expected = float(self.points.Wm @ seen)
        spread = self.points.Wc * (seen - expected)
        total = float(spread @ (seen - expected)) + variance
        cross = spread @ (points - belief.mean)
        if not (np.isfinite(expected) and np.isfinite(total) and total > 0.0):
            raise FilterDivergedError("expected voltage is not finite")
        return Innovation(belief, expected, total, measured - expected, cross)

    @staticmethod
    def update(innovation: Innovation, held: tuple[int, ...] = ()) -> Belief:
        """Take a measurement into the belief that expected it; states in ``held`` do not move.

        Those keep their mean and variance, and their covariances stay true (Schmidt-Kalman).
        """
        belief, cross, variance = innovation.prior, innovation.cross, innovation.variance
        gain = cross / variance
        if held:
            gain[list(held)] = 0.0
            taken = np.outer(gain, cross)
            covariance = belief.covariance - taken - taken.T + variance * np.outer(gain, gain)
        else:
            covariance = belief.covariance - np.outer(gain, cross)
        return Belief(belief.mean + gain * innovation.difference, 0.5 * (covariance + covariance.T))
