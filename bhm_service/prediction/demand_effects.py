"""Physics that the power of a hover leaves out: air, mass, wind, speed, climb and wear, declared like the battery's.

Each takes a share in P = P_hover * (product of factors) * (1 + sum of shares), with P_hover the power of the rotors
in still air at sea level, avionics aside. Factors scale thrust or efficiency; shares are what the flow through the
rotors adds or saves, and they add up to Glauert's solution for climb and forward flight together.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.effects.base import Physics
from bhm_service.battery.parameters import parameter
from bhm_service.prediction.demand import AIR_DENSITY
from bhm_service.units import STANDARD_GRAVITY, Value

_NEWTON_STEPS, _CLOSE = 12, 1e-9  # each step squares the distance that is left
# Faster down than this share of the hover's induced velocity, rotors sink into their own wake: no theory holds.
_DEEPEST = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """How a multirotor moves, as numbers or arrays that broadcast; still air at sea level unless said otherwise."""

    mass_kg: float
    disc_area_m2: float  # of all rotors
    density: Value = AIR_DENSITY  # [kg/m^3]
    airspeed: Value = 0.0  # [m/s] horizontal, through the air
    climb: Value = 0.0  # [m/s] negative down

    @property
    def weight(self) -> float:
        """[N]"""
        return self.mass_kg * STANDARD_GRAVITY

    @property
    def hover_velocity(self) -> Value:
        """Induced velocity of the hover, sqrt(W / 2 rho A). [m/s]"""
        speed: Value = np.sqrt(self.weight / (2.0 * self.density * self.disc_area_m2))
        return speed


def induced_velocity(hover: Value, along: Value, through: Value = 0.0) -> Value:
    """Induced velocity of a rotor that moves (Glauert): the root of v sqrt(along^2 + (through + v)^2) = hover^2.

    Parameters
    ----------
    hover : float or array     induced velocity of the hover. [m/s]
    along : float or array     speed along the disc. [m/s]
    through : float or array   speed through the disc from above: climbing; no faster down than half ``hover``. [m/s]

    Source: H. Glauert, momentum theory of forward flight (1926).
    """
    through = np.maximum(through, -_DEEPEST * hover)
    v = hover + np.maximum(-through, 0.0)  # from above the root, whence Newton's steps only come down
    for _ in range(_NEWTON_STEPS):
        flow = np.sqrt(along * along + (through + v) ** 2)
        step = (v * flow - hover * hover) / (flow + v * (through + v) / flow)
        v = v - step
        if np.all(np.abs(step) < _CLOSE * hover):
            break
    return v


class DemandEffect(Physics):
    """The hooks, each the identity."""

    def factor(self, motion: Motion) -> Value:
        """What the rotors' power is multiplied with."""
        return 1.0

    def share(self, motion: Motion) -> Value:
        """What is added to the hover's power, over that power."""
        return 0.0


def demanded(effects: Iterable[DemandEffect], motion: Motion) -> Value:
    """Power of the rotors over that of the hover in still air at sea level."""
    factor: Value = 1.0
    total: Value = 1.0
    for effect in effects:
        factor = factor * effect.factor(motion)
        total = total + effect.share(motion)
    return factor * total


@dataclass(frozen=True, slots=True, kw_only=True)
class AirDensity(DemandEffect):
    """P ~ rho^-n; momentum theory says n = 1/2."""

    id: ClassVar[str] = "air-density"
    title: ClassVar[str] = "Thin air costs power"
    equation: ClassVar[str] = "P = P_0 (rho_0 / rho)^n, n = 1/2"
    source: ClassVar[str] = (
        "momentum theory, NASA/TM-20230012868 eq. (7): n = 1/2 of induced power; profile power, a tenth to a quarter "
        "of a hover's, grows with density: n = 0.35 to 0.15 of both"
    )
    excited_by: ClassVar[str] = "flights at different altitudes or in different seasons"
    mimics: ClassVar[tuple[str, ...]] = ("payload-mass", "propulsion-efficiency")
    manoeuvre: ClassVar[str] = "hover with the same load at two altitudes, barometer and air temperature logged"
    drivers: ClassVar[tuple[str, ...]] = ("density",)

    exponent: Value = parameter("n", "1", 0.0, 1.5, "of the density", absent=0.0, prior=(0.35, 0.15))

    def factor(self, motion: Motion) -> Value:
        ratio: Value = (AIR_DENSITY / motion.density) ** self.exponent
        return ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadMass(DemandEffect):
    """P ~ (m / m_0)^(3/2)."""

    id: ClassVar[str] = "payload-mass"
    title: ClassVar[str] = "The vehicle has another mass"
    equation: ClassVar[str] = "P = P_0 (1 + m_p / m_0)^(3/2)"
    source: ClassVar[str] = "momentum theory: 10 % of mass are 15 % of power"
    excited_by: ClassVar[str] = "any hover; a payload that is dropped"
    mimics: ClassVar[tuple[str, ...]] = ("air-density", "propulsion-efficiency", "climb-power")
    manoeuvre: ClassVar[str] = "weigh the vehicle; hover with and without a known load"

    payload: Value = parameter(
        "m_p / m_0", "1", -0.6, 3.0, "mass beyond the vehicle's own", absent=0.0, prior=(0.0, 0.12), per_flight=True
    )

    def factor(self, motion: Motion) -> Value:
        ratio: Value = (1.0 + self.payload) ** 1.5
        return ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class WindTilt(DemandEffect):
    """Thrust carries the weight and overcomes the drag: P ~ T^(3/2); and the drag is moved at the airspeed: D V."""

    id: ClassVar[str] = "wind-tilt"
    title: ClassVar[str] = "Drag tilts the vehicle"
    equation: ClassVar[str] = "P = P_0 (T / W)^(3/2) (1 + D V / (W v_h)), D = rho CdA V^2 / 2, T^2 = W^2 + D^2"
    source: ClassVar[str] = "balance of forces and parasite power of rotor theory; 2-15 % at 8-12 m/s"
    excited_by: ClassVar[str] = "fast legs, wind"
    mimics: ClassVar[tuple[str, ...]] = ("translational-lift",)
    manoeuvre: ClassVar[str] = "legs into and down the wind, tilt angle logged"
    drivers: ClassVar[tuple[str, ...]] = ("airspeed",)

    drag_area: Value = parameter("CdA", "m^2", 0.0, 5.0, "drag area of the vehicle", absent=0.0, prior=(0.08, 0.05))

    def factor(self, motion: Motion) -> Value:
        ratio: Value = (1.0 + self._drag(motion) ** 2) ** 0.75
        return ratio

    def share(self, motion: Motion) -> Value:
        return self._drag(motion) * motion.airspeed / motion.hover_velocity

    def _drag(self, motion: Motion) -> Value:
        """Over the weight."""
        return 0.5 * motion.density * self.drag_area * motion.airspeed**2 / motion.weight


