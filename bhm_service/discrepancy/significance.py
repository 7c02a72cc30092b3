"""How often the whole catalogue would do as well on noise alone.

The whitened residuals of the final fit are turned round in blocks, which keeps their size, tails and leftover colour
and takes away what is the same in all flights; on each such null the best of all candidates is taken.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from bhm_service.discrepancy.first_order import Geometry, candidate_geometry
from bhm_service.discrepancy.odds import Names
from bhm_service.discrepancy.search import Search
from bhm_service.units import Array

NULLS = 200
_BLOCK = 60  # samples that are turned round together


def familywise(found: Search, names: Names, rng: np.random.Generator) -> dict[str, float]:
    """For each member, the share of nulls in which some candidate gains as much as it does. [0, 1]"""
    if not names:
        return {}
    whole = found.fitted(names)
    bare = found.fitted(frozenset())
    geometries = (candidate_geometry(bare, found.joint(frozenset({c.id})), c) for c in found.candidates)
    return exceeded({name: found.earned(names)[name] for name in names}, whole.rows, geometries, rng)


def exceeded(
    gains: Mapping[str, float], rows: Sequence[Array], geometries: Iterable[Geometry], rng: np.random.Generator
) -> dict[str, float]:
    """The share of nulls, made of the whitened ``rows``, in which the best candidate gains as much. [0, 1]"""
    residuals = np.concatenate([np.clip(r, -5.0, 5.0) for r in rows])
    nulls = residuals[:, None] * _signs([r.size for r in rows], rng)
    best = np.full(NULLS, -np.inf)
    for geometry in geometries:
        best = np.maximum(best, _gain(geometry.directions.T @ nulls, geometry.information))
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
