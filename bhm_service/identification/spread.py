"""What the recordings leave open of every number of a solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.identification.problem import Problem, lasting, power
from bhm_service.identification.solve import Solution
from bhm_service.units import Array

_SEGMENTS = 16  # of every recording, for the bootstrap
_REPLICATES = 200
_WITHIN_ONE_SD = (0.1587, 0.8413)
_UNKNOWN_SHARE = 0.7  # a number whose spread is still this share of its prior's was not told by the recordings
_ALIKE = 0.95  # correlation beyond which two numbers are not told apart


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """What is not known of a solution's numbers, in the fit's own (logarithms where they are)."""

    covariance: Array
    bootstrap_sd: Array
    told: dict[str, float]  # the larger standard deviation over the prior's, for every number
    alike: tuple[tuple[str, str, float], ...]  # pairs that the recordings cannot tell apart, with their correlation

    def sd(self, k: int) -> float:
        """The larger of the two standard deviations of a number."""
        return float(max(np.sqrt(self.covariance[k, k]), self.bootstrap_sd[k]))


def spread(solution: Solution, seed: int = 1, *, as_expected: bool = False) -> Spread:
    """Covariance at the optimum, checked by a bootstrap over segments of the recordings.

    Residuals are not independent: their variance and how long they last are taken from the residuals themselves,
    recording by recording (a sandwich of the Jacobian around them). ``as_expected``: at least what the weights of the
    fit stand for, where a fit may follow recordings for the wrong reason and its residuals do not show it.
    """
    problem, x = solution.problem, solution.x
    unknowns = problem.unknowns
    residual, jacobian = problem.linearised(x, np.arange(x.size))
    data = problem.data_rows
    curvature = jacobian.T @ jacobian
    prior = jacobian[data:].T @ jacobian[data:]
    meat = prior.copy()
    segments: list[tuple[Array, Array]] = []  # gradient and curvature of each
    owner: list[int] = []
    at = 0
    for number, used in enumerate(problem.used):
        count = int(used.sum())
        j, r = jacobian[at : at + count], residual[at : at + count]
        inflation = lasting(r)
        # Weighted residuals r = w e: with e of equal variance, J^T W S W J is the sum of w^2 e^2 terms.
        meat += inflation * (j * (r**2)[:, None]).T @ j
        for piece in np.array_split(np.arange(count), _SEGMENTS):
            segments.append((j[piece].T @ r[piece], j[piece].T @ j[piece]))
            owner.append(number)
        at += count
    prior_sd = np.concatenate([b.sd for b in unknowns.blocks])
    scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    inverse = np.linalg.pinv(curvature / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    covariance = inverse @ meat @ inverse
    if as_expected:
        wider = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(covariance), 1e-300), 1.0))
        covariance = covariance * np.outer(wider, wider)
    # No recording takes away what was known before, which a linear step from few segments may seem to.
    bootstrap_sd = np.minimum(_bootstrap(segments, np.array(owner), prior, curvature, seed), prior_sd)
    larger = np.maximum(np.sqrt(np.maximum(np.diag(covariance), 0.0)), bootstrap_sd)
    return Spread(
        covariance=covariance,
        bootstrap_sd=bootstrap_sd,
        told={name: float(s / p) for name, s, p in zip(unknowns.names, larger, prior_sd, strict=True)},
        alike=_alike(unknowns.names, covariance),
    )


def likeliest(problem: Problem, candidates: Sequence[Array]) -> Array:
    """Of several places where a fit came to rest, the one that the recordings and the priors together prefer.

    The fit's own cost takes a voltage to be known to a few millivolts; where the residuals of the closest candidate
    show that the recordings know better, they outweigh the priors accordingly.
    """
    rows = problem.residuals(np.array(candidates))
    ends = np.cumsum([int(used.sum()) for used in problem.used])
    data = [part**2 for part in np.split(rows, ends, axis=1)]
    closest = rows[int(np.argmin(sum(part.sum(axis=1) for part in data[:-1])))]
    score = data[-1].sum(axis=1)
    for part, residual in zip(data[:-1], np.split(closest, ends)[:-1], strict=True):
        score = score + part.sum(axis=1) / power(residual)
    return candidates[int(np.argmin(score))]


def _bootstrap(
    segments: list[tuple[Array, Array]], owner: np.ndarray, prior: Array, curvature: Array, seed: int
) -> Array:
    """Spread of one Gauss-Newton step with the segments of every recording drawn anew."""
    generator = np.random.default_rng(seed)
    gradients = np.array([g for g, _ in segments])
    curvatures = np.array([c for _, c in segments])
    size = curvature.shape[0]
    steps = np.empty((_REPLICATES, size))
    mean_gradient = gradients.sum(axis=0)
    ridge = 1e-9 * np.diag(np.maximum(np.diag(curvature), 1e-300))
    for k in range(_REPLICATES):
        chosen = np.concatenate(
            [
                generator.choice(np.flatnonzero(owner == number), int((owner == number).sum()))
                for number in np.unique(owner)
            ]
        )
        matrix = curvatures[chosen].sum(axis=0) + prior + ridge
        steps[k] = np.linalg.solve(matrix, gradients[chosen].sum(axis=0) - mean_gradient)
    # Where few segments tell a number, a draw without them steps out of all proportion: such draws are not the spread.
    return np.asarray(0.5 * np.diff(np.quantile(steps, _WITHIN_ONE_SD, axis=0), axis=0)[0])


def _alike(names: list[str], covariance: Array) -> tuple[tuple[str, str, float], ...]:
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(sd, sd)
    scalar = [k for k, name in enumerate(names) if "[" not in name]
    found = [
        (names[a], names[b], float(correlation[a, b]))
        for i, a in enumerate(scalar)
        for b in scalar[i + 1 :]
        if abs(correlation[a, b]) > _ALIKE
    ]
    return tuple(sorted(found, key=lambda pair: -abs(pair[2])))


def not_told(spread_: Spread) -> list[str]:
    """Numbers that stayed where they were assumed to be."""
    return [name for name, share in spread_.told.items() if share > _UNKNOWN_SHARE and "[" not in name]
