"""Derivatives of a flight's residuals, by those numbers only that the flight depends on.

With a start and a pack of its own for every flight most numbers of a vector belong to other flights: kept in full, the
derivatives of a hundred flights are a hundred times as many as those that are not zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.units import Array, Places


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """Of one flight, by a vector (n,)."""

    by: Array  # (rows, m)
    at: Places  # (m,) of the vector
    size: int  # n

    def until(self, rows: int) -> Slopes:
        """Of its first residuals only."""
        return Slopes(self.by[:rows], self.at, self.size)

    def back(self, rows: Array) -> Array:
        """Series of residuals (.., rows) times the derivatives; (.., n)."""
        found = np.zeros((*rows.shape[:-1], self.size))
        found[..., self.at] = rows @ self.by
        return found

    def along(self, steps: Array) -> Array:
        """What steps of the vector (n, ..) do to the residuals; (rows, ..)."""
        return np.asarray(self.by @ steps[self.at])

    def add_square(self, total: Array, weights: Array | None = None) -> None:
        """Add the derivatives times themselves, residuals weighted (rows,), to ``total`` (n, n)."""
        # A matrix times itself is half the work.
        root = self.by if weights is None else self.by * np.sqrt(weights)[:, None]
        total[np.ix_(self.at, self.at)] += root.T @ root

    def full(self) -> Array:
        """With the zeros; (rows, n)."""
        found = np.zeros((self.by.shape[0], self.size))
        found[:, self.at] = self.by
        return found


def parted(series: Array, flights: Sequence[Slopes]) -> list[Array]:
    """Residuals of all flights (rows, ..), flight by flight."""
    ends = np.cumsum([s.by.shape[0] for s in flights])
    return np.split(series, ends[:-1])
