"""Curves whose shape is off: open-circuit voltage and ohmic resistance over the state of charge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.effects.base import Conditions, Effect, Instant
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value

_LEAST = 0.05  # of the resistance is left however it is bent


def hats(knots: tuple[float, ...], values: tuple[Value, ...], soc: Value) -> Value:
    """Straight lines between ``values`` at ``knots``, level beyond them; values may be columns (M, 1)."""
    total = values[0]
    for low, high, left, right in zip(knots, knots[1:], values, values[1:], strict=False):
        share = np.minimum(np.maximum((soc - low) / (high - low), 0.0), 1.0)
        total = total + (right - left) * share
    return total


def _millivolts(soc: float) -> Value:
    volts: Value = parameter(
        f"d({soc:g})", "mV", -200.0, 200.0, f"at SoC {soc:g}, of a cell", scale=1e-3, default=0.0, absent=0.0,
        prior=(0.0, 12.0),
    )  # fmt: skip
    return volts


@dataclass(frozen=True, slots=True, kw_only=True)
class OcvShape(Effect):
    """dV = n d(SoC), straight between eleven charges: a phase of the electrodes is a tenth of the charge wide."""

    id: ClassVar[str] = "ocv-shape"
    title: ClassVar[str] = "The open-circuit curve has another shape"
    equation: ClassVar[str] = "dV = n d(SoC)"
    source: ClassVar[str] = "spread between lots, LiHV, loss of lithium or active material: 5-30 mV a cell"
    excited_by: ClassVar[str] = "flights over the whole charge"
    mimics: ClassVar[tuple[str, ...]] = ("slow-diffusion", "hysteresis", "partial-charge", "entropic-voltage")
    manoeuvre: ClassVar[str] = "a discharge of this pack at C/50 on the bench"
    knots: ClassVar[tuple[float, ...]] = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)

    at_0: Value = _millivolts(0.0)
    at_10: Value = _millivolts(0.1)
    at_20: Value = _millivolts(0.2)
    at_30: Value = _millivolts(0.3)
    at_40: Value = _millivolts(0.4)
    at_50: Value = _millivolts(0.5)
    at_60: Value = _millivolts(0.6)
    at_70: Value = _millivolts(0.7)
    at_80: Value = _millivolts(0.8)
    at_90: Value = _millivolts(0.9)
    at_100: Value = _millivolts(1.0)

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        values = tuple(getattr(self, f"at_{round(100 * soc)}") for soc in self.knots)
        return now.series * hats(self.knots, values, now.soc - now.curve_lag)


def _share(soc: float) -> Value:
    share: Value = parameter(
        f"d({soc:g})", "1", -0.8, 10.0, f"at SoC {soc:g}", default=0.0, absent=0.0, prior=(0.0, 0.2)
    )
    return share


@dataclass(frozen=True, slots=True, kw_only=True)
class ResistanceShape(Effect):
    """R = R_0 (1 + d(SoC)) in the ohmic part, straight between four charges."""

    id: ClassVar[str] = "resistance-shape"
    title: ClassVar[str] = "Resistance depends on charge in another way"
    equation: ClassVar[str] = "R = R_0 (1 + d(SoC))"
    source: ClassVar[str] = "pulse tests of pouch cells over charge: 10-30 %"
    excited_by: ClassVar[str] = "throttle steps at high, middle and low charge"
    mimics: ClassVar[tuple[str, ...]] = ("self-heating", "weak-cell")
    manoeuvre: ClassVar[str] = "three throttle steps of 5 s, at three charges"
    feedback: ClassVar[bool] = True
    knots: ClassVar[tuple[float, ...]] = (0.05, 0.25, 0.55, 0.9)

    at_5: Value = _share(0.05)
    at_25: Value = _share(0.25)
    at_55: Value = _share(0.55)
    at_90: Value = _share(0.9)

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        shape = 1.0 + hats(self.knots, (self.at_5, self.at_25, self.at_55, self.at_90), at.soc)
        return Modifiers(resistance=np.maximum(shape, _LEAST))
