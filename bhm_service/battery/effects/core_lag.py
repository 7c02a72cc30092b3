"""Core lag: under load cells are warmer inside than where the sensor sits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Interval, Spread
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class CoreLag(Effect):
    """T_core = T_surface + dT with tau d(dT)/dt = R_th losses - dT."""

    id: ClassVar[str] = "core-lag"
    title: ClassVar[str] = "The core is warmer than the sensor"
    equation: ClassVar[str] = "T_core = T_surface + dT, tau d(dT)/dt = R_th losses - dT"
    source: ClassVar[str] = "two-node heat balance of pouch packs; 0.1-0.4 K/W, 200-400 s"
    excited_by: ClassVar[str] = "load steps over minutes, with temperature recorded"
    mimics: ClassVar[tuple[str, ...]] = ("self-heating", "entropic-voltage", "charge-transfer")
    manoeuvre: ClassVar[str] = "ten minutes at a high load, then at a low one, temperature recorded"
    drivers: ClassVar[tuple[str, ...]] = ("temperature",)
    shown_by: ClassVar[tuple[str, ...]] = ("resistance-temperature", "cold-capacity", "entropic-voltage")
    state_names: ClassVar[tuple[str, ...]] = ("core_rise",)
    feedback: ClassVar[bool] = True

    thermal_resistance: Value = parameter(
        "R_th", "K/W", 0.0, 5.0, "from core to surface, of the pack", absent=0.0, prior=(0.25, 0.1),
        source="0.1-0.4 K/W at 2 kg",
    )  # fmt: skip
    time_constant: Value = parameter(
        "tau", "s", 20.0, 3000.0, "how long the core takes", default=300.0, prior=(300.0, 60.0)
    )

    def start(self) -> tuple[Value, ...]:
        return (0.0,)

    def spread(self) -> tuple[Spread, ...]:
        return (Spread(1.0, 0.01),)

    def temperature_rise(self, state: tuple[Value, ...]) -> Value:
        return state[0]

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        settled = self.thermal_resistance * interval.losses
        return (solver.lag(start[0], settled, settled, self.time_constant),)
