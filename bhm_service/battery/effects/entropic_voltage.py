"""Entropy: the open-circuit voltage moves with temperature, and discharging takes up or gives off heat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.effects.base import Effect, Instant
from bhm_service.battery.parameters import parameter
from bhm_service.units import REFERENCE_TEMPERATURE_K, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class EntropicVoltage(Effect):
    """dV = n dU/dT (T - 298.15 K), and the reversible heat -I T n dU/dT."""

    id: ClassVar[str] = "entropic-voltage"
    title: ClassVar[str] = "Open-circuit voltage moves with temperature"
    equation: ClassVar[str] = "dV = n dU/dT (T - 298.15 K), heat -I T n dU/dT"
    source: ClassVar[str] = "Bernardi, Pawlikowski & Newman 1985; -0.5 to +0.3 mV/K over cells and charge"
    excited_by: ClassVar[str] = "rests at the same charge and different temperatures"
    mimics: ClassVar[tuple[str, ...]] = ("core-lag", "voltage-gain", "voltage-offset", "ocv-shape")
    manoeuvre: ClassVar[str] = "read the resting voltage of one charge at two temperatures"
    drivers: ClassVar[tuple[str, ...]] = ("temperature",)

    slope: Value = parameter(
        "dU/dT", "mV/K", -1.2, 1.2, "of a cell", scale=1e-3, absent=0.0, prior=(0.0, 0.25)
    )  # fmt: skip

    def heat(self, state: tuple[Value, ...], now: Instant) -> Value:
        return -now.series * self.slope * now.current * now.temperature

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return now.series * self.slope * (now.temperature - REFERENCE_TEMPERATURE_K)
