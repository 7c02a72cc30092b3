"""The second world: the same sheets with PyBaMM's single particle model with electrolyte as the cells.

Load, sensors and logs are the first world's; so are the currents, which its cells asked for with this one's rested
voltage and resistance. Voltages, temperatures and lab recordings are PyBaMM's, and pilots land by its voltages. Needs
the extra ``truth``.

Parameter sets: Ai et al. 2020 and Marquis et al. 2019 (LiCoO2 pouches), Mohtat et al. 2020 (NMC pouch) and O'Kane et
al. 2022 (NMC 21700), as they come with PyBaMM, varied.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bhm_service.errors import BadInputError
from sim.concealed.flying import REST_MINUTES, SECOND, Flown, contact_along
from sim.concealed.knobs import Knobs
from sim.concealed.lab import LabRun, load_profile
from sim.concealed.load import REST_S
from sim.concealed.packs import GRID, SERIES, Array, Pack

_SETS = {
    "Ai2020": "LiCoO2 pouch (Ai 2020)",
    "Marquis2019": "LiCoO2 pouch (Marquis 2019)",
    "Mohtat2020": "NMC pouch (Mohtat 2020)",
    "OKane2022": "NMC 21700 (O'Kane 2022)",
}
_ALIKE_S = 120  # over which a cell's resistance to sudden changes is taken to be the same
_LEAST_A2 = 1e-12  # [A^2] of changes that tell anything
_KELVIN = 273.15
_LAB_K = 298.15
_EMPTY_V = 3.0  # where a bench stops
_FLOOR_V, _CEILING_V = 1.5, 4.8  # events far outside: a flight must not end inside the solver


@dataclass(frozen=True, slots=True)
class _Conditions:
    """What one solution of one cell stands in."""

    soc: float
    exchange: float = 1.0
    diffusion: float = 1.0
    heats: bool = False
    start_k: float = _LAB_K
    ambient_k: float = _LAB_K
    cooling: float = 1.0


class PorousPack:
    """Cells of one parameter set, six in series, so many in parallel as the capacity asks for.

    Raises BadInputError where PyBaMM is not installed.
    """

    def __init__(self, rng: np.random.Generator, like: Pack) -> None:
        try:
            import pybamm
        except ImportError:
            hint = "pip install 'bhm-service[truth]'"
            raise BadInputError("the porous world", "PyBaMM is not here", hint) from None
        pybamm.set_logging_level("ERROR")
        self._pybamm: Any = pybamm
        self._solved: dict[tuple[bytes, float, _Conditions], tuple[Array, Array]] = {}
        self.set = str(rng.choice(sorted(_SETS)))
        self._diffusion = float(rng.uniform(0.8, 1.4))
        self._exchange = float(rng.uniform(0.8, 1.4))
        self._cooling_w_m2k = float(rng.uniform(8.0, 25.0))
        nominal = float(self._values()["Nominal cell capacity [A.h]"])
        slow_v, used = self._slow(nominal)
        self.capacity_ah = used  # of one cell, as the slow discharge tells
        self.parallel = like.capacity_ah / used
        self.pack = self._ladder_like(like, slow_v)

    @property
    def entropic(self) -> bool:
        """Whether the open-circuit voltage of its cells moves with temperature."""
        values = self._values()
        terms = [values[f"{electrode} electrode OCP entropic change [V.K-1]"] for electrode in ("Negative", "Positive")]
        return any(callable(term) or term != 0.0 for term in terms)

    def _values(self) -> Any:
        values = self._pybamm.ParameterValues(self.set)
        for electrode in ("Negative", "Positive"):
            self._scale(values, f"{electrode} particle diffusivity [m2.s-1]", self._diffusion)
            self._scale(values, f"{electrode} electrode exchange-current density [A.m-2]", self._exchange)
        return values

    @staticmethod
    def _scale(values: Any, name: str, factor: float) -> None:
        was = values[name]
        if callable(was):

            def scaled(*given: Any) -> Any:
                return factor * was(*given)

            values[name] = scaled
        else:
            values[name] = factor * was

    def solve(self, current_a: Array, dt: float, given: _Conditions) -> tuple[Array, Array]:
        """Voltage [V] and temperature [K] of one cell under a current sampled every ``dt``.

        Raises pybamm.SolverError where the cell is empty before the end.
        """
        # Worlds that differ in wires, sensors or a later flight only have the same cells: they are solved once.
        asked = (current_a.tobytes(), dt, given)
        if asked not in self._solved:
            self._solved[asked] = self._solution(current_a, dt, given)
        volts, kelvin = self._solved[asked]
        if np.isnan(volts).any():
            raise self._pybamm.SolverError("the cell was empty before the end")
        return volts, kelvin

    def _solution(self, current_a: Array, dt: float, given: _Conditions) -> tuple[Array, Array]:
        """Voltage and temperature, NaN from where the cell is empty."""
        pb, values = self._pybamm, self._values()
        values.set_initial_state(given.soc)
        time = dt * np.arange(len(current_a), dtype=float)
        values["Current function [A]"] = pb.Interpolant(time, current_a, pb.t)
        values["Lower voltage cut-off [V]"], values["Upper voltage cut-off [V]"] = _FLOOR_V, _CEILING_V
        for electrode in ("Negative", "Positive"):
            self._scale(values, f"{electrode} electrode exchange-current density [A.m-2]", given.exchange)
            self._scale(values, f"{electrode} particle diffusivity [m2.s-1]", given.diffusion)
        values["Initial temperature [K]"], values["Ambient temperature [K]"] = given.start_k, given.ambient_k
        values["Total heat transfer coefficient [W.m-2.K-1]"] = self._cooling_w_m2k * given.cooling
        model = pb.lithium_ion.SPMe({"thermal": "lumped" if given.heats else "isothermal"})
        simulation = pb.Simulation(model, parameter_values=values, solver=pb.IDAKLUSolver())
        solution = simulation.solve([0.0, float(time[-1])], t_interp=time)
        volts = np.asarray(solution["Voltage [V]"](time), dtype=float)
        kelvin = np.asarray(solution["Volume-averaged cell temperature [K]"](time), dtype=float)
        return volts, kelvin

    def _slow(self, nominal: float) -> tuple[Array, float]:
        """C/50 until it is empty: voltage once a minute, and the charge given [Ah]."""
        # Some sets hold a third more than their name says.
        volts, current = self._until_empty(np.full(4500, nominal / 50.0), 60.0)
        return volts, float(current.sum()) / 60.0

    def _until_empty(self, current: Array, dt: float, rest: int = 0) -> tuple[Array, Array]:
        """Voltage of a cell under a current, and the current, cut where the cell is empty; then samples of rest."""
        volts, _ = self._solution(current, dt, _Conditions(1.0))
        empty = np.isnan(volts) | (volts < _EMPTY_V)
        whole = np.concatenate([current[: int(np.argmax(empty)) if empty.any() else len(current)], np.zeros(rest)])
        return self.solve(whole, dt, _Conditions(1.0))[0], whole

    def _ladder_like(self, like: Pack, slow_v: Array) -> Pack:
        """The first world's pack with this one's rested voltage and resistance: it asks for the currents."""
        left = 1.0 - np.arange(len(slow_v)) / len(slow_v)
        ocv = np.interp(GRID, left[::-1], slow_v[::-1])
        outside = GRID > 1.0
        ocv[outside] = slow_v[0] + 0.6 * (GRID[outside] - 1.0)
        return replace(
            like,
            chemistry=_SETS[self.set],
            ocv_v=ocv,
            hover_c_rate=min(like.hover_c_rate, 1.75),
            capacity=np.ones(SERIES),
        )

    # ---- recordings ---------------------------------------------------------------------------------------------

    def recordings(self, rng: np.random.Generator) -> dict[str, LabRun]:
        """The slow discharge, the 1C one, and a hover-like load with a rest."""
        noise = float(rng.uniform(2e-3, 6e-3))
        q = self.pack.capacity_ah
        slow = np.full(2950, q / 50.0)
        one = np.concatenate([np.zeros(1), np.full(3450, q)])
        variable = load_profile(rng, self.pack)
        out = {}
        for name, asked, dt, rest in (
            ("slow", slow, 60.0, 0),
            ("one_c", one, 1.0, 300),
            ("variable", variable, 1.0, 0),
        ):
            volts, given = self._until_empty(asked / self.parallel, dt, rest)
            current, n = given * self.parallel, len(volts)
            seen = SERIES * volts + noise * rng.standard_normal(n)
            time = dt * np.arange(n, dtype=float)
            out[name] = LabRun(time, np.round(current, 3), seen, np.full(n, _LAB_K - _KELVIN))
        return out

    def flown(self, flown: Flown, knobs: Knobs, twins: tuple[Knobs, ...]) -> Flown:
        """The same flights with this world's voltages and temperatures."""
        voltage, core = np.full_like(flown.voltage_v, np.nan), np.full_like(flown.core_c, np.nan)
        twins_v, rested = np.full_like(flown.twins_v, np.nan), np.empty(len(flown.ends))
        cells_v = np.full_like(flown.cells_v, np.nan)
        steps = voltage.shape[1]
        contacts = [contact_along(world, flown.load.plan.begins, steps) for world in (knobs, *twins)]
        for f, end in enumerate(flown.ends.tolist()):
            seconds = np.arange(0, end, SECOND)
            current = flown.current_a[f, :end]
            told = (flown.told_a[f, :end] - knobs.sensors.current_offset_a[f]) / knobs.sensors.current_gain[f]
            cells, kelvin, rested[f] = self._fly(knobs, f, current[seconds])
            cells_v[f, : len(seconds)], volts = cells, cells.sum(axis=1)
            voltage[f, :end] = between(current, seconds, volts) - contacts[0][f, :end] * current
            core[f, : len(seconds)] = kelvin - _KELVIN
            for which, twin in enumerate(twins):
                carried = told * knobs.sensors.current_gain[f] + knobs.sensors.current_offset_a[f]
                carried = (carried - twin.sensors.current_offset_a[f]) / twin.sensors.current_gain[f]
                carried = carried + twin.sensors.unseen_a[f]
                other, _, _ = self._fly(twin, f, carried[seconds])
                volts = other.sum(axis=1)
                twins_v[which, f, :end] = between(carried, seconds, volts) - contacts[which + 1][f, :end] * carried
        unknown = np.full_like(flown.empty_voltage_s, np.nan)
        return replace(
            flown,
            voltage_v=voltage,
            twins_v=twins_v,
            cells_v=cells_v,
            core_c=core,
            surface_c=core,
            rested_v=rested,
            empty_voltage_s=unknown,
        )

    def _fly(self, world: Knobs, f: int, current_a: Array) -> tuple[Array, Array, float]:
        """Voltages of the cells (T, 6), temperature, and the pack's voltage 20 min after landing."""
        rest = np.zeros(60 * REST_MINUTES - round(REST_S))
        cells, heat = world.cells, world.heat
        whole = np.concatenate([current_a, rest]) / self.parallel
        kinds: dict[tuple[float, float, float], list[int]] = {}
        for c in range(SERIES):
            own = (float(cells.soc[f, c]), float(cells.capacity[f, c]), float(cells.resistance[f, c]))
            kinds.setdefault(own, []).append(c)
        found, kelvin = np.zeros((len(whole), SERIES)), np.zeros(len(whole))
        for (soc, capacity, resistance), alike in kinds.items():
            given = _Conditions(
                soc=min(soc, 1.0),
                exchange=float(cells.exchange[f].mean()) / resistance,
                diffusion=float(cells.diffusion[f].mean()),
                heats=heat.heats,
                start_k=float(heat.start_c[f]) + _KELVIN,
                ambient_k=float(heat.ambient_c[f]) + _KELVIN,
                cooling=heat.cooling,
            )
            volts, kelvin = self.solve(whole / capacity, 1.0, given)
            volts = volts - cells.hysteresis_v * turned(whole / (self.capacity_ah * capacity), cells.hysteresis_width)
            found[:, alike] = volts[:, None]
        n = len(current_a)
        return found[:n], kelvin[:n], float(found[-1].sum())


