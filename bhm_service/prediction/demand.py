"""Power that the flight ahead will ask for: what was flown lately, or momentum theory before anything was flown."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from bhm_service.units import STANDARD_GRAVITY

AIR_DENSITY = 1.225  # [kg/m^3] standard atmosphere at sea level
_GAS_AIR = 287.05  # [J/(kg K)]
_BLOCK_S = 10.0  # power is averaged over blocks this long before its spread is taken


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
    """Running statistics of the power in flight, forgotten with ``window_s``."""

    window_s: float
    weight_s: float = 0.0  # time that the statistics rest on, forgotten likewise
    mean_w: float = 0.0
    square: float = 0.0  # [W^2] mean squared deviation from the running mean
    block_s: float = 0.0  # time in the block that is being filled
    block_w: float = 0.0  # its mean
    block_square: float = 0.0  # [W^2] mean squared deviation of full blocks
    blocks: float = 0.0

    def add(self, power_w: float, dt: float) -> RecentLoad:
        """The statistics with ``dt`` seconds of ``power_w`` more."""
        dt = min(dt, _BLOCK_S)
        if dt <= 0.0 or not math.isfinite(power_w):
            return self
        keep = math.exp(-dt / self.window_s)
        weight = keep * self.weight_s + dt
        deviation = power_w - self.mean_w
        mean = self.mean_w + deviation * dt / weight
        square = (keep * self.weight_s * self.square + dt * deviation * (power_w - mean)) / weight
        block_s = self.block_s + dt
        block_w = self.block_w + (power_w - self.block_w) * dt / block_s
        full = replace(self, weight_s=weight, mean_w=mean, square=square, block_s=block_s, block_w=block_w)
        if block_s < _BLOCK_S:
            return full
        forget = math.exp(-block_s / self.window_s)
        blocks = forget * self.blocks + 1.0
        off = block_w - mean
        return replace(
            full,
            block_s=0.0,
            block_w=0.0,
            blocks=blocks,
            block_square=(forget * self.blocks * self.block_square + off * off) / blocks,
        )

    def load(self) -> Load | None:
        """What to expect from here on; None before ten seconds of flight."""
        if self.weight_s < _BLOCK_S:
            return None
        # The mean of what was flown, as uncertain as its blocks leave it; and flights are not stationary: what lies
        # ahead may ask for more or less by a tenth at first, by a thirtieth after long experience.
        spread = math.sqrt(self.block_square / self.blocks) if self.blocks >= 2.0 else 0.0
        unseen = max(0.10 / math.sqrt(1.0 + self.weight_s / 60.0), 0.033) * self.mean_w
        return Load(
            mean_w=self.mean_w,
            mean_sd_w=math.hypot(spread, unseen),
            instant_sd_w=math.sqrt(max(self.square, 0.0)),
        )
