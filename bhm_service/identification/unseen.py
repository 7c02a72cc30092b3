"""How well a form of a model predicts pieces of the recordings that its fit did not see.

Every recording is cut into ten pieces; a form is fitted to the even ones and judged on the odd ones, and the other way
round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bhm_service.identification.experiment import Kind
from bhm_service.identification.problem import Problem
from bhm_service.identification.solve import Solution, solve
from bhm_service.identification.unknowns import Block
from bhm_service.units import Array, Flags

BETTER = 0.95  # of the error without it: what an addition has to reach
_PIECES = 10
_EVALUATIONS = 25  # of a fit
_EDGE = 0.02  # of a bound's range (in the fit's own numbers): nearer than this is at the bound
_AGREEING = 0.5  # of what was not known before
KNOWN = 3.0  # standard deviations of it: what is further off is another thing than what was known
_LEAST_V = 1e-6  # [V] that anything is off by
_LEAST_SOC = 0.05  # below, cells are not alike


@dataclass(frozen=True, slots=True)
class Unseen:
    """Errors on pieces that a fit did not see. [V]"""

    rms: float  # over all recordings
    typical: float  # geometric mean of the recordings' own: what no form follows in one of them decides nothing
    quick: float  # the same of the differences between neighbours: what lasts for minutes decides nothing
    possible: bool  # additions are off the bounds of what is physical
    agreed: bool  # the two fits agree on their size
    known: bool = True  # and are of the size that was known before


def unseen_error(problem: Problem) -> Unseen:
    """Fit one half of the pieces, judge on the other, and the other way round.

    Two fits agree on a number when they are within half of what was not known of it before.
    """
    squares: list[list[float]] = [[] for _ in problem.experiments]
    changes: list[list[float]] = [[] for _ in problem.experiments]
    additions = problem.family.extras.blocks(problem.family.ohm)
    found_x: list[Array] = []
    halves = [
        [np.arange(e.time_s.size) * _PIECES // e.time_s.size % 2 == fold for e in problem.experiments]
        for fold in (0, 1)
    ]
    for pieces, found in zip(halves, _fits([_seen(problem, pieces) for pieces in halves]), strict=True):
        found_x.append(found.x)
        for own, quick, e, used, piece, (misfit, soc) in zip(
            squares, changes, problem.experiments, problem.used, pieces, problem.misfits(found.x), strict=True
        ):
            weight = e.weights() * (used & ~piece & (soc > _LEAST_SOC))
            if weight.sum() > 0.0:
                own.append(float(np.nansum(weight * np.nan_to_num(misfit) ** 2) / weight.sum()))
                both = (weight[1:] > 0.0) & (weight[:-1] > 0.0)
                quick.append(float(np.mean(np.diff(np.nan_to_num(misfit))[both] ** 2)) if both.any() else 0.0)
    sizes = [(block, np.stack([x[problem.unknowns.slice_of(block.name)] for x in found_x])) for block in additions]
    possible = all(_possible(block, both) for block, both in sizes)
    agreed = all(bool(np.all(np.abs(both[0] - both[1]) < _AGREEING * block.sd)) for block, both in sizes)
    known = all(bool(np.all(np.abs(both.mean(axis=0) - block.prior) < KNOWN * block.sd)) for block, both in sizes)
    means, moves = (np.array([np.mean(own) for own in every if own]) for every in (squares, changes))
    return Unseen(
        float(np.sqrt(means.mean())), _typical(means), _typical(np.maximum(moves, _LEAST_V**2)), possible, agreed,
        known,
    )  # fmt: skip


def _seen(problem: Problem, pieces: Sequence[Flags]) -> Problem:
    """The problem on some samples only."""
    return replace(problem, used=tuple(u & p for u, p in zip(problem.used, pieces, strict=True)))


def _fits(halves: Sequence[Problem]) -> list[Solution]:
    """The best fit to each half, from the usual start and from where the other came to rest.

    What only one of two fits to the same cell finds is a valley that the other missed, and no word on a form.
    """
    found = [solve(half, evaluations=_EVALUATIONS) for half in halves]
    again = [
        solve(half, starts=[other.x], evaluations=_EVALUATIONS) for half, other in zip(halves, found[::-1], strict=True)
    ]
    return [min(pair, key=lambda s: s.cost) for pair in zip(found, again, strict=True)]


def _typical(means: Array) -> float:
    return float(np.exp(0.5 * np.log(means).mean()))


def foretold(problem: Problem) -> dict[int, float]:
    """Error on each recording under load, foretold by a fit to all others [V]; nothing where there is only one."""
    loaded = [k for k, e in enumerate(problem.experiments) if e.kind is not Kind.SLOW]
    errors = {}
    for left_out in loaded if len(loaded) > 1 else ():
        seen = tuple(used & (k != left_out) for k, used in enumerate(problem.used))
        found = solve(replace(problem, used=seen), evaluations=_EVALUATIONS)
        misfit, soc = problem.misfits(found.x)[left_out]
        weight = problem.experiments[left_out].weights() * (problem.used[left_out] & (soc > _LEAST_SOC))
        errors[left_out] = float(np.sqrt(np.nansum(weight * misfit**2) / weight.sum()))
    return errors


def _possible(block: Block, both: Array) -> bool:
    places = (both - block.low) / (block.high - block.low)
    return bool(np.all((places > _EDGE) & (places < 1.0 - _EDGE)))
