"""Power that changes with the time in the air, flown alike: ice on blades, motors that warm, what nobody thought of.

No effect of the catalogue does that by itself, so what of it is left beside an explanation is owned up to. A course
over the time that is straight between knots, the same in all flights, is added to a fit; its evidence is taken by one
linear step, which is exact but for the bounds. On flights that the explanation suffices for a course earns ``n`` nats
with a probability below exp(-n): their odds average one there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bhm_service.discrepancy.demand_model import Demand
from bhm_service.discrepancy.demand_search import FLOOR
from bhm_service.discrepancy.first_order import geometry_of
from bhm_service.discrepancy.fitting import Fitted, fit, one_step
from bhm_service.discrepancy.lab import hats
from bhm_service.discrepancy.noise import estimated
from bhm_service.discrepancy.odds import NATS
from bhm_service.units import Array

_KNOTS = 4  # of equally many samples between them
_SD = 0.01  # of the hover's power: what a course is expected to be off by
_LEAST = 0.005  # of the hover's power, RMS: as for what has a name


def drifting(fitted: Fitted[Demand]) -> float | None:
    """By how much of the hover's power a flight takes more at the end of the longest than after take-off.

    None where the flights do not say so with the evidence that a named effect needs.
    """
    since = [f.time_s - f.time_s[0] for f in fitted.joint.flights]
    knots = np.unique(np.quantile(np.concatenate(since), np.linspace(0.0, 1.0, _KNOTS)))
    shapes = [_SD * hats(knots, s) for s in since]
    # A course left in the residuals would pass for their colour, so the noise is taken without any.
    left = [m - m @ np.linalg.pinv(s) @ s for m, s in zip(fitted.joint.misfits(fitted.x), shapes, strict=True)]
    noise = replace(estimated(left, FLOOR), doubt=fitted.noise.doubt)
    heights, nats = _added(fit(fitted.joint, noise, fitted.x), shapes)
    course = np.concatenate([heights @ s for s in shapes])
    if nats < NATS or float(np.std(course)) < _LEAST:
        return None
    return float(_SD * (heights[-1] - heights[0]))


def _added(fitted: Fitted[Demand], shapes: list[Array]) -> tuple[Array, float]:
    """Sizes and evidence [nats] of shapes (shapes, T of each flight) with a prior of one."""
    # A residual is what was measured less what was modelled: what is added to the model is taken off it.
    slopes = np.concatenate([-fitted.noise.whitened(s) for s in shapes], axis=1).T
    found, score = geometry_of(fitted, slopes)
    return one_step(found.information, score)
