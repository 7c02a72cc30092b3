"""The simulated multirotor: a plan of phases, wind and gusts, the power that they ask for, and what sensors see."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

_STEPS_PER_S = 10
STEP_S = 1.0 / _STEPS_PER_S
_INDUCED_MPS = 6.0  # velocity through the rotors in the hover, of a quadrotor of two kilograms
_PARASITIC = 2.5e-4  # [s^3/m^3] of the hover power, for the body's drag


class Pack(Protocol):
    """A battery's truth."""

    def step(self, power_w: float, dt: float) -> tuple[float, float]:
        """Draw a power for a short time; terminal voltage [V] and current [A]."""
        ...


@dataclass(frozen=True, slots=True)
class Sensors:
    """How the autopilot measures: noise (one sigma), and the step of its converter (0: none)."""

    voltage_sd: float = 0.010  # [V]
    current_sd: float = 0.05  # [A]
    voltage_step: float = 0.0  # [V]
    current_step: float = 0.0  # [A]

    def read(self, volts: float, amps: float, random_: random.Random) -> tuple[float, float]:
        """What a voltage and a current look like."""
        seen_v = _stepped(volts + random_.gauss(0.0, self.voltage_sd), self.voltage_step)
        return seen_v, max(_stepped(amps + random_.gauss(0.0, self.current_sd), self.current_step), 0.0)


@dataclass(frozen=True, slots=True)
class Wind:
    """A mean wind, and gusts that come and go within seconds."""

    mean_mps: float = 0.0
    from_deg: float = 270.0
    gust_mps: float = 0.0  # one sigma
    gust_s: float = 4.0


@dataclass(frozen=True, slots=True)
class Reading:
    """What is seen of one pack."""

    voltage_v: float
    current_a: float
    consumed_ah: float


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
    item: int = 0  # of the plan
    distance_m: float = 0.0  # flown, over ground
    wind_mps: float = 0.0
    wind_from_deg: float = 0.0
    other: Reading | None = None  # of a second pack, where there is one


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
    """Flies a plan with one pack, or with two side by side that share the load."""

    def __init__(
        self,
        pack: Pack,
        plan: Sequence[Phase],
        seed: int,
        avionics_w: float = 8.0,
        *,
        other: Pack | None = None,
        wind: Wind | None = None,
        sensors: Sensors | None = None,
    ) -> None:
        self.pack = pack
        self.plan = tuple(plan)
        self.other_pack = other
        self._wind = wind or Wind()
        self._sensors = sensors or Sensors()
        self._random = random.Random(seed)
        self._blows = random.Random(f"wind {seed}")  # of its own, so that wind changes nothing else of a flight
        self._avionics_w = avionics_w
        self._gust = 0.0
        self._gust_mps = 0.0
        self._steps = 0
        self._height_m = 0.0
        self._distance_m = 0.0
        self._now = [(0.0, 0.0), (0.0, 0.0)]  # voltage and current of the packs
        self._consumed_ah = [0.0, 0.0]

    @property
    def time_s(self) -> float:
        """Since the vehicle was switched on."""
        return self._steps / _STEPS_PER_S

    def step(self) -> bool:
        """A tenth of a second; False when the plan is at its end."""
        index = self._index()
        if index is None:
            return False
        phase = self.plan[index]
        # Gusts: an Ornstein-Uhlenbeck process, 6 % of the power, forgotten in 3 s.
        self._gust += -self._gust * STEP_S / 3.0 + 0.06 * math.sqrt(2.0 * STEP_S / 3.0) * self._random.gauss(0.0, 1.0)
        flying = phase.power_w > 0.0
        power = self._avionics_w + (phase.power_w * (1.0 + self._gust) * self._wind_factor(phase) if flying else 0.0)
        packs = [self.pack] if self.other_pack is None else [self.pack, self.other_pack]
        for at, pack in enumerate(packs):
            self._now[at] = pack.step(power / len(packs), STEP_S)
            self._consumed_ah[at] += self._now[at][1] * STEP_S / 3600.0
        self._height_m = max(self._height_m + phase.climb_mps * STEP_S, 0.0)
        self._distance_m += phase.speed_mps * STEP_S
        self._steps += 1
        return True

    def second(self) -> State | None:
        """The next second; None when the plan is at its end."""
        if self._index() is None:
            return None
        for _ in range(_STEPS_PER_S):
            self.step()
        return self.seen()

    def seen(self) -> State:
        """What the sensors see now."""
        index = self._index(self._steps - 1)
        assert index is not None
        phase = self.plan[index]
        volts, amps = self._sensors.read(*self._now[0], self._random)
        other = None
        if self.other_pack is not None:
            other = Reading(*self._sensors.read(*self._now[1], self._random), self._consumed_ah[1])
        return State(
            time_s=self.time_s,
            armed=phase.power_w > 0.0,
            airborne=phase.power_w > 0.0,
            voltage_v=volts,
            current_a=amps,
            consumed_ah=self._consumed_ah[0],
            height_m=self._height_m,
            climb_mps=phase.climb_mps,
            speed_mps=phase.speed_mps,
            item=index,
            distance_m=self._distance_m,
            wind_mps=self._wind.mean_mps + self._gust_mps,
            wind_from_deg=self._wind.from_deg,
            other=other,
        )

    def _wind_factor(self, phase: Phase) -> float:
        """Power in this wind over that in still air; the vehicle flies east and holds its speed over ground."""
        wind = self._wind
        if wind.mean_mps == 0.0 and wind.gust_mps == 0.0:
            return 1.0
        fade = STEP_S / wind.gust_s
        self._gust_mps += -self._gust_mps * fade + wind.gust_mps * math.sqrt(2.0 * fade) * self._blows.gauss(0.0, 1.0)
        speed, comes_from = wind.mean_mps + self._gust_mps, math.radians(wind.from_deg)
        air = math.hypot(phase.speed_mps + speed * math.sin(comes_from), speed * math.cos(comes_from))
        return _relative_power(air) / _relative_power(phase.speed_mps)

    def _index(self, steps: int | None = None) -> int | None:
        now, at = (self._steps if steps is None else steps) / _STEPS_PER_S, 0.0
        for index, phase in enumerate(self.plan):
            at += phase.seconds
            if now < at:
                return index
        return None


def _relative_power(air_mps: float) -> float:
    """Power of a multirotor that moves through the air, over that of the hover: momentum theory and drag."""
    x = (air_mps / _INDUCED_MPS) ** 2
    induced = math.sqrt(math.sqrt(0.25 * x * x + 1.0) - 0.5 * x)
    return 0.75 * induced + 0.25 + _PARASITIC * air_mps**3


def _stepped(value: float, step: float) -> float:
    return round(value / step) * step if step > 0.0 else value
