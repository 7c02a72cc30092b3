"""How well a battery file describes a pack before its first sample, per cell and in standard deviations."""

from __future__ import annotations

from dataclasses import dataclass

from bhm_service.battery.parameters import parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """The defaults are those of a pack that was identified itself; a generic cell knows less and says so."""

    voltage_error_v: float = parameter("-", "V", 1e-4, 0.2, "lasting error of the voltage model", default=0.010)
    resistance: float = parameter(
        "-", "1", 0.0, 2.0, "of the logarithm of the ohmic resistance, wiring included", default=0.2
    )
    polarisation: float = parameter(
        "-", "1", 0.0, 2.0, "of the logarithm of charge transfer and diffusion resistance", default=0.2
    )
    capacity: float = parameter("-", "1", 0.0, 0.5, "of the logarithm of the capacity", default=0.03)
