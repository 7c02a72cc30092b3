"""The packs: six cells in series of one of four chemistries, each with its own curve, resistances and spread."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

SERIES = 6
REFERENCE_K = 298.15
GAS, FARADAY = 8.314462618, 96485.33212
THERMAL_V = GAS * REFERENCE_K / FARADAY
GRID = np.linspace(-0.06, 1.06, 449)  # state of charge at which tables are kept


@dataclass(frozen=True, slots=True)
class Chemistry:
    """Rested voltage of a cell: foot + knee (1 - e^(-z/width)) + slope z^bend + plateau step tanh((z - at)/0.09)."""

    name: str
    top_v: float  # at z = 1
    knee_v: float
    knee_width: float
    slope_v: float
    bend: float
    step_v: float
    step_at: float
    entropy_v_per_k: tuple[float, float, float]  # at z = 0, 0.5, 1


CHEMISTRIES = (
    Chemistry("LiCoO2 pouch", 4.200, 0.46, 0.026, 0.52, 1.60, 0.012, 0.60, (-4.0e-4, -2.0e-4, 1.0e-4)),
    Chemistry("NMC 21700", 4.185, 0.58, 0.036, 0.62, 1.30, 0.022, 0.55, (-3.5e-4, -0.5e-4, 1.2e-4)),
    Chemistry("NCA 18650", 4.180, 0.66, 0.048, 0.70, 1.12, 0.015, 0.52, (-4.5e-4, -1.0e-4, 0.5e-4)),
    Chemistry("LiHV pouch", 4.340, 0.48, 0.030, 0.66, 1.45, 0.016, 0.62, (-3.0e-4, -1.5e-4, 1.5e-4)),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pack:
    """One pack when new, at 25 degC; what belongs to a cell has six values."""

    chemistry: str
    capacity_ah: float  # of the pack as a whole: of its mean cell
    capacity: Array  # (6,) of each cell, as a fraction of it
    ocv_v: Array  # on GRID
    entropy_v_per_k: Array  # on GRID
    ohmic: Array  # (6,) [Ohm] at half charge
    ohmic_shape: Array  # on GRID, 1 at half charge
    exchange_a: Array  # (6,) exchange current at half charge
    double_layer_s: float
    ladder_s: tuple[float, float, float]  # time constants of solid diffusion
    ladder_share: tuple[float, float, float]  # share of the surface's depletion in each
    depletion_s: float  # surface depletion = depletion_s x I / charge
    electrolyte: Array  # (6,) [Ohm]
    electrolyte_s: float
    activation_j_mol: tuple[float, float, float]  # ohmic, exchange current, diffusion
    mass_kg: float
    heat_j_per_k: float
    cooling_w_per_k: float  # in flight
    core_k_per_w: float  # core to surface, of one cell
    hover_c_rate: float
    avionics_w: float

    @property
    def full_v(self) -> float:
        """Rested voltage of the pack when full."""
        return float(SERIES * np.interp(1.0, GRID, self.ocv_v))

    @property
    def hover_w(self) -> float:
        """Power that its vehicle asks for in still air."""
        return self.hover_c_rate * self.capacity_ah * SERIES * 3.7


def draw_pack(rng: np.random.Generator) -> Pack:
    """A pack of any chemistry, from 9 to 22 Ah, with cells that differ as sold cells do."""
    kind = CHEMISTRIES[int(rng.integers(len(CHEMISTRIES)))]
    capacity_ah = float(np.round(rng.uniform(9.0, 22.0), 1))
    scale = 16.0 / capacity_ah
    z = np.maximum(GRID, -0.05)
    knee = kind.knee_v * (1.0 - np.exp(-z / (kind.knee_width * rng.uniform(0.85, 1.15))))
    slope = kind.slope_v * np.sign(z) * np.abs(z) ** (kind.bend * rng.uniform(0.96, 1.04))
    step = kind.step_v * np.tanh((z - kind.step_at * rng.uniform(0.95, 1.05)) / 0.09)
    curve = knee + slope + step
    at_rest = np.interp(GRID, (0.0, 0.5, 1.0), kind.entropy_v_per_k)

    def spread(sd: float) -> Array:
        return 1.0 + sd * rng.standard_normal(SERIES)

    ohmic = scale * rng.uniform(0.9e-3, 1.9e-3)
    low, high = rng.uniform(0.25, 0.6), rng.uniform(0.0, 0.12)
    shape = 1.0 + low * np.exp(-(z - 0.0) / 0.10) + high * np.exp((z - 1.0) / 0.15)
    diffusion_s = rng.uniform(60.0, 160.0)
    mass = capacity_ah / 16.0 * 2.0 * rng.uniform(0.9, 1.1)
    cells = spread(0.006)
    return Pack(
        chemistry=kind.name,
        capacity_ah=capacity_ah,
        capacity=cells / cells.mean(),
        ocv_v=curve - np.interp(1.0, GRID, curve) + kind.top_v,
        entropy_v_per_k=at_rest,
        ohmic=ohmic * spread(0.03),
        ohmic_shape=shape / np.interp(0.5, GRID, shape),
        exchange_a=capacity_ah * rng.uniform(0.9, 2.0) * spread(0.03),
        double_layer_s=float(rng.uniform(0.4, 1.2)),
        ladder_s=(diffusion_s * 0.405, diffusion_s * 0.045, diffusion_s * 0.0162),
        ladder_share=(0.81, 0.13, 0.06),
        depletion_s=float(diffusion_s / 3.0 * 0.6),
        electrolyte=scale * rng.uniform(0.2e-3, 0.6e-3) * spread(0.03),
        electrolyte_s=float(rng.uniform(15.0, 45.0)),
        activation_j_mol=(
            1e3 * rng.uniform(13.0, 18.0),
            1e3 * rng.uniform(30.0, 42.0),
            1e3 * rng.uniform(24.0, 34.0),
        ),
        mass_kg=float(mass),
        heat_j_per_k=float(mass * rng.uniform(900.0, 1050.0)),
        cooling_w_per_k=float(rng.uniform(0.6, 1.8) * (mass / 2.0) ** 0.67),
        core_k_per_w=float(rng.uniform(0.25, 0.7)),
        hover_c_rate=float(rng.uniform(1.4, 2.3)),
        avionics_w=float(rng.uniform(12.0, 24.0)),
    )
