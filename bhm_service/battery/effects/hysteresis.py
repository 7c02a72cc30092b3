"""Hysteresis: after a charge the open-circuit voltage is another one than after a discharge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Instant, Interval, Spread
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value

_AT_REST_A = 1e-9  # a current too small to move anything, so that a rest is no division by zero


@dataclass(frozen=True, slots=True, kw_only=True)
class Hysteresis(Effect):
    """dV = -M h with dh/dt = abs(i) / (g Q) (sign(i) - h): a lag in charge, not in time."""

    id: ClassVar[str] = "hysteresis"
    title: ClassVar[str] = "Voltage remembers charging"
    equation: ClassVar[str] = "dV = -n M h, dh/dt = abs(i) / (g Q) (sign(i) - h)"
    source: ClassVar[str] = "one-state hysteresis, Plett 2004; 5-30 mV a cell, LFP 20-50"
    excited_by: ClassVar[str] = "the first 5-10 % of charge after charging; regenerative descents"
    mimics: ClassVar[tuple[str, ...]] = ("slow-diffusion", "voltage-offset", "ocv-shape", "partial-charge")
    manoeuvre: ClassVar[str] = "start once from a partial charge and once from a partial discharge to the same level"
    state_names: ClassVar[tuple[str, ...]] = ("hysteresis",)

    amplitude: Value = parameter(
        "M", "mV", 0.0, 100.0, "half the distance of the branches, of a cell", scale=1e-3, absent=0.0, prior=(15.0, 8.0)
    )
    reach: Value = parameter(
        "g", "1", 0.005, 0.5, "share of the capacity that it takes to change branches", default=0.05, prior=(0.05, 0.02)
    )
    begin: Value = parameter(
        "h_0", "1", -1.0, 1.0, "branch at the start: -1 after a charge, 1 after a discharge", default=-0.5,
        prior=(-0.5, 0.5),
    )  # fmt: skip

    def start(self) -> tuple[Value, ...]:
        return (self.begin,)

    def spread(self) -> tuple[Spread, ...]:
        return (Spread(0.3, 1e-4),)

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        current = 0.5 * (interval.begin + interval.end)
        branch = np.sign(current)
        tau = self.reach * interval.cell.capacity_c / np.maximum(np.abs(current), _AT_REST_A)
        return (solver.lag(start[0], branch, branch, tau),)

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return -now.series * self.amplitude * state[0]
