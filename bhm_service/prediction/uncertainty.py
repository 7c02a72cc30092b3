"""What is not known ahead, as points: the pack's state and the load, over samples or over sigma points.

Samples are drawn once, from a seed, and reused at every prediction: the spread of two predictions a second apart is
then that of the belief, and the numbers on the ground do not flicker with the dice. Sigma points need no dice and are
fewer (2n + 3 for n states and a load), but give no more than a Gaussian's quantiles.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import Protocol

import numpy as np

from bhm_service.estimation.sigma_points import MerweScaledSigmaPoints
from bhm_service.estimation.ukf import Belief, factor
from bhm_service.units import Array

_NORMAL = NormalDist()


class Points(Protocol):
    """Points of a belief and of a load, and what the times that they last amount to."""

    def states(self, belief: Belief) -> Array:
        """States (M, n)."""
        ...

    def load(self) -> Array:
        """Deviations of the load (M,), in its standard deviations."""
        ...

    def outcomes(self, times: Array) -> Array:
        """Equally likely times, rising, from those (M,) that the points last. [s]"""
        ...


class Samples:
    """``count`` standard-normal draws for ``n`` states and a load, stratified in each (Latin hypercube)."""

    def __init__(self, count: int, n: int, seed: int) -> None:
        generator = np.random.default_rng(seed)
        strata = np.argsort(generator.random((n + 1, count)), axis=1)
        quantiles = np.array([_NORMAL.inv_cdf((k + 0.5) / count) for k in range(count)])
        self._normal: Array = quantiles[strata].T

    def states(self, belief: Belief) -> Array:
        samples: Array = belief.mean + self._normal[:, :-1] @ factor(belief.covariance)
        return samples

    def load(self) -> Array:
        return self._normal[:, -1]

    def outcomes(self, times: Array) -> Array:
        return np.sort(times)


class SigmaPoints:
    """The sigma points of a belief over ``n`` states, the load as one state more."""

    def __init__(self, n: int, outcomes: int = 100) -> None:
        self._points = MerweScaledSigmaPoints(n + 1, 1.0, 0.0, 1.0, sqrt_method=factor)
        unit: Array = self._points.sigma_points(np.zeros(n + 1), np.eye(n + 1))
        self._normal = unit
        self._quantiles = np.array([_NORMAL.inv_cdf((k + 0.5) / outcomes) for k in range(outcomes)])

    def states(self, belief: Belief) -> Array:
        points: Array = belief.mean + self._normal[:, :-1] @ factor(belief.covariance)
        return points

    def load(self) -> Array:
        return self._normal[:, -1]

    def outcomes(self, times: Array) -> Array:
        mean = float(self._points.Wm @ times)
        variance = float(self._points.Wc @ (times - mean) ** 2)
        outcomes: Array = np.maximum(mean + self._quantiles * np.sqrt(max(variance, 0.0)), 0.0)
        return outcomes
