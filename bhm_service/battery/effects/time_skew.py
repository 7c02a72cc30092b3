"""Time skew: voltage and current of one sample are not of one instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Instant, Interval, Spread
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value

_TAU_S = 1.0  # over which the current's slope is taken


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeSkew(Effect):
    """The ohmic drop is that of I(t + s) = I + (s / tau)(I - lag of I), tau = 1 s; s < 0 where the voltage lags behind.

    Along whole recordings, where the current of every other instant is known, all of the drop is that of I(t + s).
    """

    id: ClassVar[str] = "time-skew"
    title: ClassVar[str] = "Voltage and current are not of one instant"
    equation: ClassVar[str] = "dV = -R_ohm (s / tau)(I - I_lag), tau dI_lag/dt = I - I_lag"
    source: ClassVar[str] = "filters and sampling of autopilots: 0.1-2 s"
    excited_by: ClassVar[str] = "throttle steps and gusts"
    manoeuvre: ClassVar[str] = "record ten samples a second over a few throttle steps"
    state_names: ClassVar[tuple[str, ...]] = ("lagged_current",)

    skew: Value = parameter(
        "s", "s", -3.0, 3.0, "by how much the voltage is ahead of the current", absent=0.0, prior=(0.0, 0.5)
    )

    def start(self) -> tuple[Value, ...]:
        return (0.0,)

    def spread(self) -> tuple[Spread, ...]:
        return (Spread(0.1, 1e-3),)

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        return (solver.lag(start[0], interval.begin, interval.end, _TAU_S),)

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return self._ohm(now) * now.parallel * state[0]

    def series_resistance(self, state: tuple[Value, ...], now: Instant) -> Value:
        return self._ohm(now)

    def _ohm(self, now: Instant) -> Value:
        return (self.skew / _TAU_S) * now.series * now.cell.ohmic_resistance(now.by) / now.parallel
