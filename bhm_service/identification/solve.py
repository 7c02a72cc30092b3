"""Solving a fit: a bounded trust region over scaled numbers, or the paper's simplex."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import qr
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
    last: dict[bytes, Array] = {}

    def triangle(part: Array) -> Array:
        """Jacobian and residuals turned into a triangle: as long, and at the same angles, in as many rows as columns.

        Most places that are tried are taken, and then their Jacobian is asked for: both are made at once.
        """
        key = part.tobytes()
        if key not in last:
            last.clear()
            residual, jacobian = problem.linearised(_whole(start, moving, part), columns)
            last[key] = qr(np.column_stack([jacobian, residual]), mode="raw", overwrite_a=True, check_finite=False)[1]
        return last[key]

    found = least_squares(
        lambda part: triangle(part)[:, -1], inside, jac=lambda part: triangle(part)[:, :-1], bounds=(low, high),
        x_scale="jac", max_nfev=evaluations, ftol=1e-5, xtol=1e-6,
    )  # fmt: skip
    return Solution(
        problem=problem, x=_whole(start, moving, found.x), cost=float(found.cost), evaluations=int(found.nfev)
    )


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
