"""What is driven by a course that nobody recorded: by all courses that it may have, not by the one best.

The size of such an effect multiplies numbers of every flight (how warm the pack began), and how fast a pack cools says
which of them the flights tell at all. The best fit of all of them together makes the size too large and the pack cool
too fast: so it has the same voltages by smaller numbers, many at a time, and more of them. On 83 real flights without
their temperatures the best fit has twice the activation energy that it has with them, and half the warmth. What the
flights say of the numbers that all of them share is how likely these make them over all values of the rest (MacKay,
Bayesian interpolation, Neural Computation 4, 1992): the best fit that leans by the volume which the rest is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.joint import Joint
from bhm_service.units import Places

_STEP = 0.1  # standard deviations of what was known before: of the volume's derivative
_CLOSE = 0.1  # the same: from one lean to the next
_TRIED = 8  # leans
_ROUNDS = 6  # of a fit, begun where the last one ended


def likeliest(at: Fitted) -> Fitted:
    """The fit with what drives its members, where nobody recorded that, likeliest over the numbers of each flight.

    Its joint leans that way, so that fits which begin from it stay there.
    """
    shared = _shared(at.joint)
    for _ in range(_TRIED if shared else 0):
        last, at = at, fit(replace(at.joint, lean=_lean(at, shared)), at.noise, at.x, rounds=_ROUNDS)
        moved = (at.x - last.x) / at.joint.scale
        if all(np.all(np.abs(moved[at.joint.places[name]]) < _CLOSE) for name in shared):
            break
    return at


def likelier(ends: Sequence[Fitted]) -> Fitted:
    """Of fits of one hypothesis that ended in different valleys, the one whose valley has more in it, however deep."""
    by = max(1.0, min(end.misfit for end in ends))
    return max(ends, key=lambda end: end.evidence(by))


def _shared(joint: Joint) -> list[str]:
    """What all flights share of members with a driver that nobody recorded."""
    return list(dict.fromkeys(u.name for m in joint.members if m.inferred for u in m.unknowns if not u.per_flight))


def _lean(at: Fitted, shared: list[str]) -> dict[str, float]:
    """By how much more the flights tell of all other numbers, where one of the shared is larger and these follow it."""
    joint = at.joint
    own = np.array([joint.places[name].start for name in shared])
    rest = np.setdiff1d(np.arange(at.x.size), own)
    follow = -np.linalg.solve(at.curvature[np.ix_(rest, rest)], at.curvature[np.ix_(rest, own)])
    here = _volume(at, rest)
    found = {}
    for name, k, others in zip(shared, own, follow.T, strict=True):
        step = np.zeros(at.x.size)
        step[k], step[rest] = 1.0, others
        step *= -_STEP if at.x[k] + _STEP * joint.scale[k] > joint.unknowns.high[k] else _STEP
        there = fit(joint, at.noise, at.x + joint.scale * step, rounds=0)
        found[name] = (_volume(there, rest) - here) / (joint.scale[k] * step[k])
    return found


def _volume(at: Fitted, rest: Places) -> float:
    """Half the log of how much is known of some numbers, but for a constant. [nats]"""
    return 0.5 * float(np.linalg.slogdet(at.curvature[np.ix_(rest, rest)])[1])