@dataclass(frozen=True, slots=True, kw_only=True)
class TranslationalLift(DemandEffect):
    """Rotors that move forward induce less: v_i = v_h^2 / sqrt(V^2 + v_i^2), on the induced part of the power."""

    id: ClassVar[str] = "translational-lift"
    title: ClassVar[str] = "Forward flight saves induced power"
    equation: ClassVar[str] = "P = P_0 [1 - k (1 - v_i / v_h)], v_i = v_h^2 / sqrt(V^2 + v_i^2)"
    source: ClassVar[str] = "Glauert 1926; 10-25 % at 6-12 m/s"
    excited_by: ClassVar[str] = "hover and forward flight in one recording"
    mimics: ClassVar[tuple[str, ...]] = ("wind-tilt",)
    manoeuvre: ClassVar[str] = "legs at 0, 4, 8 and 12 m/s"
    drivers: ClassVar[tuple[str, ...]] = ("airspeed",)

    induced: Value = parameter("k", "1", 0.0, 1.2, "induced part of the hover's power", absent=0.0, prior=(0.6, 0.2))

    def share(self, motion: Motion) -> Value:
        hover = motion.hover_velocity
        return self.induced * (induced_velocity(hover, motion.airspeed) / hover - 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClimbPower(DemandEffect):
    """Lifting the weight, less what the flow through the rotors saves: T (V_c / 2 + sqrt(V_c^2 / 4 + v_h^2))."""

    id: ClassVar[str] = "climb-power"
    title: ClassVar[str] = "Climbing costs power"
    equation: ClassVar[str] = "P = P_0 [1 + k (V_c / 2 + sqrt(V_c^2 / 4 + v_h^2) - v_h) / v_h]"
    source: ClassVar[str] = "momentum theory of axial flight; 24 % at 3 m/s"
    excited_by: ClassVar[str] = "changes of altitude"
    mimics: ClassVar[tuple[str, ...]] = ("payload-mass",)
    manoeuvre: ClassVar[str] = "climb at two rates"
    drivers: ClassVar[tuple[str, ...]] = ("climb",)

    induced: Value = parameter("k", "1", 0.0, 2.0, "of what theory says", absent=0.0, prior=(0.9, 0.2))

    def share(self, motion: Motion) -> Value:
        hover = motion.hover_velocity
        climb = np.maximum(motion.climb, -_DEEPEST * hover)
        level = induced_velocity(hover, motion.airspeed)
        climbing = climb + induced_velocity(hover, motion.airspeed, climb)
        return self.induced * (climbing - level) / hover


@dataclass(frozen=True, slots=True, kw_only=True)
class PropulsionEfficiency(DemandEffect):
    """P ~ 1 / (1 - l)."""

    id: ClassVar[str] = "propulsion-efficiency"
    title: ClassVar[str] = "Rotors or motors have lost efficiency"
    equation: ClassVar[str] = "P = P_0 / (1 - l)"
    source: ClassVar[str] = "worn or iced propellers, hot motors: 5-15 %"
    excited_by: ClassVar[str] = "any flight, over the vehicle's life"
    mimics: ClassVar[tuple[str, ...]] = ("payload-mass", "air-density")
    manoeuvre: ClassVar[str] = "weigh the vehicle, then hover: rotor speed and throttle against thrust"

    loss: Value = parameter("l", "1", -0.4, 0.8, "share of the efficiency lost", absent=0.0, prior=(0.0, 0.07))

    def factor(self, motion: Motion) -> Value:
        return 1.0 / (1.0 - self.loss)


_ALL: tuple[type[DemandEffect], ...] = (
    AirDensity, PayloadMass, WindTilt, TranslationalLift, ClimbPower, PropulsionEfficiency,
)  # fmt: skip
DEMAND_EFFECTS: dict[str, type[DemandEffect]] = {effect.id: effect for effect in _ALL}
