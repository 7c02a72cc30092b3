"""What the filter carries beside the physics: how far this pack is from its file, and how wrong the model is now.

Four slow states join the pack through the same hooks as an effect. They are not physics and have no place in a
battery file: they keep a wrong resistance, a wrong capacity or a misshapen curve from being read as lost charge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Conditions, Effect, Instant, Interval
from bhm_service.units import Value

# The error of a voltage model is mostly one of its curve's shape: it lasts while the charge stands still and is
# another one this much charge later.
ERROR_LENGTH_SOC = 0.15
ERROR_TAU_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift(Effect):
    """This pack over its file, and the model's own voltage error per cell.

    Logarithms of the ohmic resistance (mostly wiring, connectors and where the voltage is taken), of the polarisation
    (charge transfer and diffusion: age and temperature), and of the capacity.

    The voltage error is a first-order Gauss-Markov process, kept alive by the filter's process noise. Without it the
    filter takes each second's error for a new one and grows over-confident.
    """

    state_names: ClassVar[tuple[str, ...]] = (
        "log_resistance",
        "log_polarisation",
        "log_capacity",
        "voltage_error",
    )

    capacity_c: Value

    def start(self) -> tuple[Value, ...]:
        return (0.0, 0.0, 0.0, 0.0)

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        speed = np.exp(-state[1])
        return Modifiers(np.exp(state[0]), speed, speed, np.exp(state[2]))

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        current = 0.5 * (interval.begin + interval.end)
        return (*start[:3], solver.lag(start[3], 0.0, 0.0, self.error_tau(current)))

    def error_tau(self, current: Value) -> Value:
        """How long the voltage error lasts under a current. [s]"""
        return 1.0 / (np.abs(current) / (self.capacity_c * ERROR_LENGTH_SOC) + 1.0 / ERROR_TAU_S)

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return now.series * state[3]
