"""Steps in a flight's power: when a payload was let go.

Every time is tried as the end of an extra load, against the whitened residuals of a fit; what is found has to pay for
having been looked for everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bhm_service.discrepancy.demand_model import Flown
from bhm_service.discrepancy.noise import Noise
from bhm_service.units import Array

_GRID_S = 4.0  # between the times that are tried first
_NEAR_S = 10.0  # of the best of these, where every sample is tried
_EDGE_S = 20.0  # of flight that must lie before and after
_LEVEL_SD, _STEP_SD = 0.3, 0.18  # as shares of the hover's power: of the flight's own level, and of a usual payload
_LEAST = 0.01  # of the hover's power
_NATS = 10.0  # that a step has to earn beyond the price of the search


@dataclass(frozen=True, slots=True)
class Release:
    """A step down in one flight."""

    flight: int
    time_s: float
    price: float  # [nats]


def releases(misfits: Sequence[Array], flights: Sequence[Flown], noise: Noise) -> list[Release]:
    """The flights in which power steps down once and for all."""
    found = []
    for k, (misfit, data) in enumerate(zip(misfits, flights, strict=True)):
        t = data.time_s
        step = max(float(np.median(np.diff(t))), 0.1)
        # Samples, not times: in a gap of the log there is nothing to look at.
        grid = t[(t >= t[0] + _EDGE_S) & (t < t[-1] - _EDGE_S)][:: max(round(_GRID_S / step), 1)]
        if grid.size < 2:
            continue
        gains, _ = _tried(misfit, t, grid, noise)
        at = grid[int(np.argmax(gains))]
        near = t[np.abs(t - at) <= _NEAR_S]
        gains, sizes = _tried(misfit, t, near, noise)
        best = int(np.argmax(gains))
        # It is at any sample of the flight as likely beforehand, and now at some of them near the best.
        price = float(np.log(np.ptp(t) / step) - logsumexp(gains - gains[best]))
        if gains[best] - price > _NATS and sizes[best] > _LEAST:
            found.append(Release(k, float(near[best]), price))
    return found


def _tried(misfit: Array, t: Array, times: Array, noise: Noise) -> tuple[Array, Array]:
    """Evidence [nats] for an extra load until each time, the flight's own level aside, and the size of that load."""
    rows = noise.whitened(misfit)
    level = noise.whitened(np.ones(t.size)) * _LEVEL_SD
    steps = noise.whitened((t[None, :] < times[:, None]).astype(float)) * _STEP_SD
    known = 1.0 + level @ level
    score = steps @ rows - (steps @ level) * (level @ rows) / known
    information = np.sum(steps**2, axis=1) - (steps @ level) ** 2 / known
    gains = 0.5 * score**2 / (1.0 + information) - 0.5 * np.log1p(information)
    return gains, _STEP_SD * score / (1.0 + information)
