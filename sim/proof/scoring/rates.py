"""Shares with their exact intervals, and medians."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, norm


@dataclass(frozen=True, slots=True)
class Rate:
    """``hits`` of ``n``, with the exact (Clopper-Pearson) 95 % interval; an empty one is NaN."""

    hits: int
    n: int

    @property
    def value(self) -> float:
        """The share itself."""
        return self.hits / self.n if self.n else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Clopper & Pearson 1934, by scipy."""
        if self.n == 0:
            return (0.0, 1.0)
        found = binomtest(self.hits, self.n).proportion_ci(0.95, "exact")
        return float(found.low), float(found.high)


def rate(flags: Iterable[bool | None]) -> Rate:
    """Of those that apply, how many hold."""
    known = [bool(flag) for flag in flags if flag is not None]
    return Rate(sum(known), len(known))


def coverage(z: Sequence[float], level: float) -> Rate:
    """Of errors in their own standard deviations, how many are inside the central interval of this level."""
    reach = float(norm.ppf(0.5 + level / 2.0))
    return rate(abs(value) <= reach for value in z)


def quantile(values: Sequence[float], share: float) -> float:
    """A quantile; NaN of nothing."""
    return float(np.quantile(values, share)) if values else float("nan")
