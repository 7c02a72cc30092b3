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
from scipy.signal import lfilter
from scipy.special import chdtri

from bhm_service.units import Array

SUDDEN = 0.2  # of the ohmic drop of a sudden change: what relaxes within a sample no lab at one hertz tells
# What a model gets wrong it gets wrong alike in all flights of a kind: they are not independent witnesses of it.
WITNESSES, MOST_DOUBT = 1.0 / 3.0, 3.0
LASTING_DOUBT = 8.0  # times a variance: what a model leaves lasts longer than any colour that its noise is given
CELL_FLOOR_V = 0.002  # [V]: no cell's voltage is measured and modelled closer
MOST_PHI = 0.998  # of noise: what lasts longer than minutes is none
_CLIP = 4.0  # standard deviations beyond which an innovation counts no more
_RARELY = 0.01


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

    @classmethod
    def at_first(cls, series: int) -> Noise:
        """What residuals of so many cells in ``series`` are held for before they are known: slow for the most part."""
        return cls(0.98, 0.8, series * CELL_FLOOR_V)

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
        return float(self.sigma_v * np.sqrt(self._averaged(width, 1)[0]))

    def worst_averaged_v(self, width: int, samples: Sequence[int]) -> float:
        """RMS of running means over ``width`` samples that one of some runs exceeds once in a hundred times. [V]

        Of a run of so many ``samples``: its mean square is a gamma variable [Box 1954, Ann. Math. Stat. 25, 290].
        """
        most = max(samples)
        alike = self._averaged(width, most)
        alike = (alike / alike[0]) ** 2
        freedom = np.array([n / (1.0 + 2.0 * float(np.sum(alike[1:n]))) for n in samples])
        times = chdtri(freedom, _RARELY / len(samples)) / freedom
        return self.averaged_v(width) * float(np.sqrt(times.max()))

    def _averaged(self, width: int, lags: int) -> Array:
        """Autocovariance of means over ``width`` samples at the first ``lags``, over the innovations' variance."""
        # Beyond the first lag the autocovariance of an ARMA(1,1) falls with phi.
        first = (1.0 - self.phi * self.theta) * (self.phi - self.theta) / (1.0 - self.phi**2)
        apart = np.abs(np.arange(1 - width, lags + width - 1))
        single = np.where(apart == 0, self._gain, first * self.phi ** np.maximum(apart - 1, 0))
        return np.asarray(np.convolve(single, (width - np.abs(np.arange(1 - width, width))) / width**2, mode="valid"))

    def whitened(self, residual: Array, beside: Array | float = 1.0) -> Array:
        """Innovations along the last axis, in standard deviations or ``beside`` times (.., T) those."""
        white = np.empty(residual.shape)
        # The first sample counts for what the process does on average, and the filter starts from there.
        np.divide(residual[..., :1], np.sqrt(self._gain), out=white[..., :1])
        gain = residual[..., 1:] - self.phi * residual[..., :-1]
        white[..., 1:], _ = lfilter([1.0], [1.0, -self.theta], gain, axis=-1, zi=self.theta * white[..., :1])
        white /= self.scale_v * beside
        return white


def estimated(residuals: Sequence[Array], floor_v: float, most_phi: float = MOST_PHI) -> Noise:
    """The noise of several recordings' residuals, by the likelihood of clipped innovations; ``floor_v`` at least.

    It is coloured by ``most_phi`` at most.
    """

    def innovations(numbers: Array) -> Array:
        phi, theta = _bounded(numbers, most_phi)
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
    phi, theta = _bounded(best.x, most_phi)
    return Noise(phi, theta, max(_scale(innovations(best.x)), floor_v))


def _bounded(numbers: Array, most_phi: float) -> tuple[float, float]:
    """Phi below ``most_phi``, theta below it: only then is the process a sum of white and coloured noise."""
    phi = most_phi / (1.0 + np.exp(-numbers[0]))
    theta = phi / (1.0 + np.exp(-numbers[1]))
    return float(phi), float(theta)


def _scale(e: Array) -> float:
    """Standard deviation of the bulk of innovations, deaf to outliers."""
    return float(max(1.4826 * np.median(np.abs(e)), np.std(np.clip(e, *np.quantile(e, [0.02, 0.98]))), 1e-9))
