"""A weak cell: one of the cells in series runs empty before the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Instant, Interval, Spread
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class WeakCell(Effect):
    """One cell has (1 - d) of the capacity and (1 + r) of the ohmic resistance; balanced at the start.

    Its state is how far its charge is from the others'; the pack's voltage changes by U(SoC_w) - U(SoC). Where cells
    are at their curve's voltage for a charge that lags by z, its own lags by z / (1 - d).
    """

    id: ClassVar[str] = "weak-cell"
    title: ClassVar[str] = "One cell is weaker than the others"
    equation: ClassVar[str] = "dV = U(SoC_w) - U(SoC) - r R_ohm I, dSoC_w/dt = -i / (Q (1 - d))"
    source: ClassVar[str] = "imbalance of worn packs: d 8-20 %"
    excited_by: ClassVar[str] = "discharge below 20 %"
    mimics: ClassVar[tuple[str, ...]] = ("capacity-fade", "current-gain", "rate-capacity", "resistance-shape")
    manoeuvre: ClassVar[str] = "record cell voltages (BATTERY_STATUS), or hover down to 10 % once"
    shown_below: ClassVar[float] = 0.4
    state_names: ClassVar[tuple[str, ...]] = ("weak_soc",)

    loss: Value = parameter("d", "1", 0.0, 0.9, "capacity that it has lost", absent=0.0, prior=(0.12, 0.06))
    resistance: Value = parameter(
        "r", "1", 0.0, 10.0, "its ohmic resistance beyond the others'", default=0.0, absent=0.0, prior=(0.2, 0.2)
    )

    def start(self) -> tuple[Value, ...]:
        return (0.0,)

    def spread(self) -> tuple[Spread, ...]:
        return (Spread(0.005, 1e-6),)

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        sooner = -self.loss / ((1.0 - self.loss) * (interval.cell.capacity_c * interval.by.capacity))
        return (solver.counter(start[0], sooner * interval.begin, sooner * interval.end),)

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        own = now.soc + state[0] - now.curve_lag / (1.0 - self.loss)
        return now.cell.open_circuit(own) - now.cell.open_circuit(now.soc - now.curve_lag)

    def series_resistance(self, state: tuple[Value, ...], now: Instant) -> Value:
        return self.resistance * now.cell.ohmic_resistance(now.by) / now.parallel

    def odd_cell(self, state: tuple[Value, ...], now: Instant) -> Value:
        return self.extra_voltage(state, now) - self.series_resistance(state, now) * now.current
