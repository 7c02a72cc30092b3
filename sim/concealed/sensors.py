"""From what happens to what is logged: filters, noise, quanta, gaps and clocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from sim.concealed.flying import SECOND, Flown
from sim.concealed.knobs import Knobs
from sim.concealed.load import DT, Flags
from sim.concealed.packs import Array
from sim.concealed.sheets import Noise
from sim.concealed.wind import coloured

_FILTER_S = 0.15  # of the power module, the same for voltage and current
_BOARD_WARMS_K, _BOARD_S = 18.0, 400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """How good the sensors and the link of a vehicle are."""

    white_v: float
    red_v: float
    red_s: float
    quantum_v: float
    white_a: float
    quantum_a: float
    heavy: bool
    outliers: float  # share of the samples
    dropped: float  # share of the samples that go missing one by one
    gaps: int  # stretches of up to 30 s that go missing in each flight
    stale: int  # stretches of some seconds in which the same value is repeated
    jitter_s: float

    def spectrum(self, samples: int) -> Array:
        """Power of the voltage's noise at the frequencies of ``rfft``, one for white noise of 1 V [V2]."""
        keep = np.exp(-1.0 / self.red_s)
        turn = np.exp(-2j * np.pi * np.fft.rfftfreq(samples))
        red = self.red_v**2 * (1.0 - keep**2) / np.abs(1.0 - keep * turn) ** 2
        tails = 3.0 if self.heavy else 1.0
        found: Array = self.white_v**2 * tails + self.quantum_v**2 / 12.0 + red
        return found


def draw_quality(rng: np.random.Generator, noise: Noise) -> Quality:
    """A vehicle's sensors."""
    faulty, other = noise == "logging-faults", noise == "other-colour"
    return Quality(
        white_v=float(rng.uniform(0.008, 0.020)),
        red_v=float(rng.uniform(0.010, 0.018) if other else rng.uniform(0.003, 0.007)),
        red_s=float(np.exp(rng.uniform(np.log(5.0), np.log(300.0))) if other else rng.uniform(20.0, 60.0)),
        quantum_v=float(rng.choice([0.001, 0.010, 0.010, 0.024, 0.050])),
        white_a=float(rng.uniform(0.05, 0.25)),
        quantum_a=float(rng.choice([0.01, 0.01, 0.05, 0.1])),
        heavy=noise == "heavy-tails",
        outliers=0.002 if noise == "heavy-tails" else 0.0003,
        dropped=0.06 if faulty else 0.005,
        gaps=4 if faulty else 0,
        stale=4 if faulty else 0,
        jitter_s=0.15 if faulty else 0.02,
    )


def board_c(air_c: float, samples: int, dt: float) -> Array:
    """Temperature of the autopilot's board: it warms by itself."""
    warmed: Array = air_c + _BOARD_WARMS_K * (1.0 - np.exp(-np.arange(samples) * dt / _BOARD_S))
    return warmed


def filtered(values: Array, tau_s: float) -> Array:
    """First-order low pass, settled at the start."""
    keep = float(np.exp(-DT / tau_s))
    out, _ = lfilter([1.0 - keep], [1.0, -keep], values, zi=np.array([keep * values[0]]))
    smoothed: Array = out
    return smoothed


def told_voltage(knobs: Knobs, flight: int, volts: Array) -> Array:
    """What the voltage sensor tells of a flight at 10 Hz, without noise."""
    s = knobs.sensors
    board = board_c(float(knobs.demand.air_c[flight]), len(volts), DT)
    told = volts * s.voltage_gain[flight] + s.voltage_offset_v[flight] + s.board_v_per_k * (board - 40.0)
    told = filtered(told, _FILTER_S + float(s.voltage_lag_s[flight]))
    time = np.arange(len(volts)) * DT
    late: Array = np.interp(time - s.skew_s[flight], time, told)
    return late


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """One flight as the autopilot tells it, once a second; None is a channel that is not logged."""

    time_s: Array  # since the log's start, when it was received
    boot_s: Array
    kept: Flags
    voltage_v: Array
    current_a: Array
    used_ah: Array
    temperature_c: Array | None
    cells_v: Array | None  # (S, 6)
    height_m: Array
    climb_mps: Array
    ground_mps: Array
    air_mps: Array
    throttle: Array
    armed: Flags
    airborne: Flags
    field_m: float
    air_c: float
    board_c: Array
    wind_mps: float
    clean_v: Array  # without noise: with the effects
    clean_a: Array


