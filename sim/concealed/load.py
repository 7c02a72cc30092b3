"""What a multirotor asks of its pack: a plan, wind, momentum theory; constant power whatever the voltage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from sim.concealed.knobs import DemandKnobs
from sim.concealed.packs import Array, Pack
from sim.concealed.wind import coloured, gusts

DT = 0.1  # [s]
_G = 9.80665
_BASE_M = 40.0  # height of the plan
_CLIMB_S, _DESCENT_MPS = 15.0, 1.25
REST_S = 150.0  # logged after landing
_INDUCED_MPS = 6.5  # of the hovering vehicle, at sea level
_REFERENCE_RHO = 1.184  # [kg/m3] where it was measured
_FIGURE = 0.60  # electrical to induced power
PROFILE = 0.18  # share of the hover power in the blades' drag
DRAG_M2 = 0.020  # drag area for each kg
Flags: TypeAlias = NDArray[np.bool_]
Indices: TypeAlias = NDArray[np.intp]
PLANS = ("hover", "legs", "climbs", "speeds", "windy-legs", "shuttle")


@dataclass(frozen=True, slots=True)
class Plan:
    """Set points along the longest flight (F, K); a flight may jump to its descent earlier."""

    climb_mps: Array
    speed_mps: Array  # over ground, along the wind's axis
    airborne: Flags
    armed: Flags
    may_land: Flags
    descent: int  # index where the descent begins
    land: Array  # (F,) index from which the pilot means to descend
    begins: Indices  # (F,) index of the log's first sample
    takeoff_s: float


@dataclass(frozen=True, slots=True)
class Load:
    """Power and motion along the plan (F, K)."""

    plan: Plan
    power_w: Array
    ground_mps: Array
    air_mps: Array
    climb_mps: Array
    throttle: Array
    vibration_g: Array
    wind_mps: Array  # (F,)


def _segments(rng: np.random.Generator, kind: str, seconds: float) -> list[tuple[float, float, float]]:
    """Pieces (duration, climb, speed) of a cruise; heights come back to the base."""
    out: list[tuple[float, float, float]] = []
    total, side = 0.0, 1.0
    while total < seconds:
        hover = rng.uniform(40.0, 90.0)
        piece: list[tuple[float, float, float]] = [(hover, 0.0, 0.0)]
        if kind in ("legs", "windy-legs"):
            speed = rng.uniform(5.0, 7.0) if kind == "windy-legs" else rng.uniform(3.0, 5.5)
            leg = rng.uniform(30.0, 60.0)
            piece += [(leg, 0.0, side * speed), (leg, 0.0, -side * speed)]
        elif kind == "climbs":
            rate, up = rng.uniform(1.0, 3.5), rng.uniform(8.0, 16.0)
            piece += [(up, rate, 0.0), (rng.uniform(10.0, 30.0), 0.0, 0.0), (up * rate / 1.5, -1.5, 0.0)]
        elif kind == "speeds":
            piece = [(rng.uniform(20.0, 40.0), 0.0, 0.0)]
            for speed in rng.permutation([3.0, 6.0, 9.0, 12.0]):
                piece += [(25.0, 0.0, side * speed), (25.0, 0.0, -side * speed)]
        elif kind == "shuttle":
            rate, up = 2.2, rng.uniform(6.0, 10.0)
            leg = rng.uniform(25.0, 40.0)
            piece += [(up, rate, 0.0), (leg, 0.0, 5.0 * side), (leg, 0.0, -5.0 * side), (up * rate / 1.1, -1.1, 0.0)]
        out += piece
        total += sum(p[0] for p in piece)
        side = -side
    return out


def fly_plans(rng: np.random.Generator, kinds: tuple[str, ...], cruise_s: Array) -> Plan:
    """The plans of all flights; take-offs are aligned, logs begin 20 to 40 s before."""
    before = rng.uniform(20.0, 40.0, len(kinds))
    pieces = [_segments(rng, kind, seconds) for kind, seconds in zip(kinds, cruise_s, strict=True)]
    cruise = [sum(p[0] for p in piece) for piece in pieces]
    start = float(before.max())
    descent = round((start + _CLIMB_S + max(cruise) + 30.0) / DT)
    steps = descent + round((_BASE_M / _DESCENT_MPS + REST_S) / DT)
    shape = (len(kinds), steps)
    climb, speed = np.zeros(shape), np.zeros(shape)
    may = np.zeros(shape, dtype=bool)
    land = np.empty(len(kinds))
    takeoff = round(start / DT)
    cruise_at = takeoff + round(_CLIMB_S / DT)
    for row, piece in enumerate(pieces):
        climb[row, takeoff:cruise_at] = _BASE_M / _CLIMB_S
        at = start + _CLIMB_S
        for seconds, up, along in piece:
            a, b = round(at / DT), round((at + seconds) / DT)
            climb[row, a:b], speed[row, a:b] = up, along
            may[row, a:b] = up == 0.0 and along == 0.0
            at += seconds
        may[row, round(at / DT) : descent] = True
        land[row] = round(at / DT)
    landed = descent + round(_BASE_M / _DESCENT_MPS / DT)
    climb[:, descent:landed] = -_DESCENT_MPS
    airborne = np.zeros(shape, dtype=bool)
    airborne[:, takeoff:landed] = True
    armed = np.zeros(shape, dtype=bool)
    armed[:, takeoff - 40 : landed + 20] = True
    smooth = lfilter([DT / 1.2], [1.0, DT / 1.2 - 1.0], speed, axis=1)
    rise = lfilter([DT / 0.6], [1.0, DT / 0.6 - 1.0], climb, axis=1)
    begins = np.round((start - before) / DT).astype(np.intp)
    return Plan(rise, smooth, airborne, armed, may, descent, land, begins, start)


def induced_mps(hover_mps: Array, across_mps: Array, up_mps: Array) -> Array:
    """Induced velocity from Glauert's formula v (V_across^2 + (V_up + v)^2)^1/2 = v_h^2, by damped iteration."""
    v = np.array(hover_mps, dtype=float)
    square = hover_mps * hover_mps
    for _ in range(12):
        v = 0.5 * v + 0.5 * square / np.sqrt(across_mps * across_mps + (up_mps + v) ** 2 + 1e-6)
    return v


