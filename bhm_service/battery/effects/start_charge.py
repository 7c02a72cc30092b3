"""The charge at the start is not what was assumed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.effects.base import Effect
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value

_DAY_S = 86400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PartialCharge(Effect):
    """SoC_0 = SoC_assumed - d, another d in each flight. A filter reads its start off the voltage instead."""

    id: ClassVar[str] = "partial-charge"
    title: ClassVar[str] = "Flights start with less charge than assumed"
    equation: ClassVar[str] = "SoC_0 = SoC_assumed - d"
    source: ClassVar[str] = "interrupted charges and storage modes: 2-15 %"
    excited_by: ClassVar[str] = "any flight, from its first second"
    mimics: ClassVar[tuple[str, ...]] = ("self-discharge", "hysteresis", "voltage-offset", "ocv-shape")
    manoeuvre: ClassVar[str] = "a minute of rest before arming"

    deficit: Value = parameter(
        "d", "1", -0.2, 0.9, "missing share of a full charge", absent=0.0, prior=(0.0, 0.08), per_flight=True
    )

    def initial_soc(self, soc: Value) -> Value:
        return soc - self.deficit


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfDischarge(Effect):
    """SoC_0 = SoC_assumed - k days since the charge."""

    id: ClassVar[str] = "self-discharge"
    title: ClassVar[str] = "Charge is lost in storage"
    equation: ClassVar[str] = "SoC_0 = SoC_assumed - k days"
    source: ClassVar[str] = "LiPo 1-3 %/month; smart packs go to 60 % in 3-10 days"
    excited_by: ClassVar[str] = "flights after different times in storage"
    mimics: ClassVar[tuple[str, ...]] = ("partial-charge", "capacity-fade")
    manoeuvre: ClassVar[str] = "note the date of the charge; fly one pack fresh and one a week later"
    drivers: ClassVar[tuple[str, ...]] = ("storage",)

    rate: Value = parameter(
        "k", "%/day", 0.0, 10.0, "charge lost per day", scale=0.01 / _DAY_S, absent=0.0, prior=(0.2, 0.2)
    )
    storage: Value = parameter(
        "days", "day", 0.0, 3650.0, "since the charge", scale=_DAY_S, per_flight=True, driver="storage", default=0.0
    )

    def initial_soc(self, soc: Value) -> Value:
        return soc - self.rate * self.storage
