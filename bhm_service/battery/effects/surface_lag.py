"""Solid diffusion: particles give charge from their surface first, so a cell is at its curve's voltage for less."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Effect, Interval, Spread
from bhm_service.battery.effects.sphere import SPREAD, START, STEADY, behind, surface
from bhm_service.battery.parameters import parameter
from bhm_service.units import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceLag(Effect):
    """V = U(SoC - z), z what the surface of a cell's particles lags behind their mean, by diffusion in a sphere.

    Steps of the open-circuit curve come earlier under load, and are no steps any more: no resistance does that. Of a
    whole cell's curve one electrode has the larger part, so a share of what its particles lag by is seen.

    A part of a lab's model of a cell: no candidate of what is missing in flight.
    """

    id: ClassVar[str] = "surface-lag"
    title: ClassVar[str] = "Charge that lags at the particles' surface"
    equation: ClassVar[str] = (
        "V = U(SoC - z), z a_z of surface less mean of diffusion in a sphere, R^2 / D = 20.2 tau_z"
    )
    source: ClassVar[str] = "Crank 1975, eq. 6.45; single particle model"
    excited_by: ClassVar[str] = "loads of an hour's discharge or more over steps of the open-circuit curve"
    state_names: ClassVar[tuple[str, ...]] = ("surface_first", "surface_second", "surface_others")

    time_constant: Value = parameter("tau_z", "s", 1.0, 1e4, "of the slowest mode of diffusion")
    share: Value = parameter("a_z", "1", 0.0, 10.0, "of what one particle lags by that the cell's curve shows")

    def start(self) -> tuple[Value, ...]:
        return START

    def spread(self) -> tuple[Spread, ...]:
        return SPREAD

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        tau = self.time_constant / interval.by.diffusion
        per_ampere = self.share * STEADY * tau / (interval.cell.capacity_c * interval.by.capacity)
        return surface(solver, start, per_ampere * interval.begin, per_ampere * interval.end, tau)

    def curve_lag(self, state: tuple[Value, ...]) -> Value:
        return behind(state)
