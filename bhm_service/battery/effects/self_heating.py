"""Self-heating: the pack's temperature as a state, where no sensor tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Interval, Spread
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value

_WH_PER_KG = 160.0  # of a drone pack with its wrapping
_SPECIFIC_HEAT = 1000.0  # [J/(kg K)] of a LiPo pouch, 900-1100
# [W/K] of a pack of two kilograms, on a tenth of a square metre: 8 in the propellers' wash (80 W/m2/K), 1 in still air
# (10 with its radiation), 0.5 in a bay with foam around it. A fit knows its logarithm: a standard deviation of as much
# as itself is a factor of two, two of them are one of four.
_CONDUCTANCE, _CONDUCTANCE_SD = 2.0, 1.0
_USUAL_KG = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfHeating(Effect):
    """C dT/dt = losses - hA (T - T_ambient); carries temperature, feeds back through whatever depends on it.

    The ambient and what the pack is warmer at the start are unknowns of each flight, so the states are the ambient,
    which stays, and what the pack is warmer than it: a filter that knows neither knows that they hang together.
    Where the pack's temperature is measured the measurement is used, and what these states say is a prediction of it.
    """

    id: ClassVar[str] = "self-heating"
    title: ClassVar[str] = "The pack heats itself"
    equation: ClassVar[str] = "C dT/dt = losses - hA (T - T_ambient)"
    source: ClassVar[str] = "lumped heat balance; LiPo pouches 0.9-1.1 kJ/kg/K, packs about 160 Wh/kg"
    excited_by: ClassVar[str] = "long flights at a high load, and the rest after landing"
    mimics: ClassVar[tuple[str, ...]] = ("core-lag", "resistance-shape", "slow-diffusion")
    manoeuvre: ClassVar[str] = "use the same charge at two loads; or rest 15 min on the ground, then fly on"
    supplies: ClassVar[tuple[str, ...]] = ("temperature",)
    shown_by: ClassVar[tuple[str, ...]] = ("resistance-temperature", "cold-capacity", "entropic-voltage")
    state_names: ClassVar[tuple[str, ...]] = ("ambient", "warmth")
    feedback: ClassVar[bool] = True

    heat_capacity: Value = parameter(
        "C", "J/K", 10.0, 5e4, "heat capacity of the pack", prior=(2000.0, 400.0), source="1.0 kJ/kg/K x mass"
    )
    conductance: Value = parameter(
        "hA",
        "W/K",
        0.05,
        100.0,
        "heat that it gives to the air, per kelvin",
        prior=(_CONDUCTANCE, _CONDUCTANCE_SD * _CONDUCTANCE),
        source="0.5 (closed bay) to 8 W/K (in the wash) at 2 kg",
    )
    ambient: Value = parameter(
        "T_ambient", "K", 233.0, 333.0, "temperature of the air around the pack", prior=(293.0, 10.0), per_flight=True,
        apart=5.0, source="one season's days and hours",
    )  # fmt: skip
    start_above: Value = parameter(
        "dT_0", "K", -40.0, 60.0, "what the pack is warmer than the air at the start", prior=(0.0, 4.0),
        per_flight=True, default=0.0,
    )  # fmt: skip

    @classmethod
    def priors(cls, pack_wh: float) -> dict[str, tuple[float, float]]:
        mass = pack_wh / _WH_PER_KG
        heat, loss = _SPECIFIC_HEAT * mass, _CONDUCTANCE * (mass / _USUAL_KG) ** (2.0 / 3.0)
        return super(SelfHeating, cls).priors(pack_wh) | {
            "heat_capacity": (heat, 0.2 * heat),
            "conductance": (loss, _CONDUCTANCE_SD * loss),
        }

    def start(self) -> tuple[Value, ...]:
        return (self.ambient, self.start_above)

    def spread(self) -> tuple[Spread, ...]:
        return (Spread(10.0, 0.01), Spread(4.0, 0.02))

    def cell_temperature(self, state: tuple[Value, ...]) -> Value:
        return state[0] + state[1]

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        settled = interval.losses / self.conductance
        warmth = solver.lag(start[1], settled, settled, self.heat_capacity / self.conductance)
        return (solver.counter(start[0], 0.0, 0.0), warmth)
