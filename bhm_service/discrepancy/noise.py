"""The noise of voltage residuals: white and first-order coloured together, that is an ARMA(1,1) process.

Tests that took residuals for white raised a false alarm in every null data set of the prototype; the colour is
estimated from residuals out of which every direction that any hypothesis could explain has been removed, since what an
effect leaves unexplained is slow and would pass for colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from bhm_service.battery.dynamics import recurrence
from bhm_service.units import Array

SUDDEN = 0.2  # of the ohmic drop of a sudden change: what relaxes within a sample no lab at one hertz tells
# What a model gets wrong it gets wrong alike in all flights of a kind: they are not independent witnesses of it.
WITNESSES, MOST_DOUBT = 1.0 / 3.0, 3.0
_CLIP = 4.0  # standard deviations beyond which an innovation counts no more


def doubt_of_alike(flights: int) -> float:
    """How many times the variance of an innovation is doubted for what a model gets wrong alike in some flights."""
    return float(np.clip(WITNESSES * flights, 1.0, MOST_DOUBT))


@dataclass(frozen=True, slots=True)
class Noise:
    """r[k] - phi r[k-1] = e[k] - theta e[k-1], e of standard deviation ``sigma_v``."""

    phi: float
    theta: float
    sigma_v: float
    sudden: float = 0.0  # of the ohmic drop of a sudden change: what a model is off by beside it
    doubt: float = 1.0  # times the variance that an innovation is given beside what noise gives it

    @property
    def total_v(self) -> float:
        """Standard deviation of the process itself. [V]"""
        return float(self.sigma_v * np.sqrt(self._gain))

    @property
    def scale_v(self) -> float:
        """What an innovation of one stands for. [V]"""
        return float(self.sigma_v * np.sqrt(self.doubt))

    @property
    def _gain(self) -> float:
        return 1.0 + (self.phi - self.theta) ** 2 / (1.0 - self.phi**2)

    def beside(self, drop_v: Array) -> Array:
        """How many times its own size an innovation is doubted for sudden changes of the ohmic drop (.., T) [V]."""
        return np.asarray(np.sqrt(1.0 + (self.sudden * drop_v / self.sigma_v) ** 2))

    def averaged_v(self, width: int) -> float:
        """Standard deviation of a mean over ``width`` samples. [V]"""
        lags = np.arange(1, width)
        # Beyond the first lag the autocovariance of an ARMA(1,1) falls with phi.
        first = (1.0 - self.phi * self.theta) * (self.phi - self.theta) / (1.0 - self.phi**2)
        later = float(np.sum((1.0 - lags / width) * first * self.phi ** (lags - 1)))
        return float(self.sigma_v * np.sqrt((self._gain + 2.0 * later) / width))

    def whitened(self, residual: Array, beside: Array | float = 1.0) -> Array:
        """Innovations along the last axis, in standard deviations or ``beside`` times (.., T) those."""
        white = np.empty(residual.shape)
        # The first sample counts for what the process does on average, and the filter starts from there.
        np.divide(residual[..., :1], np.sqrt(self._gain), out=white[..., :1])
        gain = residual[..., 1:] - self.phi * residual[..., :-1]
        # `scipy.signal` does this a quarter sooner, and takes most of a second to be imported.
        white[..., 1:] = recurrence(np.full(gain.shape[-1], self.theta), gain, white[..., :1])
        white /= self.scale_v * beside
        return white


def estimated(residuals: Sequence[Array], floor_v: float) -> Noise:
    """The noise of several recordings' residuals, by the likelihood of clipped innovations; ``floor_v`` at least."""

    def innovations(numbers: Array) -> Array:
        phi, theta = _bounded(numbers)
        model = Noise(phi, theta, 1.0)
        return np.concatenate([model.whitened(r) for r in residuals])

    def cost(numbers: Array) -> float:
        e = innovations(numbers)
        sigma = _scale(e)
        clipped = np.minimum(np.abs(e) / sigma, _CLIP)
        return float(np.log(sigma) + 0.5 * np.mean(clipped**2))

    best = min(
        (
            minimize(cost, start, method="Nelder-Mead", options={"maxfev": 60, "xatol": 1e-2, "fatol": 1e-5})
            for start in (np.array([3.0, 0.0]), np.array([1.0, -1.0]), np.array([4.0, 2.5]))
        ),
        key=lambda found: float(found.fun),
    )
    phi, theta = _bounded(best.x)
    return Noise(phi, theta, max(_scale(innovations(best.x)), floor_v))


def _bounded(numbers: Array) -> tuple[float, float]:
    """Phi in (0, 0.998), theta below it: only then is the process a sum of white and coloured noise."""
    phi = 0.998 / (1.0 + np.exp(-numbers[0]))
    theta = phi / (1.0 + np.exp(-numbers[1]))
    return float(phi), float(theta)


def _scale(e: Array) -> float:
    """Standard deviation of the bulk of innovations, deaf to outliers."""
    return float(max(1.4826 * np.median(np.abs(e)), np.std(np.clip(e, *np.quantile(e, [0.02, 0.98]))), 1e-9))
