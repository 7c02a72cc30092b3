"""The size of what is driven by a course that nobody recorded: by all courses that it may have, not by the one best.

Such a size multiplies numbers of every flight (how warm the pack began). The best fit of all of them together makes the
size too large: so it has the same voltages by smaller numbers, many at a time. On 83 real flights without their
temperatures the best fit has twice the activation energy that it has with them, and half the warmth. What the flights
say of the size is how likely it makes them over all values of these numbers (MacKay, Bayesian interpolation, Neural
Computation 4, 1992).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from bhm_service.discrepancy.candidate import Unknown
from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.lean import Lean

_LEAST, _CLOSE = 0.1, 0.02  # of the size in the best fit: the smallest that is tried, and how closely it is looked for
_TRIED = 12  # sizes
_ROUNDS = 12  # of a fit at a given size, begun at the best so far


def likeliest(at: Fitted) -> Fitted:
    """The fit with every such size where it is likeliest over the numbers that it multiplies.

    Its joint leans that way, so that fits which begin from it stay there.
    """
    for size in _sizes(at):
        if size.name not in at.joint.lean:
            at = _likeliest(at, size)
    return at


def _sizes(at: Fitted) -> list[Unknown]:
    """The one size of each member that has a driver which nobody recorded."""
    found = [m.amplitudes() for m in at.joint.members if m.inferred]
    return [own[0] for own in found if len(own) == 1 and not own[0].per_flight]


def _likeliest(at: Fitted, size: Unknown) -> Fitted:
    k = at.joint.places[size.name].start
    absent = float(size.declared.absent or 0.0)
    others = [block.name for block in at.joint.unknowns.blocks if block.name != size.name]
    tried = {float(at.x[k]): at}

    def unlikely(value: float) -> float:
        begin = tried[min(tried, key=lambda known: abs(known - value))].x.copy()
        begin[k] = value
        tried[value] = fit(at.joint, at.noise, begin, rounds=_ROUNDS, moving=others)
        return _unlikely(tried[value], k)

    apart = float(at.x[k]) - absent
    if apart:
        ends = sorted((absent + _LEAST * apart, absent + apart))
        options = {"xatol": _CLOSE * abs(apart), "maxiter": _TRIED}
        minimize_scalar(unlikely, bounds=ends, method="bounded", options=options)
    value = min(tried, key=lambda known: _unlikely(tried[known], k))
    # What holds it there against the best fit's pull, as the logarithm of the size would: others' fits lean alike.
    count = float(-tried[value].gradient[k] * (value - absent) / at.joint.scale[k])
    lean = {**at.joint.lean, size.name: Lean(absent, max(count, 0.0))}
    return fit(replace(at.joint, lean=lean), at.noise, tried[value].x, rounds=_ROUNDS)


def _unlikely(at: Fitted, k: int) -> float:
    """How unlikely one number makes the flights over all values of the others, but for a constant. [nats]"""
    rest = np.arange(at.x.size) != k
    return 0.5 * at.cost + 0.5 * float(np.linalg.slogdet(at.curvature[np.ix_(rest, rest)])[1])
