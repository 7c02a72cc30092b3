"""Rate capacity: a fast discharge yields less charge (Peukert)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.effects.base import Conditions, Effect
from bhm_service.battery.parameters import parameter
from bhm_service.units import SECONDS_PER_HOUR, Value

_LEAST_C, _MOST_C = 0.02, 50.0  # [1/h] beyond these loads the power law says nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class RateCapacity(Effect):
    """dSoC/dt = -i/Q (i / i_1C)^(p - 1)."""

    id: ClassVar[str] = "rate-capacity"
    title: ClassVar[str] = "A fast discharge yields less charge"
    equation: ClassVar[str] = "dSoC/dt = -i/Q (i / i_1C)^(p - 1)"
    source: ClassVar[str] = "Peukert 1897; lithium-ion p = 1.01-1.08"
    excited_by: ClassVar[str] = "deep flights at different loads"
    mimics: ClassVar[tuple[str, ...]] = ("capacity-fade", "current-gain", "weak-cell", "resistance-temperature")
    manoeuvre: ClassVar[str] = "use the same charge once at a low and once at a high speed, rest after both"

    exponent: Value = parameter("p", "1", 1.0, 1.4, "Peukert's exponent", absent=1.0, prior=(1.04, 0.02))

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        rate = np.abs(at.cell_current) * (SECONDS_PER_HOUR / at.cell.capacity_c)
        return Modifiers(capacity=np.minimum(np.maximum(rate, _LEAST_C), _MOST_C) ** (1.0 - self.exponent))
