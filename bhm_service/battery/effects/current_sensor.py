"""The current that is read is not the one that flows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.effects.base import Effect
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenLoad(Effect):
    """I = I_m + I_p: avionics, lights or a gimbal wired ahead of the current sensor."""

    id: ClassVar[str] = "unseen-load"
    title: ClassVar[str] = "A load bypasses the current sensor"
    equation: ClassVar[str] = "I = I_m + I_p"
    source: ClassVar[str] = "avionics and payloads of multirotors: 0.3-2.5 A"
    excited_by: ClassVar[str] = "long flights"
    mimics: ClassVar[tuple[str, ...]] = ("current-offset", "capacity-fade")
    manoeuvre: ClassVar[str] = "read the current with everything but the flight controller unplugged"

    current: Value = parameter("I_p", "A", 0.0, 30.0, "current past the sensor", absent=0.0, prior=(1.2, 0.8))

    def true_current(self, measured: Value) -> Value:
        return measured + self.current


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentGain(Effect):
    """I = (1 + g) I_m."""

    id: ClassVar[str] = "current-gain"
    title: ClassVar[str] = "The current sensor's scale is off"
    equation: ClassVar[str] = "I = (1 + g) I_m"
    source: ClassVar[str] = "power modules of autopilots before calibration: 2-10 %"
    excited_by: ClassVar[str] = "any flight that uses much of the charge"
    mimics: ClassVar[tuple[str, ...]] = (
        "capacity-fade", "resistance-growth", "weak-cell", "rate-capacity", "charge-transfer",
    )  # fmt: skip
    manoeuvre: ClassVar[str] = "compare the charger's ampere-hours with the logged ones"

    gain: Value = parameter("g", "1", -0.5, 1.0, "error of the scale", absent=0.0, prior=(0.0, 0.05))

    def true_current(self, measured: Value) -> Value:
        return (1.0 + self.gain) * measured


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentOffset(Effect):
    """I = I_m + b."""

    id: ClassVar[str] = "current-offset"
    title: ClassVar[str] = "The current sensor's zero is off"
    equation: ClassVar[str] = "I = I_m + b"
    source: ClassVar[str] = "Hall and shunt power modules: 0.2-2 A"
    excited_by: ClassVar[str] = "rests before take-off and after landing; long flights"
    mimics: ClassVar[tuple[str, ...]] = ("unseen-load", "capacity-fade")
    manoeuvre: ClassVar[str] = "read the current with the pack unplugged"

    offset: Value = parameter("b", "A", -10.0, 10.0, "what is missing in the reading", absent=0.0, prior=(0.0, 0.8))

    def true_current(self, measured: Value) -> Value:
        return measured + self.offset
