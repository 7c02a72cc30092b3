"""A battery truth with electrochemistry: PyBaMM's single particle model with electrolyte of a LiCoO2 pouch cell.

Parameters: Ai et al., 2020 (J. Electrochem. Soc. 167, 013512), the set that comes with PyBaMM; needs the extra `truth`.
"""

from __future__ import annotations

from typing import Any

from bhm_service.errors import BadInputError

_FLAT_V = 2.0  # of a cell that can no longer follow
_SOLVE_S = 1.0  # the solver's steps; in between the current is what it was


class PybammPack:
    """Cells of the set side by side, as many as the capacity asks for."""

    def __init__(self, series: int, capacity_ah: float, left: float = 1.0) -> None:
        try:
            import pybamm
        except ImportError:
            raise BadInputError("--truth pybamm", "PyBaMM is not here", "pip install 'bhm-service[truth]'") from None
        pybamm.set_logging_level("ERROR")
        parameters = pybamm.ParameterValues("Ai2020")
        parameters["Current function [A]"] = "[input]"
        parameters["Lower voltage cut-off [V]"] = _FLAT_V
        self._series = series
        self._parallel = capacity_ah / float(parameters["Nominal cell capacity [A.h]"])
        self._simulation: Any = pybamm.Simulation(pybamm.lithium_ion.SPMe(), parameter_values=parameters)
        self._simulation.build(initial_soc=left)
        self._failed: type[Exception] = pybamm.SolverError
        self._solution: Any = None
        self._waiting_s = 0.0
        self._charge_c = 0.0
        self._flat = False
        self._cell_v = self._solve(1e-3, 1e-3)

    def step(self, power_w: float, dt: float) -> tuple[float, float]:
        """Draw a power for a short time; terminal voltage [V] and current [A]."""
        volts = self._series * self._cell_v
        amps = power_w / volts
        self._charge_c += amps * dt
        self._waiting_s += dt
        if self._waiting_s >= _SOLVE_S - 1e-9 and not self._flat:
            self._cell_v = self._solve(self._charge_c / self._waiting_s, self._waiting_s)
            self._charge_c = self._waiting_s = 0.0
        return volts, amps

    def _solve(self, amps: float, seconds: float) -> float:
        inputs = {"Current function [A]": amps / self._parallel}
        try:
            self._solution = self._simulation.step(seconds, inputs=inputs, save=False, starting_solution=self._solution)
        except self._failed:
            self._flat = True
            return _FLAT_V
        volts = float(self._solution["Voltage [V]"].entries[-1])
        self._flat = volts <= _FLAT_V + 1e-3
        return max(volts, _FLAT_V)
