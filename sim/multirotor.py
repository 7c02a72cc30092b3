"""The simulated multirotor: a plan of phases, gusts, and the power that both ask for."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

from sim.battery import SimulatedPack

_DT = 0.1


@dataclass(frozen=True, slots=True)
class Phase:
    """A piece of the plan."""

    seconds: float
    power_w: float  # mean; 0 on the ground
    climb_mps: float = 0.0
    speed_mps: float = 0.0


@dataclass(frozen=True, slots=True)
class State:
    """What the vehicle's sensors would see."""

    time_s: float
    armed: bool
    airborne: bool
    voltage_v: float
    current_a: float
    consumed_ah: float
    height_m: float
    climb_mps: float
    speed_mps: float


def hover_plan(hover_w: float, flight_s: float, ground_s: float = 5.0) -> tuple[Phase, ...]:
    """Wait, climb, hover and cruise in turns, come down, wait."""
    cruise = max(flight_s - 24.0, 0.0)
    legs: list[Phase] = []
    while cruise > 0.0:
        part = min(cruise, 45.0)
        moving = len(legs) % 2 == 1
        legs.append(Phase(part, hover_w * (0.94 if moving else 1.0), 0.0, 7.0 if moving else 0.0))
        cruise -= part
    return (
        Phase(ground_s, 0.0),
        Phase(8.0, 1.25 * hover_w, 2.0),
        *legs,
        Phase(16.0, 0.92 * hover_w, -1.0),
        Phase(20.0, 0.0),
    )


class Multirotor:
    """Flies a plan with a pack; `states` yields what is seen once a second."""

    def __init__(self, pack: SimulatedPack, plan: Sequence[Phase], seed: int, avionics_w: float = 8.0) -> None:
        self.pack = pack
        self._plan = plan
        self._random = random.Random(seed)
        self._avionics_w = avionics_w
        self._gust = 0.0
        self._time_s = 0.0
        self._height_m = 0.0
        self._consumed_ah = 0.0

    def second(self) -> State | None:
        """The next second; None when the plan is at its end."""
        phase = self._phase()
        if phase is None:
            return None
        volts = amps = 0.0
        for _ in range(round(1.0 / _DT)):
            # Gusts: an Ornstein-Uhlenbeck process, 6 % of the power, forgotten in 3 s.
            self._gust += -self._gust * _DT / 3.0 + 0.06 * math.sqrt(2.0 * _DT / 3.0) * self._random.gauss(0.0, 1.0)
            flying = phase.power_w > 0.0
            power = self._avionics_w + (phase.power_w * (1.0 + self._gust) if flying else 0.0)
            volts, amps = self.pack.step(power, _DT)
            self._consumed_ah += amps * _DT / 3600.0
            self._height_m = max(self._height_m + phase.climb_mps * _DT, 0.0)
        self._time_s += 1.0
        return State(
            time_s=self._time_s,
            armed=phase.power_w > 0.0,
            airborne=phase.power_w > 0.0,
            voltage_v=volts + self._random.gauss(0.0, 0.010),
            current_a=max(amps + self._random.gauss(0.0, 0.05), 0.0),
            consumed_ah=self._consumed_ah,
            height_m=self._height_m,
            climb_mps=phase.climb_mps,
            speed_mps=phase.speed_mps,
        )

    def _phase(self) -> Phase | None:
        at = 0.0
        for phase in self._plan:
            at += phase.seconds
            if self._time_s < at:
                return phase
        return None
