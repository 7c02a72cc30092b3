"""The generic LiHV cell that ships: the generic LiPo cell, with the open-circuit curve of packs charged to 4.35 V.

    python -m bhm_service.identification.generic_lihv ../shared/data/flights/wadl_m100 config/batteries

No bench recording of such a cell is at hand. What is: 96 flights of three Matrice 100 (TB47D and TB48D packs, six
cells), with the percentage of the pack's own gauge, which counts charge. From that:

- a rested voltage, corrected for the little that the electronics draw, stands at the charge that the gauge shows;
- the LiPo cell's curve, carried on with the slope that it has near full, is laid along the rests: they tell how much
  more charge it spans, and how much is left where the gauge shows none (it keeps a reserve: at 2 % a cell rests at
  3.62 V, where no curve is near its end);
- what is left is a smooth bend: there are many rests near full, some between 38 and 66 % and below 12 %, and none
  between, where the curve keeps its shape;
- it has seen these flights, so how well it tells their charge is shown by cells made without the vehicle looked at
  (`tests/test_real_flights.py`);
- resistances, kinetics and diffusion are the LiPo cell's: an ampere does the same to a cell that is charged higher.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from bhm_service.battery.battery_file import BatteryFile, read_battery, write_battery
from bhm_service.battery.chem import X_N_MAX
from bhm_service.battery.ocv import MonotoneSpline
from bhm_service.identification.curve import carried_on
from bhm_service.identification.generic_lipo import redlich_kister_fit
from bhm_service.mavlink.log import read_log
from bhm_service.mavlink.recording import Recording, record
from bhm_service.units import SECONDS_PER_HOUR, Array

_SERIES, _CAPACITY_C = 6, 4.9 * SECONDS_PER_HOUR  # of those packs; the latter scales what counts as resting
_RESTED_S = 120.0  # after the last load
_IDLE_A = 2.0  # the electronics draw less, a rotor more
_KNOTS = (0.0, 0.04, 0.08, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.87, 0.94, 1.0)
_BEND_SD_V, _ALIKE = 0.03, 0.2  # by which makes of cells differ, and over which charge they do so alike
_TOGETHER = 0.02  # [-] rests of charges that differ by less tell the same
_REST_SD_V = 0.015  # of a rest: the gauge's percent, what still relaxes, packs of one make


def rests(flights: Sequence[Recording], ohm: float) -> tuple[Array, Array]:
    """Charge by the gauge [-] and rested voltage of a cell [V], one of each percent of each recording; both (n,)."""
    found: list[tuple[float, float]] = []
    for flight in flights:
        volts = flight.voltage_v / _SERIES + ohm * flight.current_a
        loaded = np.where(flight.current_a > _IDLE_A, flight.time_s, -np.inf)
        since_s = flight.time_s - np.maximum.accumulate(loaded)
        good = (flight.current_a <= _IDLE_A) & (since_s > _RESTED_S) & np.isfinite(volts + flight.remaining)
        of_percent = {round(float(at), 2): float(v) for at, v in zip(flight.remaining[good], volts[good], strict=True)}
        found += of_percent.items()
    return np.array([at for at, _ in found]), np.array([v for _, v in found])


@dataclass(frozen=True, slots=True, kw_only=True)
class ChargedHigher:
    """A known cell's curve laid along rests."""

    curve: MonotoneSpline
    span: float  # times the known cell's charge
    reserve: float  # of it, left where the gauge shows none


def laid(known: MonotoneSpline, gauge: Array, volts: Array) -> ChargedHigher:
    """The known curve along rested voltages (n,) at what a gauge shows."""
    # Rests that lie close together tell no more than one.
    crowd = _near(gauge, gauge, _TOGETHER).sum(axis=1)

    def off(numbers: Array) -> Array:
        span, reserve = numbers
        return np.asarray((volts - carried_on(known, span * _charge(gauge, reserve))) / np.sqrt(crowd))

    span, reserve = least_squares(off, (1.1, 0.02), bounds=((1.0, 0.0), (1.3, 0.2)), diff_step=1e-3).x
    at, knots = _charge(gauge, reserve), np.array(_KNOTS)
    noise = np.diag(_REST_SD_V**2 * crowd)
    alike, at_knots = (_BEND_SD_V**2 * _near(charge, at, _ALIKE) for charge in (at, knots))
    bend = at_knots @ np.linalg.solve(alike + noise, volts - carried_on(known, span * at))
    bent = carried_on(known, span * knots) + bend
    curve = MonotoneSpline(_KNOTS, tuple(round(float(v), 5) for v in bent))
    return ChargedHigher(curve=curve, span=float(span), reserve=float(reserve))


def _charge(gauge: Array, reserve: float) -> Array:
    return reserve + (1.0 - reserve) * gauge


def _near(one: Array, other: Array, within: float) -> Array:
    """How near charges (n,) and (m,) are to each other; (n, m)."""
    return np.asarray(np.exp(-0.5 * ((one[:, None] - other[None, :]) / within) ** 2))


def charged_higher(lipo: BatteryFile, found: ChargedHigher) -> BatteryFile:
    """The LiPo cell with the curve that rests of packs charged higher have shown."""
    assert lipo.circ is not None
    assert lipo.chem is not None
    circ = replace(lipo.circ, ocv=found.curve, c_max=float(np.asarray(lipo.circ.c_max)) * found.span)
    u_0, a_p = redlich_kister_fit(circ)
    chem = replace(lipo.chem, q_max=float(np.asarray(circ.c_max)) / X_N_MAX, u_0=u_0, a_p=a_p)
    return replace(
        lipo,
        name="Generic LiHV cell",
        source="generic-lipo.toml with the rested voltages of Matrice 100 packs at their own gauges "
        "(github.com/k2shah/wadl, 96 flights) by bhm_service.identification.generic_lihv",
        circ=circ,
        chem=chem,
        sd={},
    )


def main() -> None:
    """Read, bend, report and write."""
    data, folder = Path(sys.argv[1]), Path(sys.argv[2])
    flights = [record(read_log(path), 0, _SERIES, _CAPACITY_C) for path in sorted(data.glob("*.csv"))]
    lipo = read_battery(folder / "generic-lipo.toml")
    assert lipo.circ is not None
    assert isinstance(lipo.circ.ocv, MonotoneSpline)
    gauge, volts = rests(flights, float(np.asarray(lipo.circ.r_s)))
    found = laid(lipo.circ.ocv, gauge, volts)
    off = volts - np.asarray(found.curve.voltage(_charge(gauge, found.reserve)))
    print(  # noqa: T201
        f"{gauge.size} rests, RMSE {1e3 * np.sqrt(np.mean(off**2)):.1f} mV a cell; {found.span:.3f} times the charge, "
        f"{found.reserve:.1%} of it left where the gauge shows none"
    )
    write_battery(folder / "generic-lihv.toml", charged_higher(lipo, found))


if __name__ == "__main__":
    main()
