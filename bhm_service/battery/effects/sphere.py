"""Diffusion in a sphere under a flux through its surface, as lags: what the surface is off from the mean.

Crank 1975, eq. 6.45: of lambda = tan(lambda) the first two modes, each with 10 / lambda^2 of the steady difference, and
all others as one, of their mean time.
"""

from __future__ import annotations

from bhm_service.battery.dynamics import Solver
from bhm_service.battery.effects.base import Spread
from bhm_service.units import Value

_FIRST, _SECOND = 4.493409458, 7.725251837
_SHARES = (10.0 / _FIRST**2, 10.0 / _SECOND**2, 1.0 - 10.0 / _FIRST**2 - 10.0 / _SECOND**2)
_TIMES = (
    1.0,
    (_FIRST / _SECOND) ** 2,
    (_FIRST**2 / 35.0 - _SHARES[0] - _SHARES[1] * (_FIRST / _SECOND) ** 2) / _SHARES[2],
)
STEADY = _FIRST**2 / 15.0  # times the slowest time constant times the rate at which charge goes
START: tuple[Value, ...] = (0.0,) * len(_SHARES)
SPREAD = (Spread(0.003, 1e-5),) * len(_SHARES)  # of a filter's modes, in charge


def surface(
    solver: Solver, start: tuple[Value, ...], begin: Value, end: Value, time_constant: Value
) -> tuple[Value, ...]:
    """The modes at the end of each interval, where they tend to ``begin`` and then ``end`` together.

    ``time_constant`` is that of the slowest [s].
    """
    modes = zip(start, _SHARES, _TIMES, strict=True)
    return tuple(solver.lag(own, part * begin, part * end, times * time_constant) for own, part, times in modes)


def behind(modes: tuple[Value, ...]) -> Value:
    """What the surface lags behind the mean."""
    first, second, others = modes
    return first + second + others
