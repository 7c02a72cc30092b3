"""Flights under which everything that a lab leaves open has to be off at once: a little each, and too much together.

What no effect of the catalogue looks like, a fit of none lays on resistance, capacity, curve, relaxation and starting
charges, none of which moves far. How far all of them move is held against what was known of them before, as in a check
of a prior by its prediction [Box 1980, J. R. Stat. Soc. A 143, 383].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.odds import NATS
from bhm_service.units import Array


@dataclass(frozen=True, slots=True)
class BentLab:
    """How unlikely it is that the lab is off by so much."""

    nats: float  # minus the log of the odds, at least


def bent_lab(fitted: Fitted[Joint], lab: Lab) -> BentLab | None:
    """What the fit of no effect says of ``lab``, as it identified the pack; None where chance would do."""
    if not lab.identified:
        return None
    joint = replace(fitted.joint, lab=lab)
    found = fit(joint, fitted.noise, fitted.x)
    seen = np.linalg.eigvals(np.linalg.solve(joint.known, found.curvature - joint.known)).real.clip(min=0.0)
    nats = unlikely(float(np.sum(joint.pulls(found.x) ** 2)), seen / (1.0 + seen))
    return BentLab(nats) if nats > NATS else None


def unlikely(total: float, shares: Array) -> float:
    """Minus the log of the odds, at least, that squares of normals times ``shares`` (n,) have such a sum. [nats]

    A number of which flights tell a share, up to one, is moved by the root of that share of what was known. The bound
    is Chernoff's.
    """
    if total <= float(np.sum(shares)):
        return 0.0

    def exponent(s: float) -> float:
        return -(s * total + 0.5 * float(np.sum(np.log1p(-2.0 * s * shares))))

    most = 0.5 / float(np.max(shares))
    return float(-minimize_scalar(exponent, bounds=(0.0, most * (1.0 - 1e-9)), method="bounded").fun)
