"""Power that the flight ahead will ask for: what was flown lately, or momentum theory before anything was flown."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from bhm_service.units import STANDARD_GRAVITY

AIR_DENSITY = 1.225  # [kg/m^3] standard atmosphere at sea level
_GAS_AIR = 287.05  # [J/(kg K)]
_SETTLED_S = 10.0  # of flight before anything is expected
_MINUTE_S = 60.0  # of flight whose mean is held against what was expected when it began
_MEMORY_S = 3600.0  # of flight after which it counts less how steady the load was: other work, another pilot
_UNFLOWN = 0.10  # of the mean: how far a flight ahead departs from it where nothing is known of that
_STEADIEST = 0.033  # of the mean: nor is a load that never departed certain to go on


def air_density(pressure_pa: float, temperature_k: float) -> float:
    """Density of dry air. [kg/m^3]"""
    return pressure_pa / (_GAS_AIR * temperature_k)


def hover_power(
    mass_kg: float,
    rotors: int,
    rotor_radius_m: float,
    efficiency: float,
    avionics_w: float,
    density: float = AIR_DENSITY,
    tilt_rad: float = 0.0,
) -> float:
    """Electrical power to hold a multirotor in the air. [W]

    P_h = (W/N)^(3/2) / sqrt(2 rho A) per rotor, with thrust per rotor W / (N cos tilt): the vertical part of the
    thrust carries the weight (the paper's eq. (6) prints it the other way round).

    Source: NASA/TM-20230012868, eqs. (6), (7).
    """
    thrust: float = mass_kg * STANDARD_GRAVITY / (rotors * math.cos(tilt_rad))
    area = math.pi * rotor_radius_m**2
    ideal: float = rotors * thrust**1.5 / math.sqrt(2.0 * density * area)
    return ideal / efficiency + avionics_w


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """An expected load: its mean over the flight ahead, and two spreads of it. [W]"""

    mean_w: float
    mean_sd_w: float  # of that mean: how far a whole flight ahead may differ
    instant_sd_w: float  # of the power from second to second


@dataclass(frozen=True, slots=True, kw_only=True)
class RecentLoad:
    """Running statistics of the power in flight, forgotten with ``window_s``; how steady it is, with an hour."""

    window_s: float
    weight_s: float = 0.0  # time that mean and square rest on, forgotten
    mean_w: float = 0.0
    square: float = 0.0  # [W^2] mean squared deviation from the running mean
    expected_w: float = 0.0  # what the running mean was when the minute began that is being flown; 0: none has begun
    minute_s: float = 0.0  # time in that minute
    minute_w: float = 0.0  # its mean
    minutes: float = 0.0  # full ones, forgotten
    departed: float = 0.0  # sum of their squared departures from what was expected, as fractions of it, forgotten

    def add(self, power_w: float, dt: float) -> RecentLoad:
        """The statistics with ``dt`` seconds of ``power_w`` more."""
        dt = min(dt, _SETTLED_S)
        if dt <= 0.0 or not math.isfinite(power_w):
            return self
        keep = math.exp(-dt / self.window_s)
        weight = keep * self.weight_s + dt
        deviation = power_w - self.mean_w
        mean = self.mean_w + deviation * dt / weight
        square = (keep * self.weight_s * self.square + dt * deviation * (power_w - mean)) / weight
        return replace(self, weight_s=weight, mean_w=mean, square=square)._minute(power_w, dt)

    def _minute(self, power_w: float, dt: float) -> RecentLoad:
        if self.expected_w <= 0.0:
            return replace(self, expected_w=self.mean_w) if self.weight_s >= _SETTLED_S else self
        minute_s = self.minute_s + dt
        minute_w = self.minute_w + (power_w - self.minute_w) * dt / minute_s
        if minute_s < _MINUTE_S:
            return replace(self, minute_s=minute_s, minute_w=minute_w)
        forget = math.exp(-minute_s / _MEMORY_S)
        return replace(
            self,
            expected_w=self.mean_w,
            minute_s=0.0,
            minute_w=0.0,
            minutes=forget * self.minutes + 1.0,
            departed=forget * self.departed + (minute_w / self.expected_w - 1.0) ** 2,
        )

    def load(self) -> Load | None:
        """What to expect from here on; None before ten seconds of flight.

        The flight ahead may ask for more or less by as much as the minutes flown have departed from what was expected
        when they began, and by a tenth as far as one minute's word goes. Flights of phases (90 recorded ones of three
        Matrice 100) go on departing by a tenth however long they last, a steady hover by less and less.
        """
        if self.weight_s < _SETTLED_S:
            return None
        departure = math.sqrt((_UNFLOWN**2 + self.departed) / (1.0 + self.minutes))
        return Load(
            mean_w=self.mean_w,
            mean_sd_w=max(departure, _STEADIEST) * self.mean_w,
            instant_sd_w=math.sqrt(max(self.square, 0.0)),
        )
