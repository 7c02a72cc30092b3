"""Flights of a vehicle whose power is known in closed form: momentum theory by hand, gusts as coloured noise."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from bhm_service.config import Vehicle
from bhm_service.discrepancy.flights import FlightData

MASS_KG, ROTORS, RADIUS_M, EFFICIENCY, AVIONICS_W = 5.0, 4, 0.2, 0.55, 15.0
WEIGHT_N = MASS_KG * 9.80665
DISC_M2 = ROTORS * np.pi * RADIUS_M**2
INDUCED_MPS = float(np.sqrt(WEIGHT_N / (2.0 * 1.225 * DISC_M2)))
HOVER_W = WEIGHT_N * INDUCED_MPS / EFFICIENCY
STEP_S, SAMPLES = 2.0, 260


def vehicle(*demand, mass_kg=MASS_KG):
    """The vehicle's file, with these tables of demand effects."""
    return Vehicle.model_validate(
        {
            "name": "known",
            "battery": {"file": "battery.toml"},
            "rotors": {
                "mass_kg": mass_kg,
                "rotors": ROTORS,
                "rotor_radius_m": RADIUS_M,
                "efficiency": EFFICIENCY,
                "avionics_w": AVIONICS_W,
            },
            "demand": list(demand),
        }
    )


CLIMB = {"id": "climb-power", "induced": {"value": 0.85, "sd": 0.05}}


def axial(climb):
    """Power of a rotor that climbs over that of one that hovers: V / 2 + sqrt(V^2 / 4 + v_h^2), over v_h."""
    return (climb / 2.0 + np.sqrt(climb**2 / 4.0 + INDUCED_MPS**2)) / INDUCED_MPS


def ridden(
    number, *, induced=0.85, heavier=0.0, released_s=None, worn=0.0, metres=0.0, warmer_k=0.0, scatter=0.005, seed=3
):
    """One flight with climbs: its rotors take more by a payload (until it is let go), by wear, by height and warmth."""
    rng = np.random.default_rng([seed, number])
    t = STEP_S * np.arange(SAMPLES)
    airborne = (t > 30.0) & (t < t[-1] - 20.0)
    climb = np.select([(t // 30 + number) % 4 == 0, (t // 30 + number) % 4 == 2], [2.0, -1.0], 0.0) * airborne
    aboard = heavier if released_s is None else np.where(t < released_s, heavier, 0.0)
    gusts = 0.02 * np.sqrt(1.0 - 0.5**2) * lfilter([1.0], [1.0, -0.5], rng.standard_normal(SAMPLES))
    rotors = HOVER_W * (1.0 + induced * (axial(climb) - 1.0)) * (1.0 + aboard) ** 1.5 / (1.0 - worn)
    rotors = rotors * (1.0 + scatter * rng.standard_normal())
    standard = 1.0 - 2.25577e-5 * metres  # temperature over that at sea level
    rotors = rotors / np.sqrt(standard**4.2559 * 288.15 / (288.15 + warmer_k))
    power = AVIONICS_W + np.where(airborne, rotors * (1.0 + gusts), 0.0)
    volts = 24.0 - 2.0 * t / t[-1]
    return FlightData(
        label=f"{number:02d}.tlog",
        time_s=t,
        current_a=power / volts,
        voltage_v=volts,
        temperature_k=None,
        airborne=airborne,
        altitude_m=np.cumsum(climb) * STEP_S,
        climb_mps=climb,
        speed_mps=np.zeros(SAMPLES),
        pressure_pa=np.full(SAMPLES, 101325.0 * standard**5.2559),
    )
