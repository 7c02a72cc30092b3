"""Solving a fit: a bounded trust region over scaled numbers, or the paper's simplex."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import qr, svd
from scipy.optimize import least_squares, minimize

from bhm_service.identification.problem import Problem
from bhm_service.units import Array

Method = Literal["trf", "nelder-mead"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Where a fit came to rest."""

    problem: Problem
    x: Array
    cost: float
    evaluations: int

    @property
    def values(self) -> dict[str, Array]:
        """Blocks by name, each (1, size)."""
        return self.problem.unknowns.values(self.x)


def solve(
    problem: Problem,
    method: Method = "trf",
    starts: Sequence[Array] = (),
    free: Sequence[str] | None = None,
    evaluations: int = 60,
    progress: Callable[[], None] | None = None,
) -> Solution:
    """The best of the solutions from several starts; ``free`` names the blocks that move, all if not given."""
    unknowns = problem.unknowns
    moving = np.ones(unknowns.start.size, dtype=bool)
    if free is not None:
        moving[:] = False
        for block in unknowns.blocks:
            if block.name in free or block.name.startswith(("soc[", "scale[")):
                moving[unknowns.slice_of(block.name)] = True
    best: Solution | None = None
    for start in starts or [unknowns.start]:
        found = (_trf if method == "trf" else _nelder_mead)(problem, np.asarray(start), moving, evaluations)
        if progress is not None:
            progress()
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    return best


def _whole(start: Array, moving: Array, part: Array) -> Array:
    x = np.tile(start, (*part.shape[:-1], 1)) if part.ndim > 1 else start.copy()
    x[..., moving] = part
    return x


def _trf(problem: Problem, start: Array, moving: Array, evaluations: int) -> Solution:
    """Bounded trust region over scaled numbers."""
    unknowns = problem.unknowns
    low, high = unknowns.low[moving], unknowns.high[moving]
    inside = np.clip(start[moving], low + 1e-6 * (high - low), high - 1e-6 * (high - low))

    columns = np.flatnonzero(moving)
    axes, low, high = _axes(problem, _whole(start, moving, inside), columns, low, high)
    last: dict[bytes, Array] = {}

    def triangle(part: Array) -> Array:
        """Jacobian and residuals turned into a triangle: as long, and at the same angles, in as many rows as columns.

        Most places that are tried are taken, and then their Jacobian is asked for: both are made at once.
        """
        key = part.tobytes()
        if key not in last:
            last.clear()
            residual, jacobian = problem.linearised(_whole(start, moving, axes @ part), columns)
            rows = np.column_stack([jacobian @ axes, residual])
            last[key] = qr(rows, mode="raw", overwrite_a=True, check_finite=False)[1]
        return last[key]

    found = least_squares(
        lambda part: triangle(part)[:, -1], axes.T @ inside, jac=lambda part: triangle(part)[:, :-1],
        bounds=(low, high), x_scale="jac", max_nfev=evaluations, ftol=1e-5, xtol=1e-6,
    )  # fmt: skip
    x = _whole(start, moving, axes @ found.x)
    return Solution(problem=problem, x=x, cost=float(found.cost), evaluations=int(found.nfev))


def _axes(problem: Problem, x: Array, columns: np.ndarray, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """The numbers that move by axes along which a series can be told apart (n, n), orthonormal, and their bounds.

    The coefficients of a series nearly make up for each other: to a trust region that is drawn along them the way to
    the minimum is a narrow valley that it creeps along. Along the principal axes of what they do to the recordings it
    is an ordinary slope. Only the series is turned, whose bounds are so far that any box around them will do.
    """
    axes, low, high = np.eye(columns.size), low.copy(), high.copy()
    own = np.array([b.series for b in problem.unknowns.blocks for _ in range(b.size)])[columns]
    if own.any():
        _, jacobian = problem.linearised(x, columns[own])
        axes[np.ix_(own, own)] = svd(jacobian, full_matrices=False)[2].T
        reach = float(np.linalg.norm(np.maximum(np.abs(low[own]), np.abs(high[own]))))
        low[own], high[own] = -reach, reach
    return axes, low, high


def _nelder_mead(problem: Problem, start: Array, moving: Array, evaluations: int) -> Solution:
    """The paper's simplex; curves are too many numbers for it and stay where the slow discharge put them."""
    unknowns = problem.unknowns
    for block in unknowns.blocks:
        if block.size > 1 or "[" in block.name:
            moving = moving.copy()
            moving[unknowns.slice_of(block.name)] = False
    low, high = unknowns.low[moving], unknowns.high[moving]

    def cost(part: Array) -> float:
        rows = problem.residuals(_whole(start, moving, np.clip(part, low, high)[None, :]))[0]
        return float(0.5 * rows @ rows)

    found = minimize(
        cost, start[moving], method="Nelder-Mead", options={"maxfev": 40 * evaluations, "adaptive": True, "fatol": 1e-4}
    )
    x = _whole(start, moving, np.clip(found.x, low, high))
    return Solution(problem=problem, x=x, cost=float(found.fun), evaluations=int(found.nfev))
