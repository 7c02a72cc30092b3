"""Entropy: the open-circuit voltage moves with temperature, and discharging takes up or gives off heat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.effects.base import Effect, Instant
from bhm_service.battery.parameters import parameter
from bhm_service.units import REFERENCE_TEMPERATURE_K, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class EntropicVoltage(Effect):
    """dV = n dU/dT (T - 298.15 K), and the reversible heat -I T n dU/dT; dU/dT a straight line over the charge."""

    id: ClassVar[str] = "entropic-voltage"
    title: ClassVar[str] = "Open-circuit voltage moves with temperature"
    equation: ClassVar[str] = "dV = n dU/dT (T - 298.15 K), heat -I T n dU/dT, dU/dT = u_50 + u' (SoC - 1/2)"
    source: ClassVar[str] = (
        "Bernardi, Pawlikowski & Newman 1985; -0.5 to +0.3 mV/K over cells and charge, most cells more negative "
        "towards empty"
    )
    excited_by: ClassVar[str] = "rests at the same charge and different temperatures"
    mimics: ClassVar[tuple[str, ...]] = ("core-lag", "voltage-gain", "voltage-offset", "ocv-shape")
    manoeuvre: ClassVar[str] = "read the resting voltage of one charge at two temperatures"
    drivers: ClassVar[tuple[str, ...]] = ("temperature",)

    slope: Value = parameter(
        "u_50", "mV/K", -1.2, 1.2, "dU/dT of a cell at half charge", scale=1e-3, absent=0.0, prior=(0.0, 0.25)
    )
    tilt: Value = parameter(
        "u'", "mV/K", -2.0, 2.0, "by how much dU/dT is above at full charge what it is when empty", scale=1e-3,
        default=0.0, absent=0.0, prior=(0.0, 0.5),
    )  # fmt: skip

    def heat(self, state: tuple[Value, ...], now: Instant) -> Value:
        return -now.series * self._by_kelvin(now) * now.current * now.temperature

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return now.series * self._by_kelvin(now) * (now.temperature - REFERENCE_TEMPERATURE_K)

    def _by_kelvin(self, now: Instant) -> Value:
        """dU/dT of a cell. [V/K]"""
        return self.slope + self.tilt * (now.soc - 0.5)