def turned(c_rate: Array, width: float) -> Array:
    """How far, once a second, a discharge [1/h] has gone round the loop since the last charge: from 0 up to 1."""
    given = np.concatenate([np.zeros(1), np.cumsum(c_rate[:-1])]) / 3600.0
    return np.asarray(1.0 - np.exp(-given / width))


def between(current_a: Array, seconds: Array, volts: Array) -> Array:
    """The voltage between the ``seconds`` at which it was solved for, under a current that is known there as well.

    Cells of this model have no double layer: within a second they follow the current by their resistance to sudden
    changes, which the changes from one second to the next tell. Without it sensors would read a voltage that is
    smoother than the current, which is like none of a real pack, and much like a time skew.
    """
    steps_a, steps_v = np.diff(current_a[seconds]), np.diff(volts)
    around = np.ones(_ALIKE_S)
    asked, given = (np.convolve(steps_a * other, around, mode="same") for other in (steps_a, -steps_v))
    usual = max(steps_a @ steps_a / steps_a.size, _LEAST_A2)  # where nothing changes it is the whole flight's
    ohm = (given + usual * given.sum() / max(asked.sum(), _LEAST_A2)) / (asked + usual)
    grid = np.arange(current_a.size)
    beside_a = current_a - np.interp(grid, seconds, current_a[seconds])
    found: Array = np.interp(grid, seconds, volts) - np.interp(grid, seconds[1:], ohm) * beside_a
    return found
