"""The bench: what a user records of a pack before flying it, all at 25 degC."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.concealed.electrics import Electrics
from sim.concealed.knobs import neutral
from sim.concealed.packs import SERIES, Array, Pack
from sim.concealed.wind import coloured

_CUT_V = 3.0
_LAB_C = 25.0


@dataclass(frozen=True, slots=True)
class LabRun:
    """One recording: equally long arrays."""

    time_s: Array
    current_a: Array
    voltage_v: Array
    temperature_c: Array

    def rows(self) -> str:
        """As the table is written."""
        lines = ["time_s,current_A,voltage_V,temperature_C"]
        lines += [
            f"{t:g},{i:.3f},{v:.4f},{c:.1f}"
            for t, i, v, c in zip(self.time_s, self.current_a, self.voltage_v, self.temperature_c, strict=True)
        ]
        return "\n".join(lines) + "\n"


def run(pack: Pack, current_a: Array, dt: float, until_empty: bool) -> tuple[Array, Array]:
    """Voltage under a current, and the current: zero once a cell is empty where that is asked, then 300 s of rest."""
    one = np.ones(1)
    cells = Electrics.of(pack, [neutral(1, ("hover",), 0.0 * one).cells], dt)
    voltage, flown = np.empty(len(current_a)), current_a.copy()
    empty_at = None
    for k in range(len(current_a)):
        if k % max(round(5.0 / dt), 1) == 0:
            cells.refresh(np.full((1, SERIES), _LAB_C))
        if empty_at is not None:
            flown[k] = 0.0
            if (k - empty_at) * dt >= 300.0:
                return voltage[:k], flown[:k]
        current = flown[k : k + 1]
        volts = cells.cells_v(current)
        voltage[k] = volts.sum()
        if until_empty and empty_at is None and volts.min() < _CUT_V:
            empty_at = k
        cells.step(current)
    return voltage, flown


def _recorded(rng: np.random.Generator, voltage: Array, current: Array, dt: float, noise_v: float) -> LabRun:
    n = len(voltage)
    return LabRun(
        dt * np.arange(n, dtype=float),
        np.round(current, 3),
        voltage + noise_v * rng.standard_normal(n),
        np.full(n, _LAB_C),
    )


def recordings(pack: Pack, rng: np.random.Generator) -> dict[str, LabRun]:
    """The slow discharge, the 1C one, and a hover-like load with a rest."""
    noise = float(rng.uniform(2e-3, 6e-3))
    q = pack.capacity_ah
    slow_v, slow_i = run(pack, np.full(3700, q / 50.0), 60.0, until_empty=True)
    one_i = np.full(4600, q)
    one_i[0] = 0.0
    one_v, one_i = run(pack, one_i, 1.0, until_empty=True)
    variable_v, variable_i = run(pack, load_profile(rng, pack), 1.0, until_empty=False)
    return {
        "slow": _recorded(rng, slow_v, slow_i, 60.0, noise),
        "one_c": _recorded(rng, one_v, one_i, 1.0, noise),
        "variable": _recorded(rng, variable_v, variable_i, 1.0, noise),
    }


def empty_soc(pack: Pack, slow: LabRun) -> float:
    """Mean state of charge of the cells where the slow discharge ended, which the weakest of them decides."""
    given_ah = float(np.sum(slow.current_a[:-1] * np.diff(slow.time_s))) / 3600.0
    return 1.0 - given_ah / pack.capacity_ah * float(np.mean(1.0 / pack.capacity))


def load_profile(rng: np.random.Generator, pack: Pack) -> Array:
    """Current [A] of a bench that plays a hover with gusts and steps, then rests for 20 min; once a second."""
    q = pack.capacity_ah
    seconds = round(rng.uniform(700.0, 1000.0) * 2.0 / pack.hover_c_rate)
    load = np.concatenate([np.full(25, 0.03), np.ones(seconds), np.zeros(1200)])
    gust = coloured(rng, (1, len(load)), 1.0, np.array([3.0]))[0]
    steps = np.repeat(rng.choice([0.7, 0.9, 1.0, 1.1, 1.4], len(load) // 25 + 1, p=[0.1, 0.2, 0.4, 0.2, 0.1]), 25)
    rise = 1.0 + 0.1 * np.arange(len(load)) / seconds
    hover = pack.hover_c_rate * q
    current = np.where(load > 0.5, hover * 0.95 * rise * steps[: len(load)] * (1.0 + 0.04 * gust), load * q)
    return np.maximum(current, 0.0)
