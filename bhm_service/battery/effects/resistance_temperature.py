"""Resistance follows temperature: Arrhenius on the ohmic drop, on charge transfer and on diffusion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.effects.base import Conditions, Effect
from bhm_service.battery.parameters import parameter
from bhm_service.units import GAS_CONSTANT, REFERENCE_TEMPERATURE_K, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class ResistanceTemperature(Effect):
    """R = R_25 exp[E_a / R_g (1/T - 1/298.15 K)], and the speeds of kinetics and diffusion by its inverse.

    One activation energy for all three: pulse tests on real cells give 19-26 kJ/mol for the resistance as a whole
    (Panasonic 18650PF, hobby LiPo), and recordings of flights cannot tell them apart.
    """

    id: ClassVar[str] = "resistance-temperature"
    title: ClassVar[str] = "Resistance follows temperature"
    equation: ClassVar[str] = "R = R_25 exp[E_a / R_g (1/T - 1/298.15 K)]"
    source: ClassVar[str] = "pulse tests on Panasonic 18650PF (19.7-25 kJ/mol) and hobby LiPo (26)"
    excited_by: ClassVar[str] = "starts at different temperatures; a pack that warms up in flight"
    mimics: ClassVar[tuple[str, ...]] = (
        "resistance-growth", "contact-resistance", "cold-capacity", "charge-transfer", "rate-capacity",
    )  # fmt: skip
    manoeuvre: ClassVar[str] = "one flight with the pack soaked cold and one with it warm, same load"
    drivers: ClassVar[tuple[str, ...]] = ("temperature",)

    activation_energy: Value = parameter(
        "E_a", "kJ/mol", 0.0, 80.0, "activation energy of the resistance", scale=1000.0, absent=0.0,
        prior=(22.0, 6.0), source="15-35 kJ/mol over lithium-ion cells",
    )  # fmt: skip

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        arrhenius = self.activation_energy / GAS_CONSTANT * (1.0 / at.temperature - 1.0 / REFERENCE_TEMPERATURE_K)
        growth = np.exp(arrhenius)
        speed = 1.0 / growth
        return Modifiers(resistance=growth, kinetics=speed, diffusion=speed)
