"""Samples of what is not known: the pack's state and the load ahead.

The draws are made once, from a seed, and reused at every prediction: the spread of two predictions a second apart is
then that of the belief, and the numbers on the ground do not flicker with the dice.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from bhm_service.estimation.ukf import Belief, factor
from bhm_service.units import Array

_NORMAL = NormalDist()


class Draws:
    """``count`` standard-normal draws in ``dimensions``, stratified in each (Latin hypercube)."""

    def __init__(self, count: int, dimensions: int, seed: int) -> None:
        generator = np.random.default_rng(seed)
        strata = np.argsort(generator.random((dimensions, count)), axis=1)
        quantiles = np.array([_NORMAL.inv_cdf((k + 0.5) / count) for k in range(count)])
        self._normal: Array = quantiles[strata].T

    def states(self, belief: Belief) -> Array:
        """Samples (count, n) of a belief."""
        n = belief.mean.size
        samples: Array = belief.mean + self._normal[:, :n] @ factor(belief.covariance)
        return samples

    def last(self) -> Array:
        """The last dimension (count,), for the load."""
        return self._normal[:, -1]
