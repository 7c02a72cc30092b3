"""Charge transfer through the double layer: a drop that follows a step of the load within seconds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.alike import once
from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Instant, Interval
from bhm_service.battery.parameters import parameter
from bhm_service.units import FARADAY, GAS_CONSTANT, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class DoubleLayer(Effect):
    """tau dV_dl/dt = (2 R_g T / F) asinh(i / 2 i_0) - V_dl, taken from the cell's voltage: Butler-Volmer with a lag.

    Circ has one pair, which is taken by what lasts for a minute, and no drop that bends with the current.

    Its lag is its capacitance times 2 R_g T / F / sqrt(i^2 + 4 i_0^2): under the loads that matter, above 2 i_0, it
    stays the same however fast charge transfer is.

    A part of a lab's model of a cell: no candidate of what is missing in flight.
    """

    id: ClassVar[str] = "double-layer"
    title: ClassVar[str] = "Charge transfer behind the double layer"
    equation: ClassVar[str] = "tau_dl dV_dl/dt = (2 R_g T / F) asinh(i / 2 i_0) - V_dl"
    source: ClassVar[str] = "Butler-Volmer with equal coefficients, as in Daigle & Kulkarni 2013; 0.05-2 s"
    excited_by: ClassVar[str] = "steps of the load, logged once a second or faster; loads from a half to four C"
    state_names: ClassVar[tuple[str, ...]] = ("double_layer_v",)

    exchange_current: Value = parameter("i_0", "A", 1e-3, 1e5, "of a cell")
    time_constant: Value = parameter("tau_dl", "s", 0.01, 100.0, "its time constant under load")

    def start(self) -> tuple[Value, ...]:
        return (0.0,)

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        speed = interval.by.kinetics * interval.by.transfer
        thermal = 2.0 * GAS_CONSTANT / FARADAY * interval.temperature
        per_ampere = 0.5 / (self.exchange_current * speed)
        begin, end = (thermal * once(np.arcsinh, per_ampere * i) for i in (interval.begin, interval.end))
        return (solver.lag(start[0], begin, end, self.time_constant),)

    def heat(self, state: tuple[Value, ...], now: Instant) -> Value:
        return now.series * now.current * state[0]

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return -now.series * state[0]
