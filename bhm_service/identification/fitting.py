"""Bounded least squares over named, scaled parameters, with what the data say of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from bhm_service.units import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Free:
    """One parameter to be found between ``low`` and ``high``; ``log`` where only its order of magnitude is known."""

    name: str
    start: float
    low: float
    high: float
    log: bool = False
    prior: tuple[float, float] | None = None  # mean and standard deviation (of the logarithm where ``log``)

    def inner(self, value: float) -> float:
        """The number that the optimiser moves."""
        return float(np.log(value)) if self.log else value

    def outer(self, number: float) -> float:
        """Back from the optimiser's number."""
        return float(np.exp(number)) if self.log else float(number)


@dataclass(frozen=True, slots=True)
class Fit:
    """What a fit found."""

    values: dict[str, float]
    sd: dict[str, float]  # in the parameter's own unit, first order
    residual: Array
    evaluations: int


def fit(free: Sequence[Free], residual: Callable[[Mapping[str, float]], Array], evaluations: int = 200) -> Fit:
    """Minimise the sum of squares of ``residual`` (scaled to unit standard deviation) and of the priors."""

    def values(x: Array) -> dict[str, float]:
        return {f.name: f.outer(number) for f, number in zip(free, x, strict=True)}

    def whole(x: Array) -> Array:
        pulls = [(number - f.prior[0]) / f.prior[1] for f, number in zip(free, x, strict=True) if f.prior is not None]
        return np.concatenate([residual(values(x)), pulls])

    low = np.array([f.inner(f.low) for f in free])
    high = np.array([f.inner(f.high) for f in free])
    start = np.clip(np.array([f.inner(f.start) for f in free]), low, high)
    solution = least_squares(whole, start, bounds=(low, high), x_scale="jac", max_nfev=evaluations)
    found = values(solution.x)
    size = np.maximum(np.linalg.norm(solution.jac, axis=0), 1e-300)
    scaled = solution.jac / size
    inner_sd = np.sqrt(np.diag(np.linalg.pinv(scaled.T @ scaled, hermitian=True))) / size
    sd = {f.name: float(s * found[f.name] if f.log else s) for f, s in zip(free, inner_sd, strict=True)}
    return Fit(found, sd, np.asarray(solution.fun), int(solution.nfev))
