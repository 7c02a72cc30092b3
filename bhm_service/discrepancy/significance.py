"""How often the whole catalogue would do as well on noise alone.

The whitened residuals of the final fit are turned round in blocks, which keeps their size, tails and leftover colour
and takes away what is the same in all flights; on each such null the best of all candidates is taken.
"""

from __future__ import annotations

import numpy as np

from bhm_service.discrepancy.search import Names, Search, candidate_geometry
from bhm_service.units import Array

NULLS = 200
_BLOCK = 60  # samples that are turned round together


def familywise(found: Search, names: Names, rng: np.random.Generator) -> dict[str, float]:
    """For each member, the share of nulls in which some candidate gains as much as it does. [0, 1]"""
    if not names:
        return {}
    whole = found.fitted(names)
    rows = np.concatenate([np.clip(r, -5.0, 5.0) for r in whole.rows])
    signs = _signs([r.size for r in whole.rows], rng)
    bare = found.fitted(frozenset())
    best = np.full(NULLS, -np.inf)
    gains: dict[str, float] = {}
    for candidate in found.candidates:
        geometry = candidate_geometry(bare, found.joint(frozenset({candidate.id})), candidate)
        best = np.maximum(best, _gain(geometry.directions.T @ (rows[:, None] * signs), geometry.information))
    for name in names:
        gains[name] = found.earned(names)[name]
    return {name: float((1 + np.sum(best >= gain)) / (1 + NULLS)) for name, gain in gains.items()}


def _signs(lengths: list[int], rng: np.random.Generator) -> Array:
    found = []
    for length in lengths:
        blocks = rng.choice([-1.0, 1.0], size=(-(-length // _BLOCK), NULLS))
        found.append(np.repeat(blocks, _BLOCK, axis=0)[:length])
    return np.concatenate(found)


def _gain(score: Array, information: Array) -> Array:
    posterior = information + np.eye(information.shape[0])
    half = 0.5 * np.sum(score * np.linalg.solve(posterior, score), axis=0)
    return np.asarray(half - 0.5 * np.linalg.slogdet(posterior)[1])
