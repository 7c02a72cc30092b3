"""Physics that the base models leave out, one file each; `EFFECTS` finds them by the name used in files."""

from __future__ import annotations

from bhm_service.battery.effects.base import Effect
from bhm_service.battery.effects.resistance_temperature import ResistanceTemperature
from bhm_service.battery.effects.slow_diffusion import SlowDiffusion

EFFECTS: dict[str, type[Effect]] = {effect.id: effect for effect in (ResistanceTemperature, SlowDiffusion)}

__all__ = ["EFFECTS", "Effect", "ResistanceTemperature", "SlowDiffusion"]
