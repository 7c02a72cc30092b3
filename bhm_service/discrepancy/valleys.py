"""Fits whose cost has several valleys: of a time skew, and of the charge that flights begin with.

Shifted by whole samples flights look alike. And an open-circuit curve has steps: where the lab's errors make up for a
step that stands in the wrong place, every small move of the charge looks worse.
"""

from __future__ import annotations

import numpy as np

from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.discrepancy.fitting import Fitted, cost_of, fit
from bhm_service.discrepancy.joint import STARTS, Joint
from bhm_service.discrepancy.noise import Noise
from bhm_service.units import Array

SKEW = f"{TimeSkew.id}.skew"  # the block of that number
_LABS = "lab_skew"
_STEP_S = 0.5  # half of what autopilots log at: a valley is about as wide as a sample


def fit_over_valleys(joint: Joint, noise: Noise, start: Array, aim: float | None = None) -> Fitted:
    """The better of the fits from a start (n,) and, where there is a skew, from the deepest valley seen from there."""
    ends = [fit(joint, noise, start, aim=aim)]
    other = _deepest(joint, start, noise)
    if other is not start:
        ends.append(fit(joint, noise, other, aim=aim))
    return min(ends, key=lambda end: end.cost)


def less_charged(joint: Joint, at: Array) -> Array:
    """A vector (n,) with each flight's charge at the start lower by a standard deviation of what is known of it.

    Not higher: no charger makes a cell more than full.
    """
    x = at.copy()
    where = joint.places[STARTS]
    x[where] = np.maximum(x[where] - joint.scale[where], joint.unknowns.low[where])
    return x


def _deepest(joint: Joint, start: Array, noise: Noise) -> Array:
    """The start with the skew at which the flights are followed best, or as it is.

    What a fit without the skew made the lab's own do is taken back: in its valley the skew would only be the rest.
    """
    if SKEW not in joint.places:
        return start
    own, labs = joint.places[SKEW], joint.places[_LABS]
    low, high = float(joint.unknowns.low[own][0]), float(joint.unknowns.high[own][0])
    tried = [start]
    for skew in np.arange(low, high + 0.5 * _STEP_S, _STEP_S):
        x = start.copy()
        x[own], x[labs] = skew, 0.0
        tried.append(x)
    return min(tried, key=lambda x: cost_of(joint, x, noise))
