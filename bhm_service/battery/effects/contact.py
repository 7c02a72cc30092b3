"""Contacts and wires: resistance outside the cells, lasting or come and gone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Instant, Interval, Spread
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value

_EDGE_S = 1.0  # in which a contact goes bad: as sharp as recordings once a second can tell


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactResistance(Effect):
    """dV = -R_w I: wires and connectors, which neither temperature nor charge changes and which do not heat cells."""

    id: ClassVar[str] = "contact-resistance"
    title: ClassVar[str] = "More resistance in wires and connectors"
    equation: ClassVar[str] = "dV = -R_w I"
    source: ClassVar[str] = "12 AWG 5.2 mOhm/m; worn connectors 1-6 mOhm"
    excited_by: ClassVar[str] = "throttle steps"
    mimics: ClassVar[tuple[str, ...]] = (
        "resistance-growth", "resistance-temperature", "charge-transfer", "intermittent-contact",
    )  # fmt: skip
    manoeuvre: ClassVar[str] = "measure the voltage at the pack and at the board in one hover"

    resistance: Value = parameter(
        "R_w", "mohm", 0.0, 500.0, "beside that of the lab's wiring", scale=1e-3, absent=0.0, prior=(4.0, 4.0)
    )
    present: Value = parameter(
        "p", "1", 0.0, 1.0, "whether it is there in this flight", default=1.0, per_flight=True, driver="onset"
    )

    def series_resistance(self, state: tuple[Value, ...], now: Instant) -> Value:
        return self.resistance * self.present


@dataclass(frozen=True, slots=True, kw_only=True)
class IntermittentContact(Effect):
    """dV = -R_w I between two times of a flight, counted from its first sample.

    Nobody knows when a contact will fail next. So its times belong to a recording, several of these effects are
    several episodes, and a battery file carries it without times: the filter and the predictor then know of it and
    leave it out, and what happens in flight is the filter's drifting resistance.
    """

    id: ClassVar[str] = "intermittent-contact"
    title: ClassVar[str] = "A contact that comes and goes"
    equation: ClassVar[str] = "dV = -R_w I for t_1 < t < t_2"
    source: ClassVar[str] = "loose bullet connectors and cell tabs: 2-10 mOhm"
    excited_by: ClassVar[str] = "the fault itself, under load"
    mimics: ClassVar[tuple[str, ...]] = ("contact-resistance",)
    manoeuvre: ClassVar[str] = "wiggle the connectors at a steady hover throttle, vehicle tied down; inspect them"
    state_names: ClassVar[tuple[str, ...]] = ("clock",)

    resistance: Value = parameter(
        "R_w", "mohm", 0.0, 500.0, "of the bad contact", scale=1e-3, absent=0.0, prior=(6.0, 5.0)
    )
    begin: Value = parameter("t_1", "s", 0.0, 1e6, "when it goes bad", per_flight=True, default=0.0)
    end: Value = parameter("t_2", "s", 0.0, 1e6, "when it is good again", per_flight=True, default=0.0)

    def start(self) -> tuple[Value, ...]:
        return (0.0,)

    def spread(self) -> tuple[Spread, ...]:
        return (Spread(1e-3, 1e-6),)

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        return (solver.counter(start[0], 1.0, 1.0),)

    def series_resistance(self, state: tuple[Value, ...], now: Instant) -> Value:
        inside = np.minimum(state[0] - self.begin, self.end - state[0])
        return self.resistance * np.minimum(np.maximum(inside / _EDGE_S, 0.0), 1.0)
