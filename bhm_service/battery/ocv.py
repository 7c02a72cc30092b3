"""Open-circuit voltage of one cell against state of charge: the paper's cubic capacitance, or a monotone spline."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from bhm_service.battery.alike import once
from bhm_service.units import Array, Value

# Resolution of the table that a curve is read from; linear between entries, so the error is h^2/8 times the
# curvature: below 0.05 mV for a LiPo cell's.
_TABLE_STEP = 1.0 / 2048.0
_TABLE_LOW, _TABLE_HIGH = -0.125, 1.125
_LEAST_SLOPE = 1e-3  # [V] per unit of charge, beyond the ends
MOST_REST_V = 0.2  # [V] that a form of a curve may leave of it


class OpenCircuit(Protocol):
    """A cell's open-circuit voltage."""

    def voltage(self, soc: Value) -> Value:
        """Open-circuit voltage [V] at ``soc`` (any shape), finite and increasing everywhere."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class CubicCapacitance:
    """V_b = q_b / C_b with C_b a cubic in SoC (paper, Table 3 and section 7.1; charges in C, capacitances in F)."""

    c_max: Value
    q_max: Value
    v_0: Value
    cbp0: Value
    cbp1: Value
    cbp2: Value

    def voltage(self, soc: Value) -> Value:
        cbp3 = self.q_max / self.v_0 - (self.cbp0 + self.cbp1 + self.cbp2)
        capacitance = ((self.cbp0 * soc + self.cbp1) * soc + self.cbp2) * soc + cbp3
        return (self.q_max - (1.0 - soc) * self.c_max) / capacitance


@dataclass(frozen=True, slots=True)
class MonotoneSpline:
    """A shape-preserving cubic (Fritsch & Carlson 1980) through knots that must rise.

    ``soc`` and ``volts`` are the knots, rising; outside them the curve goes on straight with its end slope, for an
    eighth of the charge, and is level from there.
    Raises ValueError if the knots do not rise.
    """

    soc: tuple[float, ...]
    volts: tuple[float, ...]
    _table: Array = field(init=False, repr=False, compare=False)
    _grid: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        x, y = np.asarray(self.soc), np.asarray(self.volts)
        if x.shape != y.shape or x.size < 2:
            raise ValueError("an open-circuit curve needs as many voltages as states of charge, two at least")
        if np.any(np.diff(x) <= 0.0) or np.any(np.diff(y) <= 0.0):
            raise ValueError("an open-circuit curve must rise from knot to knot")
        grid = np.arange(_TABLE_LOW, _TABLE_HIGH + 0.5 * _TABLE_STEP, _TABLE_STEP)
        object.__setattr__(self, "_grid", grid)
        object.__setattr__(self, "_table", monotone_cubic(x, y, grid))

    def voltage(self, soc: Value) -> Value:
        return once(self._read, soc)

    def _read(self, soc: Value) -> Value:
        return np.interp(soc, self._grid, self._table)


@dataclass(frozen=True, slots=True)
class CurveRest:
    """What a form of a curve leaves of it: straight between charges that rise, level beyond them.

    ``soc`` and ``volts`` are as many. Raises ValueError if they are not, or the charges do not rise.
    """

    soc: tuple[float, ...]
    volts: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.soc) != len(self.volts) or not self.soc:
            raise ValueError("what is left of a curve needs as many voltages as states of charge, one at least")
        if np.any(np.diff(self.soc) <= 0.0):
            raise ValueError("what is left of a curve needs states of charge that rise")

    def voltage(self, soc: Value) -> Value:
        """To add to the form [V], at ``soc`` (any shape)."""
        return np.interp(soc, self.soc, self.volts)


def monotone_cubic(x: Array, y: Array, at: Array) -> Array:
    """Evaluate the Fritsch-Carlson cubic through (x, y) ``at`` given points, straight beyond the ends.

    scipy.interpolate.PchipInterpolator is the same to rounding (and the test's truth); importing it costs 19 MB, a
    quarter of what the whole service holds.
    """
    step = np.diff(x)
    secant = np.diff(y) / step
    slope = np.empty_like(y)
    if x.size == 2:
        slope[:] = secant[0]
    else:
        before, after = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
        rises = secant[1:] * secant[:-1] > 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            harmonic = (before + after) / (before / secant[:-1] + after / secant[1:])
        slope[1:-1] = np.where(rises, harmonic, 0.0)
        slope[0] = _end_slope(step[0], step[1], secant[0], secant[1])
        slope[-1] = _end_slope(step[-1], step[-2], secant[-1], secant[-2])
    inside = np.clip(at, x[0], x[-1])
    k = np.clip(np.searchsorted(x, inside, side="right") - 1, 0, step.size - 1)
    t = (inside - x[k]) / step[k]
    curvature = 3.0 * secant[k] - 2.0 * slope[k] - slope[k + 1]
    twist = slope[k] + slope[k + 1] - 2.0 * secant[k]
    values = y[k] + step[k] * t * (slope[k] + t * (curvature + t * twist))
    outside = np.where(at < x[0], max(slope[0], _LEAST_SLOPE), max(slope[-1], _LEAST_SLOPE))
    result: Array = values + (at - inside) * outside
    return result


def _end_slope(step: float, next_step: float, secant: float, next_secant: float) -> float:
    """Three-point slope at an end, held so that the curve does not overshoot."""
    slope = ((2.0 * step + next_step) * secant - step * next_secant) / (step + next_step)
    if slope * secant <= 0.0:
        return 0.0
    if secant * next_secant <= 0.0 and abs(slope) > 3.0 * abs(secant):
        return 3.0 * secant
    return float(slope)
