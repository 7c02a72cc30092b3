"""Slow diffusion: a second resistor and capacitor behind the cell model's own, building up over minutes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Instant, Interval
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowDiffusion(Effect):
    """tau dV_2/dt = R_2 i - V_2, taken from the cell's voltage; both grow as diffusion slows down."""

    id: ClassVar[str] = "slow-diffusion"
    title: ClassVar[str] = "Slow diffusion"
    equation: ClassVar[str] = "tau_2 dV_2/dt = R_2 i - V_2"
    state_names: ClassVar[tuple[str, ...]] = ("slow_v",)

    resistance: Value = parameter("R_2", "ohm", 1e-6, 1.0, "resistance of the slow pair, of a cell")
    time_constant: Value = parameter("tau_2", "s", 10.0, 2e4, "its time constant")

    def start(self) -> tuple[Value, ...]:
        return (0.0,)

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        resistance = self.resistance / interval.by.diffusion
        tau = self.time_constant / interval.by.diffusion
        return (solver.lag(start[0], resistance * interval.begin, resistance * interval.end, tau),)

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return -now.series * state[0]
