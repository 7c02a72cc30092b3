"""Chem: the lumped electrochemistry model (paper Appendix A; Daigle & Kulkarni 2013).

The paper's states are four charges and three overpotentials. Lithium is conserved (q_p + q_n = q_max, A.15) and both
electrodes have the same surface fraction and diffusion time, so what one electrode's surface gains the other's loses:
x_s,p = 1 - x_s,n at all times, and the four charges are two numbers. They are carried as the state of charge
(q_n / 0.6 q_max) and the difference x_b,n - x_s,n between bulk and surface, a counter and a lag. No noise on these can
create lithium. `charges` gives the paper's four back.

The model stays at the temperature it was identified at: in the paper's equations temperature stands only in RT/F,
which makes overpotentials rise when it is warm. What temperature really does is the business of the effects.

A Redlich-Kister series whose coefficients stay small, be they 13 or 60, follows no step of the curve, as lithium cobalt
oxide has near full (10 mV off): what it leaves of a recorded curve may be added to it (`curve_rest`), read at the
surface as all of it is.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.dynamics import Solver
from bhm_service.battery.ocv import CurveRest
from bhm_service.battery.parameters import parameter
from bhm_service.battery.redlich_kister import horner, polynomial
from bhm_service.units import (
    FARADAY,
    GAS_CONSTANT,
    REFERENCE_TEMPERATURE_K,
    SECONDS_PER_HOUR,
    Value,
)

X_N_MAX = 0.6  # mole fraction of the full negative electrode (Karthikeyan et al. 2008)
_THERMAL_V = GAS_CONSTANT * REFERENCE_TEMPERATURE_K / FARADAY  # [V] RT/F, n = 1
_ALPHA = 0.5  # symmetry factor
# Mole fractions are kept off 0 and 1 by a hyperbola this wide: 14 uV at SoC 0.05, finite slope beyond the limits.
_EDGE = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Chem:
    """Electrochemistry of one cell; every number may be an array that broadcasts against the states."""

    q_max: Value = parameter("q_max", "Ah", 0.05, 1000.0, "lithium of both electrodes", scale=SECONDS_PER_HOUR)
    u_0: Value = parameter("U_0p - U_0n", "V", 2.0, 7.0, "reference potential, of the curve")
    surface_fraction: Value = parameter("f", "1", 0.01, 0.9, "surface volume over electrode volume")
    t_diffusion: Value = parameter("t_diffusion v", "s", 0.1, 1e5, "diffusion time constant times volume")
    r_o: Value = parameter("R_o", "ohm", 1e-5, 1.0, "ohmic resistance")
    tau_o: Value = parameter("tau_o", "s", 1e-3, 1e3, "time constant of the ohmic drop")
    i_p0: Value = parameter("S_p k_p", "A", 1e-3, 1e5, "exchange current, positive electrode, at x(1-x) = 1")
    i_n0: Value = parameter("S_n k_n", "A", 1e-3, 1e5, "exchange current, negative electrode, at x(1-x) = 1")
    tau_p: Value = parameter("tau_eta_p", "s", 1e-3, 1e4, "time constant of the positive overpotential")
    tau_n: Value = parameter("tau_eta_n", "s", 1e-3, 1e4, "time constant of the negative overpotential")
    a_p: tuple[Value, ...]  # [J/mol] A_p,k
    a_n: tuple[Value, ...]  # [J/mol] A_n,k
    curve_rest: CurveRest | None = None  # what the series leaves of a curve with steps
    _powers: tuple[Value, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        # y_p = 2 x_s,p - 1 = -y_n, so both electrodes' polynomials are one polynomial in y_n.
        positive, negative = polynomial(self.a_p), polynomial(self.a_n)
        powers: list[Value] = [0.0] * max(len(positive), len(negative))
        for k, c in enumerate(positive):
            powers[k] = powers[k] + (c if k % 2 == 0 else -c)
        for k, c in enumerate(negative):
            powers[k] = powers[k] - c
        powers[0] = powers[0] + self.u_0
        object.__setattr__(self, "_powers", tuple(powers))

    @property
    def state_names(self) -> tuple[str, ...]:
        return ("soc", "x_b-x_s", "v_o", "v_eta_p", "v_eta_n")

    @property
    def capacity_c(self) -> Value:
        return X_N_MAX * self.q_max

    def rest(self, soc: Value) -> tuple[Value, ...]:
        zero = 0.0 * soc
        return (soc, zero, zero, zero, zero)

    def advance(
        self, solver: Solver, start: tuple[Value, ...], begin: Value, end: Value, by: Modifiers
    ) -> tuple[Value, ...]:
        per_ampere = -1.0 / (self.capacity_c * by.capacity)
        soc = solver.counter(start[0], begin * per_ampere, end * per_ampere)

        f = self.surface_fraction
        tau = self.t_diffusion * (f * (1.0 - f)) / by.diffusion
        lead = tau / (f * (self.q_max * by.capacity))
        gradient = solver.lag(start[1], lead * begin, lead * end, tau)

        resistance = self.r_o * by.resistance
        v_o = solver.lag(start[2], resistance * begin, resistance * end, self.tau_o)

        p_begin, n_begin = self._overpotentials(
            begin, solver.begin(start[0], soc), solver.begin(start[1], gradient), by
        )
        p_end, n_end = self._overpotentials(end, soc, gradient, by)
        v_p = solver.lag(start[3], p_begin, p_end, self.tau_p)
        v_n = solver.lag(start[4], n_begin, n_end, self.tau_n)
        return (soc, gradient, v_o, v_p, v_n)

    def _surface(self, soc: Value, gradient: Value) -> Value:
        """Mole fraction at the surface of the negative electrode; the positive one's is one minus it."""
        return X_N_MAX * soc - (1.0 - self.surface_fraction) * gradient

    def _overpotentials(self, current: Value, soc: Value, gradient: Value, by: Modifiers) -> tuple[Value, Value]:
        """Butler-Volmer overpotentials of both electrodes [V] (A.24-A.26)."""
        x_s = self._surface(soc, gradient)
        exchange = by.kinetics * np.sqrt(_inside(x_s * (1.0 - x_s)))
        half = current / (2.0 * exchange)
        scale = _THERMAL_V / _ALPHA
        return scale * np.arcsinh(half / self.i_p0), scale * np.arcsinh(half / self.i_n0)

    def emf(self, state: tuple[Value, ...], by: Modifiers) -> Value:
        soc, gradient, v_o, v_p, v_n = state
        return self._equilibrium(self._surface(soc, gradient)) - v_o - v_p - v_n

    def polarisation(self, state: tuple[Value, ...], by: Modifiers) -> Value:
        return self.open_circuit(state[0]) - self.emf(state, by)

    def _equilibrium(self, x_s: Value) -> Value:
        """V_U,p - V_U,n [V] of the surfaces (A.21), x_s that of the negative electrode."""
        by_series: Value = nernst(x_s) + horner(self._powers, 2.0 * x_s - 1.0)
        return by_series if self.curve_rest is None else by_series + self.curve_rest.voltage(x_s / X_N_MAX)

    def series_resistance(self, by: Modifiers) -> Value:
        return 0.0

    def ohmic_resistance(self, by: Modifiers) -> Value:
        return self.r_o * by.resistance

    def open_circuit(self, soc: Value) -> Value:
        return self._equilibrium(X_N_MAX * soc)

    def charges(self, state: tuple[Value, ...]) -> dict[str, Value]:
        """The paper's four charges [C]: q_sp, q_bp, q_bn, q_sn (A.5)."""
        f = self.surface_fraction
        x_n, gradient = X_N_MAX * state[0], state[1]
        x_s, x_b = x_n - (1.0 - f) * gradient, x_n + f * gradient
        return {
            "q_sp": (1.0 - x_s) * f * self.q_max,
            "q_bp": (1.0 - x_b) * (1.0 - f) * self.q_max,
            "q_bn": x_b * (1.0 - f) * self.q_max,
            "q_sn": x_s * f * self.q_max,
        }


def nernst(x_s: Value) -> Value:
    """The ideal part of V_U,p - V_U,n [V]: both electrodes' RT/nF ln((1 - x) / x), with x_s,p = 1 - x_s,n."""
    difference: Value = 2.0 * _THERMAL_V * np.log(_inside(x_s) / _inside(1.0 - x_s))
    return difference


def _inside(x: Value) -> Value:
    """``x`` held above zero by a hyperbola: x for x >> 0, small and positive beyond."""
    return 0.5 * (x + np.sqrt(x * x + _EDGE * _EDGE))