def density(field_m: Array, height_m: Array, air_c: Array) -> Array:
    """Air's density [kg/m3] from the barometric formula at a field and the air's own temperature."""
    pressure = 101325.0 * np.exp(-9.80665 * 0.0289644 * (field_m + height_m) / (8.314462618 * 283.0))
    out: Array = pressure * 0.0289644 / (8.314462618 * (air_c + 273.15))
    return out


def flies(pack: Pack) -> tuple[float, float]:
    """Mass [kg] and disc area of all rotors [m2] of the vehicle that is sized for a pack."""
    mass_kg = (pack.hover_w - pack.avionics_w) * _FIGURE * (1.0 - PROFILE) / (_G * _INDUCED_MPS)
    return mass_kg, mass_kg * _G / (2.0 * _REFERENCE_RHO * _INDUCED_MPS**2)


def demand(rng: np.random.Generator, pack: Pack, knobs: DemandKnobs, plan: Plan) -> Load:
    """Power [W] along the plan; the vehicle is sized for its pack."""
    shape = plan.climb_mps.shape

    def column(values: Array) -> Array:
        return values[:, None]

    along, sideways, up = gusts(rng, shape[1], DT, knobs.wind_mps, knobs.turbulence)
    airborne = plan.airborne.astype(float)
    mass_kg, disc_m2 = flies(pack)
    time = np.arange(shape[1]) * DT
    since = time[None, :] - plan.takeoff_s
    gone = np.where(np.nan_to_num(since - column(knobs.release_s), nan=-1.0) > 0.0, column(knobs.released), 0.0)
    mass = mass_kg * column(knobs.mass) * (1.0 - gone)
    height = np.cumsum(plan.climb_mps, axis=1) * DT
    rho = density(column(knobs.field_m), height, column(knobs.air_c))
    through_x = plan.speed_mps - column(knobs.wind_mps) - along
    air = np.hypot(through_x, sideways)
    ice = knobs.icing_per_min * np.clip(since, 0.0, None) / 60.0
    drag = 0.5 * rho * DRAG_M2 * mass_kg**0.67 * (1.0 + 4.0 * ice) * air**2
    if "tilt" in knobs.without:
        drag = 0.0 * drag
    thrust = np.hypot(mass * _G, drag)
    hover_v = np.sqrt(thrust / (2.0 * rho * disc_m2))
    rise = 0.7 * up + (0.0 if "climb" in knobs.without else plan.climb_mps)
    across = 0.0 * air if "lift" in knobs.without else air * mass * _G / thrust
    v = induced_mps(hover_v, across, rise)
    profile = PROFILE * pack.hover_w * (rho / _REFERENCE_RHO) * (mass / mass_kg) * (1.0 + ice) * (1.0 + 0.0025 * air**2)
    aero = thrust * np.maximum(rise + v, 0.15 * v) + drag * air
    control = 1.0 + 0.03 * coloured(rng, shape, DT, np.full(shape[0], 0.8))
    moving = (aero / _FIGURE * control + profile) / column(knobs.efficiency)
    if knobs.regenerates:
        moving = np.where(plan.climb_mps < -0.8, -0.12 * pack.hover_w, moving)
    idle = np.where(plan.armed, 0.06 * pack.hover_w, 0.0)
    ripple = 1.0 + 0.1 * coloured(rng, shape, DT, np.full(shape[0], 3.0))
    power = pack.avionics_w * ripple + np.where(plan.airborne, moving, idle)
    power = lfilter([DT / 0.25], [1.0, DT / 0.25 - 1.0], power, axis=1)  # motors do not follow at once
    throttle = np.clip(0.5 * np.sqrt(np.maximum(moving, 0.0) / pack.hover_w), 0.0, 1.0) * airborne
    shake = airborne * (0.25 + 0.03 * air + 0.1 * np.abs(coloured(rng, shape, DT, np.full(shape[0], 20.0))))
    return Load(plan, power, np.abs(plan.speed_mps), air * airborne, plan.climb_mps, throttle, shake, knobs.wind_mps)
