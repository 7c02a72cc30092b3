"""Resistance near full charge, where charge transfer has few places left to go from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.effects.base import Effect, Instant
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class FullChargeResistance(Effect):
    """R = R_f e^((SoC - 1) / w) beside what the cell models have, which grows towards empty only.

    A part of a lab's model of a cell: no candidate of what is missing in flight.
    """

    id: ClassVar[str] = "full-charge-resistance"
    title: ClassVar[str] = "More resistance near full charge"
    equation: ClassVar[str] = "R = R_f e^((SoC - 1) / w)"
    source: ClassVar[str] = "charge transfer slows down as x(1 - x) falls towards full charge"
    excited_by: ClassVar[str] = "a load from full charge"

    resistance: Value = parameter("R_f", "ohm", 0.0, 1.0, "of a cell, at full charge", absent=0.0)
    width: Value = parameter("w", "1", 0.01, 10.0, "charge over which it falls to a third; well above 1: straight")

    def heat(self, state: tuple[Value, ...], now: Instant) -> Value:
        return self.series_resistance(state, now) * now.current**2

    def series_resistance(self, state: tuple[Value, ...], now: Instant) -> Value:
        here = self.resistance * now.by.resistance * np.exp((np.minimum(now.soc, 1.0) - 1.0) / self.width)
        return now.series / now.parallel * here
