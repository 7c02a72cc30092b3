"""The voltage that is read is not the pack's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.effects.base import Effect
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class VoltageGain(Effect):
    """V_m = (1 + g) V."""

    id: ClassVar[str] = "voltage-gain"
    title: ClassVar[str] = "The voltage sensor's scale is off"
    equation: ClassVar[str] = "V_m = (1 + g) V"
    source: ClassVar[str] = "voltage dividers of power modules: 0.5-2 %"
    excited_by: ClassVar[str] = "flights from full to low charge"
    mimics: ClassVar[tuple[str, ...]] = ("voltage-offset", "entropic-voltage")
    manoeuvre: ClassVar[str] = "a multimeter at full charge and at storage charge"

    gain: Value = parameter("g", "1", -0.2, 0.2, "error of the scale", absent=0.0, prior=(0.0, 0.01))

    def measured_voltage(self, voltage: Value) -> Value:
        return (1.0 + self.gain) * voltage


@dataclass(frozen=True, slots=True, kw_only=True)
class VoltageOffset(Effect):
    """V_m = V + b."""

    id: ClassVar[str] = "voltage-offset"
    title: ClassVar[str] = "The voltage sensor's zero is off"
    equation: ClassVar[str] = "V_m = V + b"
    source: ClassVar[str] = "power modules and ground loops: 20-200 mV"
    excited_by: ClassVar[str] = "any recording, rests included"
    mimics: ClassVar[tuple[str, ...]] = ("voltage-gain", "hysteresis", "partial-charge", "entropic-voltage")
    manoeuvre: ClassVar[str] = "a multimeter at full charge and at storage charge"

    offset: Value = parameter("b", "V", -2.0, 2.0, "what the reading is too high", absent=0.0, prior=(0.0, 0.1))

    def measured_voltage(self, voltage: Value) -> Value:
        return voltage + self.offset
