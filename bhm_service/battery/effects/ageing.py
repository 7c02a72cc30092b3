"""Ageing: a worn pack holds less charge and has a higher resistance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.effects.base import Conditions, Effect
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


def _age() -> Value:
    age: Value = parameter(
        "a", "1", 0.0, 100.0, "age of the pack at this flight, in any unit; 1 now", default=1.0, per_flight=True,
        driver="age",
    )  # fmt: skip
    return age


def _settled() -> Value:
    settled: Value = parameter(
        "b", "1", 0.0, 1.0, "share of it that was there before the first of these flights", default=0.0,
        prior=(0.3, 0.3), beside="age",
    )  # fmt: skip
    return settled


@dataclass(frozen=True, slots=True, kw_only=True)
class CapacityFade(Effect):
    """Q = Q_0 (1 - k a) with a the age: cycles, days or, where it is not known, one.

    A share b of the loss may be older than all flights: k (b + (1 - b) a). A share w of it went with electrode area,
    the rest with lithium alone (Birkl et al. 2017): less area carries the whole current, so resistances grow alike.
    """

    id: ClassVar[str] = "capacity-fade"
    title: ClassVar[str] = "The pack has lost capacity"
    equation: ClassVar[str] = "Q = Q_0 (1 - k [b + (1 - b) a]), R = R_0 / (1 - w k [b + (1 - b) a])"
    source: ClassVar[str] = "cycle life of LiPo packs: 10-20 % after 200-300 cycles"
    excited_by: ClassVar[str] = "deep flights, packs of different age"
    mimics: ClassVar[tuple[str, ...]] = (
        "current-gain", "weak-cell", "self-discharge", "rate-capacity", "cold-capacity", "unseen-load",
        "current-offset",
    )  # fmt: skip
    manoeuvre: ClassVar[str] = "one flight to 15 % with a minute of rest before and after it"

    fade: Value = parameter(
        "k", "1", 0.0, 0.8, "share of the capacity lost", absent=0.0, prior=(0.10, 0.06)
    )  # fmt: skip
    area: Value = parameter(
        "w", "1", 0.0, 1.0, "share of the loss that went with electrode area", default=0.0, prior=(0.0, 0.5)
    )  # fmt: skip
    settled: Value = _settled()
    age: Value = _age()

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        lost = self.fade * (self.settled + (1.0 - self.settled) * self.age)
        area = 1.0 - self.area * lost
        return Modifiers(capacity=(1.0 - lost) / area, area=area)


@dataclass(frozen=True, slots=True, kw_only=True)
class ResistanceGrowth(Effect):
    """R = R_0 (1 + k a) in the ohmic part and in charge transfer, which both grow with age; diffusion does not.

    A share b of the growth may be older than all flights, as with the capacity.
    """

    id: ClassVar[str] = "resistance-growth"
    title: ClassVar[str] = "The pack's resistance has grown"
    equation: ClassVar[str] = "R = R_0 (1 + k [b + (1 - b) a]), ohmic and charge transfer"
    source: ClassVar[str] = "impedance over life of NASA PCoE B0005-B0018 (Re and Rct both rise); +20..100 %"
    excited_by: ClassVar[str] = "throttle steps, packs of different age"
    mimics: ClassVar[tuple[str, ...]] = (
        "resistance-temperature", "contact-resistance", "charge-transfer", "current-gain",
    )  # fmt: skip
    manoeuvre: ClassVar[str] = "fly an old and a new pack on the same day; measure at the cells and at the board"

    growth: Value = parameter(
        "k", "1", 0.0, 5.0, "share by which the resistance has grown", absent=0.0, prior=(0.4, 0.3)
    )  # fmt: skip
    settled: Value = _settled()
    age: Value = _age()

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        growth = 1.0 + self.growth * (self.settled + (1.0 - self.settled) * self.age)
        return Modifiers(resistance=growth, kinetics=1.0 / growth)
