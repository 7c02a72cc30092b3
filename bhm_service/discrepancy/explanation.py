"""What an explanation holds: everything that the report, `findings.json` and the repaired battery are made from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from bhm_service.battery.battery_file import BatteryFile
from bhm_service.discrepancy.bent_curve import BentCurve
from bhm_service.discrepancy.bent_lab import BentLab
from bhm_service.discrepancy.candidate import NotExcited
from bhm_service.discrepancy.changed_lag import ChangedLag
from bhm_service.discrepancy.confirm import HeldOut
from bhm_service.discrepancy.demand_findings import joined_findings
from bhm_service.discrepancy.demand_side import DemandSide, NotLooked
from bhm_service.discrepancy.findings import Findings
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.flights import FlightData, LeftOut
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.locate import Map
from bhm_service.discrepancy.patterns import Pattern
from bhm_service.discrepancy.recurring import Recurring
from bhm_service.discrepancy.search import Search
from bhm_service.discrepancy.selection import Selection
from bhm_service.units import Array

Left: TypeAlias = Pattern | Recurring | ChangedLag | BentCurve | BentLab
"""What an explanation leaves that no effect of the catalogue has: described, never called physics."""


@dataclass(frozen=True, slots=True)
class Course:
    """One flight: measured and modelled voltages and the states behind them; all (T,)."""

    flight: FlightData
    before_v: Array  # by the battery as it is
    after_v: Array  # by the explanation
    soc: Array
    hidden: dict[str, tuple[Array, Array]] = field(default_factory=dict)  # inferred states: course and sd


@dataclass(frozen=True, slots=True)
class Flying:
    """What the explanation changes for the time to 20 % of charge at this flight's mean load. [s]"""

    flight: str
    before_s: float
    after_s: float


@dataclass(frozen=True, slots=True)
class Contest:
    """One phantom driver against the true one."""

    decoy: str
    nats: float  # evidence of the true driver beyond the phantom's
    beaten: bool
    rival: Fitted[Joint] | None = None  # the set with the phantom
    driver: Callable[[FlightData], Array] | None = None  # the phantom's temperature on a flight to come [K]


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """The whole of it."""

    lab: Lab
    battery: BatteryFile
    repaired: BatteryFile | None
    courses: Sequence[Course]
    left_out: Sequence[LeftOut]
    search: Search
    selection: Selection
    held_out: HeldOut | None
    maps: Sequence[Map]
    contests: Sequence[Contest]
    not_excited: Sequence[NotExcited]
    flying: Sequence[Flying]
    sentence: str  # the verdict in one sentence, for a flight engineer
    in_words: Sequence[str]  # each effect's size in words
    findings: Findings  # of the battery's side
    demand: DemandSide | NotLooked = NotLooked("no vehicle file was given (--vehicle)")

    @property
    def joined(self) -> Findings:
        """What both sides found."""
        return joined_findings(self.findings, self.demand)
