"""Fits whose cost has several valleys: of a time skew, of the charge that flights begin with, and of a large effect.

Shifted by whole samples flights look alike. And an open-circuit curve has steps: where the lab's errors make up for a
step that stands in the wrong place, every small move of the charge looks worse. So does every small part of an effect
that takes the flights over several steps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.fitting import Fitted, fit, moved, nearest
from bhm_service.discrepancy.hypothesis import STARTS
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.noise import Noise
from bhm_service.units import Array

SKEW = f"{TimeSkew.id}.skew"  # the block of that number
_LABS = "lab_skew"
_STEP_S = 0.5  # half of what autopilots log at: a valley is about as wide as a sample
# Times its usual size that an effect may have: as close together as steps of a curve are to a large one.
_TIMES = 2.0 ** np.arange(-2.0, 3.25, 0.25)
_ROUNDS = 8  # of a fit of its own numbers from there


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
    return nearest(joint, tried, noise)


def by_equation(joint: Joint, noise: Noise) -> Array:
    """A start (n,) from what was known before, the members as their equations alone come nearest to the flights."""
    return _joined(joint, joint.members, joint.unknowns.start.copy(), noise)


def across(joint: Joint, other: Fitted) -> Array:
    """A start (n,) in the valley of another hypothesis's fit, what joins that at the numbers that suit it best."""
    return _joined(joint, joint.beyond(other.joint), other.into(joint, other.joint.places), other.noise)


def _joined(joint: Joint, joining: Sequence[Candidate], x: Array, noise: Noise) -> Array:
    """A vector (n,) with what joins it at the size, and then the numbers, that suit it best, nothing else moved."""
    sizes = [u for member in joining for u in member.amplitudes()]
    tried: dict[bytes, Array] = {}
    for times in (*-_TIMES, *_TIMES) if sizes else ():
        trial = x.copy()
        for u in sizes:
            absent = u.declared.absent or 0.0
            trial[joint.places[u.name]] = absent + times * (u.usual - absent)
        trial = np.clip(trial, joint.unknowns.low, joint.unknowns.high)
        tried[trial.tobytes()] = trial
    own = [u.name for member in joining for u in member.unknowns]
    begin = nearest(joint, [*tried.values()], noise) if tried else x
    return moved(joint, noise, begin, own, _ROUNDS) if own else x