def _noise(rng: np.random.Generator, quality: Quality, samples: int) -> Array:
    shocks = rng.standard_t(3.0, samples) if quality.heavy else rng.standard_normal(samples)
    red = coloured(rng, (1, samples), 1.0, np.array([quality.red_s]))[0]
    out: Array = quality.white_v * shocks + quality.red_v * red
    return out + np.where(rng.random(samples) < quality.outliers, rng.normal(0.0, 0.6, samples), 0.0)


def _rounded(values: Array, quantum: float) -> Array:
    out: Array = np.round(values / quantum) * quantum
    return out


def record(
    rng: np.random.Generator,
    quality: Quality,
    knobs: Knobs,
    flown: Flown,
    flight: int,
    temperature: bool,
    cells: bool,
) -> Recording:
    """The log of one flight."""
    plan, f = flown.load.plan, flight
    begin, end = int(plan.begins[f]), int(flown.ends[f])
    at = np.arange(begin, end, SECOND)
    samples = len(at)
    where = flown.position[f, at]
    local = at - begin
    clean_v = told_voltage(knobs, f, flown.voltage_v[f, begin:end])[local]
    clean_a = filtered(flown.told_a[f, begin:end], _FILTER_S)[local]
    volts = _rounded(clean_v + _noise(rng, quality, samples), quality.quantum_v)
    amps = _rounded(clean_a + quality.white_a * rng.standard_normal(samples), quality.quantum_a)
    kept = rng.random(samples) >= quality.dropped
    for _ in range(quality.gaps):
        start = int(rng.integers(30, max(samples - 60, 31)))
        kept[start : start + int(rng.integers(5, 30))] = False
    for _ in range(quality.stale):
        start = int(rng.integers(30, max(samples - 60, 31)))
        length = int(rng.integers(3, 8))
        volts[start : start + length], amps[start : start + length] = volts[start], amps[start]
    kept[0] = True
    seconds = at // SECOND
    boot: Array = DT * local.astype(float)
    climb = flown.load.climb_mps[f, where]
    height = np.maximum(np.cumsum(flown.load.climb_mps[f, flown.position[f, begin:end]])[local] * DT, 0.0)
    airborne = plan.airborne[f, where]
    surface = flown.surface_c[f, seconds] + rng.normal(0.0, 0.2, samples)
    # One monitor reads pack and cells: at the same instant, through the same filter, and its errors are in both.
    shares = flown.cells_v[f, seconds] / flown.cells_v[f, seconds].sum(axis=1, keepdims=True)
    of_cells = np.round(volts[:, None] * shares + rng.normal(0.0, 0.002, (samples, 6)), 3)
    return Recording(
        time_s=np.maximum.accumulate(boot + np.abs(rng.normal(0.0, quality.jitter_s, samples))),
        boot_s=boot,
        kept=kept,
        voltage_v=volts,
        current_a=amps,
        used_ah=np.cumsum(clean_a) / 3600.0,
        temperature_c=np.round(surface) if temperature else None,
        cells_v=of_cells if cells else None,
        height_m=np.where(airborne, height, 0.0),
        climb_mps=np.where(airborne, climb, 0.0),
        ground_mps=flown.load.ground_mps[f, where],
        air_mps=flown.load.air_mps[f, where],
        throttle=flown.load.throttle[f, where],
        armed=plan.armed[f, where],
        airborne=airborne,
        field_m=float(knobs.demand.field_m[f]),
        air_c=float(knobs.demand.air_c[f]),
        board_c=board_c(float(knobs.demand.air_c[f]), samples, 1.0),
        wind_mps=float(knobs.demand.wind_mps[f]),
        clean_v=clean_v,
        clean_a=clean_a,
    )
