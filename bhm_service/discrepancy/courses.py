"""The course of every flight by the battery as it is and by an explanation, with the states that no log tells."""

from __future__ import annotations

import numpy as np

from bhm_service.discrepancy.explanation import Course
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.joint import Joint
from bhm_service.units import Array

_DRAWS = 24  # of the posterior, for the band of a hidden state
_SEED = 1


def courses_of(base: Joint, fitted: Fitted) -> list[Course]:
    """Every flight by the battery as it is and by the explanation; hidden states with their spread."""
    joint = fitted.joint
    draws = _draws(fitted)
    inferred = any("temperature" in kind.supplies for c in joint.members for _, kind in c.parts)
    level_sd = max((u.level_sd for member in joint.members for u in member.unknowns), default=0.0)
    found = []
    everywhere = zip(joint.flights, base.expected_v, joint.all_predicted(fitted.x[None, :]), strict=True)
    for k, (data, before, after) in enumerate(everywhere):
        states: dict[str, tuple[Array, Array]] = {}
        if inferred:
            rows = joint.temperature(draws, k)
            states["temperature"] = (rows[0], np.hypot(rows[1:].std(axis=0), level_sd))
        found.append(Course(data, before, after.voltage[0], after.soc, states))
    return found


def _draws(fitted: Fitted) -> Array:
    """The fit and draws of its posterior, inside the bounds; (1 + draws, n)."""
    rng = np.random.default_rng(_SEED)
    spread = rng.multivariate_normal(np.zeros(fitted.x.size), fitted.covariance, size=_DRAWS, method="eigh")
    unknowns = fitted.joint.unknowns
    return np.vstack([fitted.x, np.clip(fitted.x + spread, unknowns.low, unknowns.high)])
