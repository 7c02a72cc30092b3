"""Hard lives of a pack: what the truth was, and what the sensors said of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.pack import PackModel
from bhm_service.estimation.tracker import Tracker
from bhm_service.messages import BatterySample
from bhm_service.units import Array

STEP_NOISE_V = 0.02  # [V] of the pack: one sigma
STEP_NOISE_A = 0.2  # [A]


@dataclass(frozen=True)
class Life:
    """A recording with its truth."""

    time_s: Array
    true_current_a: Array
    voltage_v: Array  # as measured
    current_a: Array  # as measured
    soc: Array
    clean_from: int  # index from which nothing is wrong any more


def load(rng: np.random.Generator, steps: int, mean_a: float) -> Array:
    """0 to 50 A: blocks of hovering with gusts, bursts and rests."""
    current = np.empty(steps)
    k = 0
    while k < steps:
        length = int(rng.integers(20, 120))
        kind = rng.random()
        level = 0.0 if kind < 0.2 else min(2.5 * mean_a, 50.0) if kind > 0.92 else mean_a
        current[k : k + length] = level
        k += length
    gusts = 1.0 + 0.1 * rng.standard_normal(steps)
    return np.clip(current * gusts, 0.0, 50.0)


def live(tracker: Tracker, time_s: Array, current_a: Array, soc: float) -> tuple[Array, Array]:
    """Voltage and state of charge of the pack itself (without what the filter carries beside it)."""
    pack = PackModel(tracker.pack.cell, tracker.pack.series, tracker.pack.parallel)
    truth = pack.simulate(time_s, current_a, soc)
    return truth.voltage, truth.soc


def samples(life: Life) -> list[BatterySample]:
    """The measurements as messages; NaN stays NaN: that is one of the things that may come."""
    return [
        BatterySample(time_s=float(t), battery_id=0, voltage_v=float(v), current_a=float(i), temperature_k=None)
        for t, v, i in zip(life.time_s, life.voltage_v, life.current_a, strict=True)
    ]


Disturbance = Callable[[Array, Array, Array, slice, np.random.Generator], None]


def nothing(t: Array, v: Array, i: Array, where: slice, rng: np.random.Generator) -> None:
    """Only the noise."""


def not_a_number(t: Array, v: Array, i: Array, where: slice, rng: np.random.Generator) -> None:
    """Every third voltage and every fifth current is NaN."""
    v[where][::3] = np.nan
    i[where][::5] = np.nan


def spikes(t: Array, v: Array, i: Array, where: slice, rng: np.random.Generator) -> None:
    """Now and then a reading from nowhere, infinite ones among them."""
    at = rng.integers(where.start, where.stop, 25)
    v[at] = rng.choice([0.0, 1e6, -40.0, 65.5, np.inf, 3.0], at.size)
    at = rng.integers(where.start, where.stop, 25)
    i[at] = rng.choice([327.67, -327.68, 1e9, -np.inf, 80.0], at.size)


def negative_current(t: Array, v: Array, i: Array, where: slice, rng: np.random.Generator) -> None:
    """The current sensor says minus five ampere whatever flows."""
    i[where] = -5.0


def gap(seconds: float) -> Disturbance:
    """Nothing is heard for so long; the load goes on."""

    def silence(t: Array, v: Array, i: Array, where: slice, rng: np.random.Generator) -> None:
        middle = (where.start + where.stop) // 2
        lost = slice(middle, min(middle + int(seconds), where.stop))
        v[lost] = np.inf  # marks what is left out of the recording
        i[lost] = np.inf

    return silence


DISTURBANCES: dict[str, Disturbance] = {
    "noise only": nothing,
    "NaN": not_a_number,
    "spikes": spikes,
    "negative current": negative_current,
    "gap 10 s": gap(10.0),
    "gap 60 s": gap(60.0),
    "gap 600 s": gap(600.0),
}


def build(tracker: Tracker, disturbance: str, sigma: float, scale: float, seed: int, *, deep: bool = False) -> Life:
    """A life of 2000 s: one third undisturbed, one third disturbed, then clean."""
    rng = np.random.default_rng(seed)
    steps = 2000
    t = np.arange(steps, dtype=float)
    capacity_a = float(np.asarray(tracker.pack.capacity_c)) / 3600.0
    mean_a = (2.6 if deep else 1.0) * capacity_a
    current = load(rng, steps, mean_a)
    voltage, soc = live(tracker, t, current, 0.97)
    v = voltage + sigma * STEP_NOISE_V * rng.standard_normal(steps)
    i = current + sigma * STEP_NOISE_A * rng.standard_normal(steps)
    if deep:
        # To nothing left, then off: a pack that is empty carries no vehicle.
        empty = int(np.argmax(soc <= 0.0)) or steps
        return Life(t[:empty], current[:empty], v[:empty], i[:empty], soc[:empty], empty)
    where = slice(700, 1400)
    v[where] += (scale - 1.0) * sigma * STEP_NOISE_V * rng.standard_normal(700)
    i[where] += (scale - 1.0) * sigma * STEP_NOISE_A * rng.standard_normal(700)
    DISTURBANCES[disturbance](t, v, i, where, rng)
    kept = ~(np.isposinf(v) & np.isposinf(i))
    clean = int(np.count_nonzero(kept[: where.stop]))
    return Life(t[kept], current[kept], v[kept], i[kept], soc[kept], clean)
