"""Redlich-Kister activity terms as one polynomial, regular at x = 0.5 where the printed form divides by zero."""

from __future__ import annotations

from collections.abc import Sequence

from bhm_service.units import FARADAY, Value


def polynomial(coefficients: Sequence[Value]) -> list[Value]:
    """Coefficients in powers of y = 2x - 1 of V_INT [V], lowest first, from A_0, A_1 ... [J/mol].

    V_INT = (1 / nF) sum_k A_k [ y^(k+1) - 2 x k (1 - x) y^(k-1) ]        (paper eq. A.22, misprint corrected)
          = (1 / nF) sum_k A_k [ (1 + k/2) y^(k+1) - (k/2) y^(k-1) ]      because 2 x (1 - x) = (1 - y^2) / 2
    """
    powers: list[Value] = [0.0] * (len(coefficients) + 1)
    for k, a in enumerate(coefficients):
        powers[k + 1] = powers[k + 1] + (1.0 + 0.5 * k) * a / FARADAY
        if k > 0:
            powers[k - 1] = powers[k - 1] - 0.5 * k * a / FARADAY
    return powers


def horner(powers: Sequence[Value], y: Value) -> Value:
    """Value of a polynomial, lowest power first, at ``y`` (any shape)."""
    total = powers[-1]
    for coefficient in reversed(powers[:-1]):
        total = total * y + coefficient
    return total
