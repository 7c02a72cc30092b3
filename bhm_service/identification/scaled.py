"""A known cell as a family: scaled to a pack and bent by what cells of one kind differ by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from bhm_service.battery.battery_file import Joined
from bhm_service.battery.chem import X_N_MAX, Chem
from bhm_service.battery.circ import Circ
from bhm_service.battery.effects import Effect
from bhm_service.battery.redlich_kister import horner, polynomial
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.identification.curve import BENDS, BentCurve, spline_of, table_of
from bhm_service.identification.extras import Extras
from bhm_service.identification.families import Family
from bhm_service.identification.unknowns import Block, numbers, positive
from bhm_service.units import Array

_AMPLITUDE = 1e4  # [J/mol]
_BEND_RIDGE = 1e-3  # [V] weight that keeps coefficients small where the curve does not need them
_ALIKE_WITHIN, _OWN = 0.25, 0.1  # of state of charge; the share of the variance that each place has to itself


def _shapes() -> Array:
    """How curves of cells of different make differ: smoothly, and by a little from place to place."""
    apart = BENDS[:, None] - BENDS[None, :]
    alike = (1.0 - _OWN) * np.exp(-0.5 * (apart / _ALIKE_WITHIN) ** 2) + _OWN * np.eye(BENDS.size)
    return np.asarray(np.linalg.cholesky(alike))


_SHAPES = _shapes()


@dataclass(frozen=True, slots=True, kw_only=True)
class Known(Extras):
    """Effects that the battery file has already; they are not looked for."""

    effects_known: tuple[Joined, ...] = ()

    def effects(self, values: Mapping[str, Array]) -> list[Effect]:
        return [j.effect for j in self.effects_known]


@dataclass(frozen=True, kw_only=True)
class ScaledFamily(Family):
    """A known cell, scaled to the pack: its capacity, its resistances, and a curve that may bend."""

    uncertainty: Uncertainty
    capacity_sd: float  # of the logarithm

    polarisation: ClassVar[tuple[str, ...]]  # scales beside the ohmic resistance
    time_constants = ()

    def _scaled_blocks(self, resistance: str, ohm: float) -> list[Block]:
        u = self.uncertainty
        reach = np.exp(4.0 * max(u.resistance, 0.1))
        return [
            positive(
                "capacity", self.capacity_c, 0.2 * self.capacity_c, 5.0 * self.capacity_c, np.exp(self.capacity_sd)
            ),
            positive(resistance, ohm, ohm / reach, ohm * reach, float(np.exp(u.resistance))),
            *(positive(name, 1.0, 0.05, 20.0, float(np.exp(u.polarisation))) for name in self.polarisation),
            numbers("shape", np.zeros(BENDS.size), 1.0, 8.0),
        ]

    def bends(self, values: Mapping[str, Array]) -> Array:
        """What the curve is moved by at `BENDS` [V], (M, 21)."""
        return self.curve_sd * values["shape"] @ _SHAPES.T

    def stages(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        return ()


@dataclass(frozen=True, kw_only=True)
class ScaledCirc(ScaledFamily):
    """Circ, scaled."""

    name = "circ"
    polarisation = ("polarisation",)
    known: Circ

    @property
    def _ratio(self) -> float:
        return self.capacity_c / float(np.asarray(self.known.c_max))

    def blocks(self) -> list[Block]:
        return self._scaled_blocks("r_s", float(np.asarray(self.known.r_s)) / self._ratio)

    def cell(self, values: Mapping[str, Array]) -> Circ:
        return self._of(values, BentCurve(table_of(self.curve), self.bends(values)))

    def finished(self, values: Mapping[str, Array]) -> Circ:
        one = {name: float(v.ravel()[0]) for name, v in values.items() if name != "shape"}
        return self._of(one, spline_of(BentCurve(table_of(self.curve), self.bends(values)[0])))

    def _of(self, values: Mapping[str, Array] | Mapping[str, float], curve: object) -> Circ:
        pair = values["polarisation"] / self._ratio
        return replace(
            self.known,
            ocv=curve,  # type: ignore[arg-type]
            c_max=values["capacity"],
            r_s=values["r_s"],
            r_sp0=self.known.r_sp0 * pair,
            r_sp1=self.known.r_sp1 * pair,
            c_sp=self.known.c_sp * self._ratio,
        )

    def parameter_sd(self, values: Mapping[str, Array], sd: Mapping[str, float]) -> dict[str, float]:
        cell, share = self.finished(values), sd["polarisation"] / float(values["polarisation"][0, 0])
        pair = {name: float(getattr(cell, name)) * share for name in ("r_sp0", "r_sp1")}
        return {"c_max": sd["capacity"], "r_s": sd["r_s"], **pair}


@dataclass(frozen=True, kw_only=True)
class ScaledChem(ScaledFamily):
    """Chem, scaled."""

    # Two scales: with one for both, Chem would read the capacity out of how fast the voltage settles.
    name = "chem"
    polarisation = ("kinetics", "diffusion")
    known: Chem

    @property
    def _ratio(self) -> float:
        return self.capacity_c / (X_N_MAX * float(np.asarray(self.known.q_max)))

    def blocks(self) -> list[Block]:
        return self._scaled_blocks("r_o", float(np.asarray(self.known.r_o)) / self._ratio)

    def _bending(self) -> Array:
        """What bends of the curve add to the coefficients [J/mol], (order + 1, bends)."""
        soc = np.linspace(0.0, 1.0, 201)
        y = 2.0 * X_N_MAX * soc - 1.0
        order = len(self.known.a_p)
        basis = [np.asarray(horner(polynomial([0.0] * k + [_AMPLITUDE]), -y)) for k in range(order)]
        hats = np.array([np.interp(soc, BENDS, unit) for unit in np.eye(BENDS.size)]).T
        rows = np.vstack([np.column_stack(basis), _BEND_RIDGE * np.eye(order)])
        goal = np.vstack([hats, np.zeros((order, BENDS.size))])
        return np.asarray(_AMPLITUDE * np.linalg.lstsq(rows, goal, rcond=None)[0])

    def cell(self, values: Mapping[str, Array]) -> Chem:
        added = (self._moved() + self.bends(values)) @ self._bending().T
        return self._of(values, tuple(a + added[:, k : k + 1] for k, a in enumerate(self.known.a_p)))

    def _moved(self) -> Array:
        """By how much the curve is not the known cell's own. [V]"""
        moved: Array = np.asarray(self.curve.voltage(BENDS)) - np.asarray(self.known.open_circuit(BENDS))
        return moved

    def finished(self, values: Mapping[str, Array]) -> Chem:
        one = {name: float(v.ravel()[0]) for name, v in values.items() if name != "shape"}
        added = self._bending() @ (self._moved() + self.bends(values)[0])
        return self._of(one, tuple(float(np.asarray(a)) + float(b) for a, b in zip(self.known.a_p, added, strict=True)))

    def _of(self, values: Mapping[str, Array] | Mapping[str, float], a_p: tuple[object, ...]) -> Chem:
        return replace(
            self.known,
            q_max=values["capacity"] / X_N_MAX,
            r_o=values["r_o"],
            i_p0=self.known.i_p0 * self._ratio * values["kinetics"],
            i_n0=self.known.i_n0 * self._ratio * values["kinetics"],
            t_diffusion=self.known.t_diffusion / values["diffusion"],
            a_p=a_p,  # type: ignore[arg-type]
        )

    def parameter_sd(self, values: Mapping[str, Array], sd: Mapping[str, float]) -> dict[str, float]:
        cell = self.finished(values)
        share = {name: sd[name] / float(values[name][0, 0]) for name in self.polarisation}
        return {
            "q_max": sd["capacity"] / X_N_MAX,
            "r_o": sd["r_o"],
            "i_p0": float(cell.i_p0) * share["kinetics"],
            "i_n0": float(cell.i_n0) * share["kinetics"],
            "t_diffusion": float(cell.t_diffusion) * share["diffusion"],
        }
