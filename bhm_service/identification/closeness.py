"""How closely a cell model follows a sample: an error of its own, one of its drop and one of its charge.

A model's drop under load is wrong by a share of it, so pulses at many C are followed less closely than a cruise; and
where the open-circuit curve is steep, an error of charge that is nothing elsewhere is many millivolts. Taken as equally
close, both would bend every number of a cell towards what no number can follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from bhm_service.units import Array

_EXPECTED_V = 0.004  # [V] of a model's own error, to begin with
_LEAST_V = 0.001  # [V] no cell model is better than that in all that it is used for
_ROUNDS = 15


class Fitting(NamedTuple):
    """How one recording is fitted, sample by sample (T,)."""

    misfit_v: Array  # modelled minus measured [V]; NaN where nothing was measured
    drop_v: Array  # open-circuit voltage minus modelled [V]
    slope_v: Array  # of the open-circuit curve there [V per unit of charge]
    weight: Array  # in a fit, of squares; zero where it does not look


def variances(recordings: Sequence[Fitting]) -> Array:
    """Variance of the model's own error [V^2], of its drop as a share [1] and of its charge [1] (3,).

    Squared misfits are fitted by non-negative least squares, each as uncertain as its variance is large: the estimate
    of largest likelihood for normal errors of unequal variance.
    """
    measured = [np.isfinite(r.misfit_v) for r in recordings]
    squares = np.concatenate([r.misfit_v[at] ** 2 for r, at in zip(recordings, measured, strict=True)])
    parts = np.concatenate([_parts(r)[at] for r, at in zip(recordings, measured, strict=True)])
    weight = np.concatenate([r.weight[at] for r, at in zip(recordings, measured, strict=True)])
    found = np.array([_EXPECTED_V**2, 0.0, 0.0])
    for _ in range(_ROUNDS):
        scale = np.sqrt(weight) / (parts @ found)
        found = nnls(parts * scale[:, None], squares * scale)[0]
        found[0] = max(found[0], _LEAST_V**2)
    return found


def closeness(recordings: Sequence[Fitting]) -> tuple[Array, ...]:
    """Of every sample of every recording: the smallest error that is expected of any, over its own (0 to 1]."""
    found = variances(recordings)
    expected = [np.sqrt(_parts(r) @ found) for r in recordings]
    least = min(float(e.min()) for e in expected)
    return tuple(np.asarray(least / e) for e in expected)


def _parts(recording: Fitting) -> Array:
    return np.column_stack([np.ones_like(recording.drop_v), recording.drop_v**2, recording.slope_v**2])
