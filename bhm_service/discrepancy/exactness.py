"""How far a member's equation is off is not known before: by what is usual (`forms`), or by hardly anything.

An equation that is right pays for every number by which it might have been off, some ten nats where its effect is seen
well, and a weak effect loses to the lab's errors by that alone. One that is wrong lives by these numbers. So either is
taken to be as likely as the other, and what counts is how likely the flights are over both: a prior of which the width
is itself uncertain (Gelman et al., Bayesian Data Analysis, chapter 5). A fit has a Gaussian for these numbers: with the
narrower prior in place of the wider that is an integral in closed form, and needs no other fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from bhm_service.units import Array, Places

EXACT = 0.25  # of what equations are usually off by: of one that is right


@dataclass(frozen=True, slots=True)
class Exactness:
    """Every way in which some members may be exact and the others not, against all of them being off as usual."""

    volumes: Array  # [nats] what the narrower priors say more, and leave less; (ways,)
    costs: Array  # half of what a fit loses by them; (ways,)

    def nats(self, inflation: float) -> float:
        """What a fit's evidence gains where either is as likely, its cost being divided by ``inflation``."""
        return float(np.logaddexp.reduce(self.volumes - self.costs / inflation) - np.log(self.volumes.size))


def exactness(curvature: Array, known: Array, found: Array, members: Sequence[Places]) -> Exactness:
    """Of a fit: its curvature and what of that was known before (n, n), and where it stands (n,), by `members`.

    All in standard deviations of what was known before; ``members`` say which numbers each of them may be off by.
    """
    own = np.concatenate([np.zeros(0, dtype=np.intp), *members])
    told = np.linalg.inv(np.linalg.inv(curvature)[np.ix_(own, own)])
    usual, at = known[np.ix_(own, own)], found[own]
    sizes = [places.size for places in members]
    ways = [_narrower(told, usual, at, np.repeat(shares, sizes)) for shares in product((1.0, EXACT), repeat=len(sizes))]
    volumes, costs = np.array(ways).T
    return Exactness(volumes, costs)


def _narrower(told: Array, usual: Array, at: Array, shares: Array) -> tuple[float, float]:
    """Of one way: what it says more and leaves less [nats], and half of what it costs."""
    narrow = usual / np.outer(shares, shares)
    now = told + narrow - usual
    left = told - told @ np.linalg.solve(now, told)
    volume = 0.5 * (_log_det(narrow) - _log_det(usual) + _log_det(told) - _log_det(now))
    return volume, 0.5 * float(at @ left @ at)


def _log_det(matrix: Array) -> float:
    return float(np.linalg.slogdet(matrix)[1])
