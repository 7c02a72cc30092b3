"""Cold capacity: below 25 degC part of the charge cannot be had."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.effects.base import Conditions, Effect
from bhm_service.battery.parameters import parameter
from bhm_service.units import REFERENCE_TEMPERATURE_K, Value

_LEAST = 0.1  # of the capacity is left however cold it is


@dataclass(frozen=True, slots=True, kw_only=True)
class ColdCapacity(Effect):
    """Q = Q_25 (1 - k_c max(25 degC - T, 0))."""

    id: ClassVar[str] = "cold-capacity"
    title: ClassVar[str] = "A cold pack gives less charge"
    equation: ClassVar[str] = "Q = Q_25 (1 - k_c max(25 degC - T, 0))"
    source: ClassVar[str] = "data sheets of lithium-ion cells: 0.3-0.8 %/K"
    excited_by: ClassVar[str] = "cold flights down to a low charge"
    mimics: ClassVar[tuple[str, ...]] = ("resistance-temperature", "capacity-fade")
    manoeuvre: ClassVar[str] = "fly the pack deep when cold, then count the charge that goes in again when warm"
    drivers: ClassVar[tuple[str, ...]] = ("temperature",)

    per_kelvin: Value = parameter(
        "k_c", "%/K", 0.0, 3.0, "share of the capacity lost per kelvin below 25 degC", scale=0.01, absent=0.0,
        prior=(0.5, 0.2),
    )  # fmt: skip

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        below = np.maximum(REFERENCE_TEMPERATURE_K - at.temperature, 0.0)
        return Modifiers(capacity=np.maximum(1.0 - self.per_kelvin * below, _LEAST))
