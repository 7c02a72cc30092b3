"""Slow diffusion: a second resistor and capacitor behind the cell model's own, building up over minutes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Conditions, Effect, Instant, Interval
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowDiffusion(Effect):
    """tau dV_2/dt = R_2 i - V_2, taken from the cell's voltage; both grow as diffusion slows down.

    Or it is the cell's own diffusion that is slower than in the lab (never faster, at one temperature): in Chem's
    particles, in other pairs of this kind, in the lag at the surface, and in Circ's own pair, which takes half of it.
    """

    id: ClassVar[str] = "slow-diffusion"
    title: ClassVar[str] = "Slow diffusion"
    equation: ClassVar[str] = "tau_2 dV_2/dt = R_2 i - V_2; diffusion times of the cell s times the lab's"
    source: ClassVar[str] = "second pair of equivalent circuits; diffusion of Daigle & Kulkarni 2013"
    excited_by: ClassVar[str] = "minutes of steady load, and the rest after landing"
    mimics: ClassVar[tuple[str, ...]] = ("hysteresis", "ocv-shape", "self-heating")
    manoeuvre: ClassVar[str] = "keep recording for 5-10 min of rest after landing"
    state_names: ClassVar[tuple[str, ...]] = ("slow_v",)
    repeats: ClassVar[bool] = True

    resistance: Value = parameter(
        "R_2", "ohm", 0.0, 1.0, "resistance of the slow pair, of a cell", absent=0.0, prior=(8e-4, 5e-4),
        source="2-10 mOhm of a 6S pack",
    )  # fmt: skip
    time_constant: Value = parameter(
        "tau_2", "s", 10.0, 2e4, "its time constant", prior=(300.0, 150.0), source="100-600 s"
    )
    slowing: Value = parameter(
        "s", "1", 1.0, 20.0, "diffusion time over that of the lab", default=1.0, absent=1.0, prior=(1.0, 0.4)
    )  # fmt: skip

    def start(self) -> tuple[Value, ...]:
        return (0.0,)

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        return Modifiers(diffusion=1.0 / self.slowing)

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        resistance = self.resistance / interval.by.diffusion
        tau = self.time_constant / interval.by.diffusion
        return (solver.lag(start[0], resistance * interval.begin, resistance * interval.end, tau),)

    def heat(self, state: tuple[Value, ...], now: Instant) -> Value:
        return now.series * now.current * state[0]

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return -now.series * state[0]
