"""Physics that the base models leave out, one file each; `KNOWN` finds them by the name used in files."""

from __future__ import annotations

from bhm_service.battery.effects.ageing import CapacityFade, ResistanceGrowth
from bhm_service.battery.effects.base import Effect
from bhm_service.battery.effects.charge_transfer import ChargeTransfer
from bhm_service.battery.effects.cold_capacity import ColdCapacity
from bhm_service.battery.effects.contact import ContactResistance, IntermittentContact
from bhm_service.battery.effects.core_lag import CoreLag
from bhm_service.battery.effects.current_sensor import CurrentGain, CurrentOffset, UnseenLoad
from bhm_service.battery.effects.double_layer import DoubleLayer
from bhm_service.battery.effects.entropic_voltage import EntropicVoltage
from bhm_service.battery.effects.full_charge import FullChargeResistance
from bhm_service.battery.effects.graphite_lag import GraphiteLag
from bhm_service.battery.effects.hysteresis import Hysteresis
from bhm_service.battery.effects.rate_capacity import RateCapacity
from bhm_service.battery.effects.resistance_temperature import ResistanceTemperature
from bhm_service.battery.effects.self_heating import SelfHeating
from bhm_service.battery.effects.shapes import OcvShape, ResistanceShape
from bhm_service.battery.effects.slow_diffusion import SlowDiffusion
from bhm_service.battery.effects.start_charge import PartialCharge, SelfDischarge
from bhm_service.battery.effects.surface_lag import SurfaceLag
from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.battery.effects.voltage_sensor import VoltageGain, VoltageOffset
from bhm_service.battery.effects.weak_cell import WeakCell

_ALL: tuple[type[Effect], ...] = (
    ResistanceTemperature, SelfHeating, CoreLag, EntropicVoltage, CapacityFade, ResistanceGrowth, ColdCapacity,
    SlowDiffusion, ChargeTransfer, Hysteresis, UnseenLoad, CurrentGain, CurrentOffset, VoltageGain, VoltageOffset,
    ContactResistance, WeakCell, PartialCharge, SelfDischarge, RateCapacity, TimeSkew, OcvShape, ResistanceShape,
    IntermittentContact,
)  # fmt: skip
EFFECTS: dict[str, type[Effect]] = {effect.id: effect for effect in _ALL}
"""What may be found missing: the catalogue."""
KNOWN: dict[str, type[Effect]] = {
    **EFFECTS, **{effect.id: effect for effect in (DoubleLayer, FullChargeResistance, GraphiteLag, SurfaceLag)},
}  # fmt: skip
"""What a battery file may hold: the catalogue, and what a lab alone adds to a cell model."""

__all__ = [
    "EFFECTS",
    "KNOWN",
    "CapacityFade",
    "ChargeTransfer",
    "ColdCapacity",
    "ContactResistance",
    "CoreLag",
    "CurrentGain",
    "CurrentOffset",
    "DoubleLayer",
    "Effect",
    "EntropicVoltage",
    "FullChargeResistance",
    "GraphiteLag",
    "Hysteresis",
    "IntermittentContact",
    "OcvShape",
    "PartialCharge",
    "RateCapacity",
    "ResistanceGrowth",
    "ResistanceShape",
    "ResistanceTemperature",
    "SelfDischarge",
    "SelfHeating",
    "SlowDiffusion",
    "SurfaceLag",
    "TimeSkew",
    "UnseenLoad",
    "VoltageGain",
    "VoltageOffset",
    "WeakCell",
]  # fmt: skip
