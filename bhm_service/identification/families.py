"""Both cell models as functions of what a fit looks for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, Self

import numpy as np

from bhm_service.battery.battery_file import ModelName
from bhm_service.battery.cell import CellModel
from bhm_service.battery.chem import X_N_MAX, Chem, nernst
from bhm_service.battery.circ import Circ
from bhm_service.battery.effects import SurfaceLag
from bhm_service.battery.ocv import MOST_REST_V, CubicCapacitance, CurveRest, MonotoneSpline
from bhm_service.battery.redlich_kister import horner, polynomial
from bhm_service.identification.curve import BENDS, KNOTS, LASTING, LASTING_S, LOW_SOC, BentCurve, spline_of, table_of
from bhm_service.identification.extras import OHM_C, Extras
from bhm_service.identification.unknowns import Block, Unknowns, numbers, positive
from bhm_service.units import SECONDS_PER_HOUR, Array

ORDER = 13  # of the Redlich-Kister series: A_0 .. A_13
SURFACE_FRACTION = 0.1  # Daigle & Kulkarni 2013; not told apart from the diffusion time by any recording
_AMPLITUDE = 1e4  # [J/mol] unit of A_k in the fits
_RIDGE_V = 1e-3  # [V] weight that keeps A_k small where the curve does not need them: left free they reach 1e8 J/mol
_FAR = 400.0  # reach of A_k, in that unit
_FAR_OFF = (4.0, 0.25)  # times the time constants: what a fit may have missed behind a hill
_LAGS_S = (1.0, 8.0, 40.0)  # [s] of Chem's ohmic drop and overpotentials: which is which is tried


def _put(unknowns: Unknowns, x: Array, name: str, number: float | Array) -> None:
    """Put one block of a vector somewhere, inside its bounds."""
    where = unknowns.slice_of(name)
    x[where] = np.clip(number, unknowns.low[where] + 0.01, unknowns.high[where] - 0.01)


@dataclass(frozen=True, kw_only=True)
class Family(ABC):
    """A cell model whose numbers are not known yet, around an open-circuit curve."""

    name: ClassVar[ModelName]
    time_constants: ClassVar[tuple[str, ...]]  # blocks that a fit may have to start from far away
    shaping: ClassVar[tuple[str, ...]] = ()  # blocks of the open-circuit curve, which move no state
    capacity_c: float
    curve: MonotoneSpline
    curve_sd: float  # [V] how well the curve is known
    extras: Extras = Extras()

    @property
    def ohm(self) -> float:
        """Size of a LiPo cell's resistance at this capacity. [Ohm]"""
        return OHM_C * SECONDS_PER_HOUR / self.capacity_c

    def with_extras(self, extras: Extras) -> Self:
        """The same with other effects."""
        return replace(self, extras=extras)

    def finer(self, *, recorded: bool) -> Self | None:
        """The same model in a form that follows curves with steps; None where it has no other.

        ``recorded``: whether the curve is a slow discharge's, or carried on from loads to none.
        """
        return None

    @abstractmethod
    def blocks(self) -> list[Block]:
        """What is to be found of the cell."""

    @abstractmethod
    def cell(self, values: Mapping[str, Array]) -> CellModel:
        """Cells of a set of values, each (M, size)."""

    @abstractmethod
    def finished(self, values: Mapping[str, Array]) -> CellModel:
        """The one cell of a set of values (1, size), as the battery file holds it."""

    def parameter_sd(self, values: Mapping[str, Array], sd: Mapping[str, float]) -> dict[str, float]:
        """Standard deviations of the cell's parameters out of those of the blocks."""
        return dict(sd)

    def elsewhere(self, unknowns: Unknowns, x: Array) -> list[Array]:
        """Other places from which a fit that came to ``x`` may find a better one: time constants far from it."""
        found = []
        for factor in _FAR_OFF:
            other = x.copy()
            for name in self.time_constants:
                if name in unknowns.names:
                    _put(unknowns, other, name, x[unknowns.slice_of(name)] + np.log(factor))
            found.append(other)
        return found

    def read_at(self, states: tuple[Array, ...]) -> Array:
        """State of charge at which the curve is read in these states (..., T)."""
        return states[0]

    def exchanged(self, unknowns: Unknowns, x: Array) -> list[Array]:
        """Places near as likely as ``x``, where parts of the model have each other's time constants."""
        return []

    def labelled(self, unknowns: Unknowns, x: Array) -> Array:
        """The same cell under the names that are usual, where a model's equations do not tell two parts apart."""
        return x

    @abstractmethod
    def stages(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        """The paper's order: what a one-C discharge gives, then what a variable load gives."""


@dataclass(frozen=True, kw_only=True)
class CircFamily(Family):
    """Circ around a curve: as a spline that may bend, or as the paper's cubic."""

    name = "circ"
    time_constants = ("c_sp", "slow_time", "slower_time", "graphite_time", "surface_time")
    shaping = ("bends", "v_0", "cubic")
    ocv: Literal["spline", "cubic"] = "spline"

    def finer(self, *, recorded: bool) -> Self | None:
        return None if self.extras.surface else replace(self, extras=replace(self.extras, surface=True))

    def blocks(self) -> list[Block]:
        ohm = self.ohm
        farad = LASTING_S / (LASTING * ohm)  # whatever the resistance turns out to be
        found = [
            positive("r_s", ohm, 0.02 * ohm, 20.0 * ohm, 3.0),
            positive("r_sp0", LASTING * ohm, 1e-3 * ohm, 20.0 * ohm, 4.0),
            positive("r_sp1", 0.02 * ohm, 1e-6 * ohm, 5.0 * ohm, 20.0),
            replace(numbers("r_sp2", np.array([5.0]), 4.0, 5.0), high=np.array([25.0])),  # NCA: some 17
            positive("c_sp", farad, 1e-3 * farad, 300.0 * farad, 5.0),
        ]
        if self.ocv == "spline":
            return [*found, numbers("bends", np.zeros(BENDS.size), self.curve_sd, 8.0 * self.curve_sd)]
        return [*found, *self._cubic_blocks()]

    def _cubic_blocks(self) -> list[Block]:
        soc = np.linspace(0.03, 1.0, 200)
        volts = np.asarray(self.curve.voltage(soc))
        charge = 1.02 - (1.0 - soc)  # q_b over C_max
        # C_b / C_max = q_b / V: a cubic in SoC that is 1.02 / V_0 at SoC 1.
        v_0 = float(np.asarray(self.curve.voltage(1.0)))
        design = np.column_stack([soc**3 - 1.0, soc**2 - 1.0, soc - 1.0]) * volts[:, None] ** 2 / charge[:, None]
        goal = (charge / volts - 1.02 / v_0) * volts**2 / charge
        found = np.linalg.lstsq(design, goal, rcond=None)[0]
        return [
            numbers("v_0", np.array([v_0]), 0.01, 0.08),
            numbers("cubic", found, 0.3, 2.0),
        ]

    def read_at(self, states: tuple[Array, ...]) -> Array:
        if not self.extras.surface:
            return states[0]
        return np.asarray(states[0] - sum(states[-len(SurfaceLag.state_names) :]))

    def cubic_off_v(self) -> float:
        """By how much the paper's cubic misses the curve at its best, RMS above `LOW_SOC`. [V]"""
        soc = np.linspace(LOW_SOC, 1.0, 200)
        start = {b.name: b.start[None, :] for b in self._cubic_blocks()}
        off = np.ravel(self._cubic(start["v_0"], start["cubic"]).voltage(soc)) - np.asarray(self.curve.voltage(soc))
        return float(np.sqrt(np.mean(off**2)))

    def cell(self, values: Mapping[str, Array]) -> Circ:
        names = ("r_s", "r_sp0", "r_sp1", "r_sp2", "c_sp")
        numbers_ = {name: values[name] for name in names}
        if self.ocv == "spline":
            return Circ(ocv=BentCurve(table_of(self.curve), values["bends"]), c_max=self.capacity_c, **numbers_)
        return Circ(ocv=self._cubic(values["v_0"], values["cubic"]), c_max=self.capacity_c, **numbers_)

    def _cubic(self, v_0: Array, cubic: Array) -> CubicCapacitance:
        c = self.capacity_c
        return CubicCapacitance(
            c_max=c, q_max=1.02 * c, v_0=v_0, cbp0=c * cubic[:, :1], cbp1=c * cubic[:, 1:2], cbp2=c * cubic[:, 2:]
        )

    def finished(self, values: Mapping[str, Array]) -> Circ:
        one = {name: float(values[name][0, 0]) for name in ("r_s", "r_sp0", "r_sp1", "r_sp2", "c_sp")}
        if self.ocv == "spline":
            return Circ(
                ocv=spline_of(BentCurve(table_of(self.curve), values["bends"][0])), c_max=self.capacity_c, **one
            )
        c, cubic = self.capacity_c, values["cubic"][0]
        ocv = CubicCapacitance(
            c_max=c, q_max=1.02 * c, v_0=float(values["v_0"][0, 0]),
            cbp0=c * float(cubic[0]), cbp1=c * float(cubic[1]), cbp2=c * float(cubic[2]),
        )  # fmt: skip
        return Circ(ocv=ocv, c_max=c, **one)

    def stages(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        return (
            ("one-C", ("r_s", "r_sp0", "r_sp1", "r_sp2", "c_sp")),
            ("variable", ("r_s", *Extras.names)),
        )


@dataclass(frozen=True, kw_only=True)
class ChemFamily(Family):
    """Chem around a curve: its Redlich-Kister series bends with the fit, what that leaves of the curve does not."""

    name = "chem"
    time_constants = ("t_diffusion", "tau_p", "slow_time", "slower_time")
    shaping = ("u_0", "a_p")
    with_rest: bool = False  # of the curve, that the series leaves

    def finer(self, *, recorded: bool) -> Self | None:
        # Of a curve that is carried on from loads the series leaves what the loads do as well.
        return replace(self, with_rest=True) if recorded and not self.with_rest else None

    def blocks(self) -> list[Block]:
        ohm, rate = self.ohm, self.capacity_c / SECONDS_PER_HOUR
        u_0, a = self._series()
        reach = max(self.curve_sd / _RIDGE_V, 1.0)
        return [
            positive("t_diffusion", 200.0, 0.5, 2e4, 4.0),
            positive("r_o", 0.7 * ohm, 0.02 * ohm, 20.0 * ohm, 3.0),
            positive("tau_o", 0.2, 0.02, 20.0, 4.0),
            positive("i_p0", 3.0 * rate, 0.02 * rate, 500.0 * rate, 6.0),
            positive("i_n0", 20.0 * rate, 0.02 * rate, 500.0 * rate, 6.0),
            positive("tau_p", 20.0, 0.05, 2000.0, 4.0),
            positive("tau_n", 100.0, 0.05, 2000.0, 4.0),
            numbers("u_0", np.array([u_0]), 0.5, 1.0),
            replace(numbers("a_p", a, 10.0 * reach, _FAR), series=True),
        ]

    def read_at(self, states: tuple[Array, ...]) -> Array:
        return states[0] - (1.0 - SURFACE_FRACTION) / X_N_MAX * states[1]

    def elsewhere(self, unknowns: Unknowns, x: Array) -> list[Array]:
        found = super().elsewhere(unknowns, x)
        one, other = unknowns.slice_of("i_p0"), unknowns.slice_of("i_n0")
        for ohmic in range(len(_LAGS_S)):
            lags = (_LAGS_S[ohmic], *(lag for k, lag in enumerate(_LAGS_S) if k != ohmic))
            for currents in ((x[one], x[other]), (x[other], x[one])):
                moved = x.copy()
                moved[one], moved[other] = currents
                for name, lag in zip(("tau_o", "tau_n", "tau_p"), lags, strict=True):
                    _put(unknowns, moved, name, float(np.log(lag)))
                found.append(moved)
        return found

    def exchanged(self, unknowns: Unknowns, x: Array) -> list[Array]:
        one, other = unknowns.slice_of("tau_p"), unknowns.slice_of("tau_n")
        moved = x.copy()
        moved[one], moved[other] = x[other], x[one]
        return [moved]

    def labelled(self, unknowns: Unknowns, x: Array) -> Array:
        # The equations of both electrodes are the same: the positive one is taken to be the slower, as in what ships.
        one, other = unknowns.slice_of("tau_p"), unknowns.slice_of("tau_n")
        if x[one] >= x[other]:
            return x
        swapped = x.copy()
        for positive_, negative in (("tau_p", "tau_n"), ("i_p0", "i_n0")):
            a, b = unknowns.slice_of(positive_), unknowns.slice_of(negative)
            swapped[a], swapped[b] = x[b], x[a]
        return swapped

    def _series(self) -> tuple[float, Array]:
        soc = np.linspace(0.0, 1.0, 401)
        y = 2.0 * X_N_MAX * soc - 1.0
        target = np.asarray(self.curve.voltage(soc)) - nernst(X_N_MAX * soc)
        basis = [np.asarray(horner(polynomial([0.0] * k + [_AMPLITUDE]), -y)) for k in range(ORDER + 1)]
        # U_0 is held to where cells are: any other value only shifts the series.
        rows = [np.column_stack([np.ones_like(y), *basis]), np.diag([0.02, *([_RIDGE_V] * (ORDER + 1))])]
        goal = np.concatenate([target, [0.02 * 4.0], np.zeros(ORDER + 1)])
        solved = np.linalg.lstsq(np.vstack(rows), goal, rcond=None)[0]
        return float(np.clip(solved[0], 2.1, 4.9)), solved[1:]

    @cached_property
    def _rest(self) -> CurveRest | None:
        if not self.with_rest:
            return None
        u_0, a = self._series()
        x_s = X_N_MAX * KNOTS
        by_series = u_0 + nernst(x_s) + np.asarray(horner(polynomial(tuple(_AMPLITUDE * a)), 1.0 - 2.0 * x_s))
        left = np.clip(np.asarray(self.curve.voltage(KNOTS)) - by_series, -MOST_REST_V, MOST_REST_V)
        return CurveRest(tuple(KNOTS.tolist()), tuple(left.tolist()))

    def cell(self, values: Mapping[str, Array]) -> Chem:
        names = ("t_diffusion", "r_o", "tau_o", "i_p0", "i_n0", "tau_p", "tau_n", "u_0")
        series = _AMPLITUDE * values["a_p"]
        return Chem(
            q_max=self.capacity_c / X_N_MAX,
            surface_fraction=SURFACE_FRACTION,
            a_p=tuple(series[:, k : k + 1] for k in range(series.shape[1])),
            a_n=(0.0,),
            curve_rest=self._rest,
            **{name: values[name] for name in names},
        )

    def finished(self, values: Mapping[str, Array]) -> Chem:
        names = ("t_diffusion", "r_o", "tau_o", "i_p0", "i_n0", "tau_p", "tau_n", "u_0")
        return Chem(
            q_max=self.capacity_c / X_N_MAX,
            surface_fraction=SURFACE_FRACTION,
            a_p=tuple(float(a) for a in _AMPLITUDE * values["a_p"][0]),
            a_n=(0.0,),
            curve_rest=self._rest,
            **{name: float(values[name][0, 0]) for name in names},
        )

    def stages(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        return (
            ("one-C", ("r_o", "t_diffusion", "i_p0", "i_n0", "tau_p", "tau_n")),
            ("variable", ("r_o", "tau_o", *Extras.names)),
        )
