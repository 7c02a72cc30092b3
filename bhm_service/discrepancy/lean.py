"""What a size costs for the numbers that it multiplies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Lean:
    """Half the volume of ``count`` numbers that the flights tell the better, the larger a size is; in its own unit."""

    absent: float
    count: float

    def nats(self, size: float) -> float:
        """Half the cost at a size, but for a constant."""
        return self.count * float(np.log(max(abs(size - self.absent), np.finfo(float).tiny)))

    def slope(self, size: float) -> float:
        """Of the nats, by the size."""
        apart = size - self.absent
        return self.count / apart if apart else 0.0
