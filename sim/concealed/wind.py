"""Gusts with a Dryden-like spectrum at low altitude."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from sim.concealed.packs import Array


def coloured(rng: np.random.Generator, shape: tuple[int, int], dt: float, tau_s: Array) -> Array:
    """First-order coloured noise of unit variance, rows with their own time constants (F,)."""
    out = np.empty(shape)
    white = rng.standard_normal(shape)
    for row, tau in enumerate(np.broadcast_to(tau_s, shape[0])):
        keep = float(np.exp(-dt / tau))
        drive = np.sqrt(1.0 - keep * keep) * white[row]
        drive[0] = white[row, 0]
        out[row] = lfilter([1.0], [1.0, -keep], drive)
    return out


def gusts(
    rng: np.random.Generator, steps: int, dt: float, wind_mps: Array, strength: Array
) -> tuple[Array, Array, Array]:
    """Longitudinal, lateral and vertical gusts (F, steps) [m/s] about a mean wind (F,).

    Lengths 60, 30 and 20 m and an intensity that grows with the wind; MIL-F-8785C's first-order forms.
    """
    sigma = (0.35 + 0.12 * wind_mps) * strength
    past = np.maximum(wind_mps, 2.0)  # the air passes at least this fast: the vehicle moves in it too
    shape = (len(wind_mps), steps)
    along = sigma[:, None] * coloured(rng, shape, dt, 60.0 / past / 2.0)
    across = 0.8 * sigma[:, None] * coloured(rng, shape, dt, 30.0 / past / 2.0)
    up = 0.5 * sigma[:, None] * coloured(rng, shape, dt, 20.0 / past / 2.0)
    return along, across, up
