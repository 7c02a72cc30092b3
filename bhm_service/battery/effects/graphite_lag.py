"""Solid diffusion in graphite: its curve has stages, and lithium that is short at the surface has the voltage fall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.alike import once
from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Instant, Interval, Spread
from bhm_service.battery.effects.sphere import SPREAD, START, STEADY, behind, surface
from bhm_service.battery.parameters import parameter
from bhm_service.units import Array, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphiteLag(Effect):
    """V = U(SoC) - [U_C(x - z) - U_C(x)], x = x_0 + (x_1 - x_0) SoC the lithium in the negative electrode.

    z is what the surface of graphite particles lags behind their mean, by diffusion in a sphere, slower the fuller they
    are: at one current the drop has a course over the charge that no resistance and no lag of a whole cell's curve has,
    where the positive electrode makes most of the slope. U_C is that of mesocarbon microbeads, for all graphite.

    A part of a lab's model of a cell: no candidate of what is missing in flight.
    """

    id: ClassVar[str] = "graphite-lag"
    title: ClassVar[str] = "Lithium that lags at the surface of graphite"
    equation: ClassVar[str] = (
        "V = U - [U_C(x - z) - U_C(x)], x = x_0 + (x_1 - x_0) SoC, z a_C of surface less mean of diffusion in a "
        "sphere, R^2 / D = 20.2 tau_C exp[k (x - 1/2)]"
    )
    source: ClassVar[str] = (
        "Crank 1975, eq. 6.45; U_C: Doyle & Newman's dualfoil, MCMB 2528; D over charge: Levi & Aurbach 1997"
    )
    excited_by: ClassVar[str] = "loads of an hour's discharge or more over most of the charge"
    state_names: ClassVar[tuple[str, ...]] = ("graphite_first", "graphite_second", "graphite_others")

    time_constant: Value = parameter("tau_C", "s", 1.0, 3e4, "of the slowest mode of diffusion, half full")
    steepness: Value = parameter(
        "k", "1", -5.0, 15.0, "how much slower diffusion is the fuller, as an exponent", prior=(3.0, 3.0)
    )
    share: Value = parameter("a_C", "1", 0.0, 10.0, "of what one particle lags by, where not all are alike")
    empty: Value = parameter(
        "x_0", "1", -0.2, 0.4, "lithium in the negative electrode of an empty cell", prior=(0.02, 0.05)
    )
    full: Value = parameter("x_1", "1", 0.4, 1.1, "and of a full one", prior=(0.85, 0.1))

    def start(self) -> tuple[Value, ...]:
        return START

    def spread(self) -> tuple[Spread, ...]:
        return SPREAD

    def _lithium(self, soc: Value) -> Value:
        return self.empty + (self.full - self.empty) * soc

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        held = np.minimum(np.maximum(self._lithium(interval.soc), 0.0), 1.0)
        tau = self.time_constant * np.exp(self.steepness * (held - 0.5)) / interval.by.diffusion
        moved = (self.full - self.empty) / (interval.cell.capacity_c * interval.by.capacity)
        per_ampere = self.share * STEADY * tau * moved
        return surface(solver, start, per_ampere * interval.begin, per_ampere * interval.end, tau)

    def _dropped(self, state: tuple[Value, ...], soc: Value) -> Value:
        """What a cell's voltage is lower by. [V]"""
        x = self._lithium(soc)
        return _u_c(x - behind(state)) - _u_c(x)

    def heat(self, state: tuple[Value, ...], now: Instant) -> Value:
        return now.series * now.current * self._dropped(state, now.soc)

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        return -now.series * self._dropped(state, now.soc)


def graphite_v(x: Array) -> Array:
    """Open-circuit voltage of mesocarbon microbeads against lithium, by the lithium in them from 0 to 1. [V]

    Doyle, Newman et al., dualfoil 5, MCMB 2528 graphite.
    """
    steps = (
        (0.0351, 0.286, 0.083), (-0.0045, 0.849, 0.119), (-0.035, 0.9233, 0.05), (-0.0147, 0.5, 0.034),
        (-0.102, 0.194, 0.142), (-0.022, 0.9, 0.0164), (-0.011, 0.124, 0.0226), (0.0155, 0.105, 0.029),
    )  # fmt: skip
    stages = sum(height * np.tanh((x - at) / width) for height, at, width in steps)
    return np.asarray(0.194 + 1.5 * np.exp(-120.0 * x) + stages)


# Read as a table, level beyond both ends, where the closed form means nothing: and so in half the time.
_X = np.linspace(0.0, 1.0, 2001)
_U_C = graphite_v(_X)


def _u_c(x: Value) -> Value:
    return once(_read, x)


def _read(x: Value) -> Value:
    return np.interp(x, _X, _U_C)
