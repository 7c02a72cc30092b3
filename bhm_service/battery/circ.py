"""Circ: the two-capacitor equivalent circuit (paper Fig. 11, Table 3; Jiang et al. 2020).

The paper's states are the charges q_b and q_sp. Here they are carried as SoC = 1 - (q_max - q_b) / C_max and
V_sp = q_sp / C_sp: the same two numbers in scales of one and of tens of millivolts, so that a covariance over them
is well conditioned and a faded capacity changes how fast SoC falls, not where it stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.dynamics import Solver
from bhm_service.battery.ocv import OpenCircuit
from bhm_service.battery.parameters import parameter
from bhm_service.units import SECONDS_PER_HOUR, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class Circ:
    """Equivalent circuit of one cell; every number may be an array that broadcasts against the states."""

    ocv: OpenCircuit
    c_max: Value = parameter("C_max", "Ah", 0.05, 500.0, "charge between full and empty", scale=SECONDS_PER_HOUR)
    r_s: Value = parameter("R_s", "ohm", 1e-5, 1.0, "ohmic resistance")
    r_sp0: Value = parameter("R_sp0", "ohm", 0.0, 1.0, "surface overpotential resistance, constant part")
    r_sp1: Value = parameter("R_sp1", "ohm", 0.0, 1.0, "surface overpotential resistance, part that grows")
    r_sp2: Value = parameter("R_sp2", "1", 0.0, 40.0, "how steeply it grows with depth of discharge")
    c_sp: Value = parameter("C_sp", "F", 1.0, 1e7, "surface capacitance")

    @property
    def state_names(self) -> tuple[str, ...]:
        return ("soc", "v_sp")

    @property
    def capacity_c(self) -> Value:
        return self.c_max

    def rest(self, soc: Value) -> tuple[Value, ...]:
        return (soc, 0.0 * soc)

    def advance(
        self, solver: Solver, start: tuple[Value, ...], begin: Value, end: Value, by: Modifiers
    ) -> tuple[Value, ...]:
        per_ampere = -1.0 / (self.c_max * by.capacity)
        soc = solver.counter(start[0], begin * per_ampere, end * per_ampere)
        unscaled = self._unscaled(soc)
        r_sp = _scaled(unscaled, by)
        drop_begin = begin * _scaled(solver.begin(self._unscaled(start[0]), unscaled), by)
        v_sp = solver.lag(start[1], drop_begin, end * r_sp, self.c_sp * r_sp)
        return (soc, v_sp)

    def surface_resistance(self, soc: Value, by: Modifiers) -> Value:
        """R_sp [Ohm]; its one pair stands for charge transfer and diffusion together, so it takes half of each."""
        return _scaled(self._unscaled(soc), by)

    def _unscaled(self, soc: Value) -> Value:
        depth = np.minimum(np.maximum(1.0 - soc, -0.2), 1.2)
        return self.r_sp0 + self.r_sp1 * np.exp(self.r_sp2 * depth)

    def emf(self, state: tuple[Value, ...], by: Modifiers) -> Value:
        return self.ocv.voltage(state[0]) - state[1]

    def polarisation(self, state: tuple[Value, ...], by: Modifiers) -> Value:
        return state[1]

    def series_resistance(self, by: Modifiers) -> Value:
        return self.r_s * by.resistance

    def ohmic_resistance(self, by: Modifiers) -> Value:
        return self.r_s * by.resistance

    def open_circuit(self, soc: Value) -> Value:
        return self.ocv.voltage(soc)


_ONE = Modifiers().kinetics


def _scaled(r_sp: Value, by: Modifiers) -> Value:
    if by.kinetics is by.diffusion:
        return r_sp if by.kinetics is _ONE else r_sp / by.kinetics
    return r_sp / np.sqrt(by.kinetics * by.diffusion)
