"""What the recordings that a pack was identified from leave open of the errors of a cell model's form.

They are numbers that add to the model's voltage, block by block; what each of them adds says `discrepancy.lab`. Only
the lab has these recordings, so what they tell goes with the battery file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bhm_service.units import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOpen:
    """Mean and covariance of such numbers; all blocks in their order make one vector (n,)."""

    mean: Mapping[str, tuple[float, ...]]
    factor: tuple[tuple[float, ...], ...]  # rows of the lower triangle L of the covariance L L'
    error_v: float | None = None  # [V] that this model is off by on pieces that no fit saw; None: not said
    load_error_v: float | None = None  # [V] likewise on a whole recording of a varying load

    @property
    def sizes(self) -> dict[str, int]:
        """How many numbers each block has."""
        return {name: len(values) for name, values in self.mean.items()}

    @property
    def covariance(self) -> Array:
        """Of the vector; (n, n)."""
        lower = np.zeros((len(self.factor), len(self.factor)))
        for k, row in enumerate(self.factor):
            lower[k, : k + 1] = row
        return np.asarray(lower @ lower.T)


def left_open(mean: Mapping[str, Array], covariance: Array) -> LeftOpen:
    """The same of arrays. Raises numpy.linalg.LinAlgError where the covariance (n, n) is none."""
    lower = np.linalg.cholesky(covariance)
    return LeftOpen(
        mean={name: tuple(float(v) for v in values) for name, values in mean.items()},
        factor=tuple(tuple(float(v) for v in row[: k + 1]) for k, row in enumerate(lower)),
    )
