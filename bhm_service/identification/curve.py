"""The open-circuit curve out of recordings, and the form in which a fit may bend it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.ocv import MonotoneSpline, monotone_cubic
from bhm_service.identification.experiment import Experiment
from bhm_service.units import Array, Value

# Knots of the curve: close where a LiPo cell's curve bends, at its empty end.
KNOTS = np.concatenate([[0.0, 0.01, 0.02, 0.035, 0.05, 0.07, 0.09], np.arange(0.12, 0.985, 0.03), [1.0]])
LASTING, LASTING_S = 0.5, 40.0  # of what a load drops at once, what builds up in some tens of seconds; [s]
LOW_SOC = 0.10  # below, cells differ by more than a model can follow
BENDS = np.linspace(0.0, 1.0, 21)  # where a fit may move it
_TABLE = np.linspace(-0.12, 1.12, 1241)
_LEAST_RISE_V = 2e-5  # from knot to knot
_NEAR_FULL = 0.9  # from here to full it has the slope with which it is carried on


@dataclass(frozen=True, slots=True)
class BentCurve:
    """A curve plus corrections at `BENDS`, straight between; one row of corrections for every column of a fit."""

    table: Array  # volts on the common table of states of charge
    bends: Array  # (M, 21) or (21,) [V]

    def voltage(self, soc: Value) -> Value:
        soc = np.asarray(soc)
        base = np.interp(soc, _TABLE, self.table)
        place = np.clip(soc, 0.0, 1.0) * (BENDS.size - 1)
        k = np.minimum(place.astype(int), BENDS.size - 2)
        share = place - k
        if self.bends.ndim == 1:
            bent: Array = base + self.bends[k] * (1.0 - share) + self.bends[k + 1] * share
            return bent
        rows = np.broadcast_shapes(k.shape, (self.bends.shape[0], 1))
        k = np.broadcast_to(k, rows)
        low = np.take_along_axis(self.bends, k, axis=-1)
        high = np.take_along_axis(self.bends, k + 1, axis=-1)
        columns: Array = base + low * (1.0 - share) + high * share
        return columns


def table_of(spline: MonotoneSpline) -> Array:
    """A spline on the common table."""
    return np.asarray(spline.voltage(_TABLE))


def spline_of(curve: BentCurve) -> MonotoneSpline:
    """One bent curve as the monotone spline that the battery file holds."""
    return rising(KNOTS, np.asarray(curve.voltage(KNOTS)))


def rising(soc: Array, volts: Array) -> MonotoneSpline:
    """A spline through points that are made to rise where they do not."""
    lifted = np.maximum.accumulate(volts + 0.0)
    for k in range(1, lifted.size):
        lifted[k] = max(lifted[k], lifted[k - 1] + _LEAST_RISE_V)
    return MonotoneSpline(tuple(float(s) for s in soc), tuple(round(float(v), 6) for v in lifted))


def carried_on(curve: MonotoneSpline, soc: Array) -> Array:
    """Voltages of a curve up to beyond full, where it goes on with the slope that it has near there. [V]

    A curve's own table ends an eighth above full; cells that are charged to 4.35 V reach further.
    """
    near, top = (float(np.asarray(curve.voltage(at))) for at in (_NEAR_FULL, 1.0))
    slope = (top - near) / (1.0 - _NEAR_FULL)
    within = np.asarray(curve.voltage(np.minimum(soc, 1.0)))
    return np.asarray(within + slope * np.maximum(soc - 1.0, 0.0))


def from_slow(experiment: Experiment, capacity_c: float) -> MonotoneSpline:
    """The curve that a slow discharge runs along: local parabolas through its voltages at the knots.

    Where the recording ends before empty, the curve goes on with the slope it had.
    """
    soc = 1.0 - experiment.charge_c / capacity_c
    volts, good = experiment.voltage_v, experiment.measured
    soc, volts = soc[good], volts[good]
    return _smoothed(soc, volts)


def from_rates(experiments: Sequence[Experiment], capacity_c: float, resistance: float) -> MonotoneSpline:
    """The curve from discharges at several rates: at equal charge, voltage carried on to no current.

    With one rate only, the drop at that rate comes to ``resistance`` [Ohm] times the current.
    """
    grid = np.linspace(0.0, 1.0, 201)
    amps, rows, since = [], [], []
    for experiment in experiments:
        loaded = experiment.loaded & experiment.measured & (experiment.current_a > 0.0)
        soc = 1.0 - experiment.charge_c[loaded] / capacity_c
        order = np.argsort(soc)
        inside = (grid >= soc.min()) & (grid <= soc.max())
        row = np.full(grid.size, np.nan)
        row[inside] = np.interp(grid[inside], soc[order], experiment.voltage_v[loaded][order])
        amps.append(float(np.median(experiment.current_a[loaded])))
        rows.append(row)
        time = experiment.time_s[loaded]
        since.append(np.interp(grid, soc[order], time[order] - time.min()))
    table, current = np.array(rows), np.array(amps)
    slowest = int(np.argmin(current))
    drop = resistance * current[slowest] * built_up(since[slowest])
    if np.ptp(current) > 0.3 * current.max():
        with np.errstate(invalid="ignore"):
            slope = [
                np.polyfit(current[known], table[known, k], 1)[0]
                if (known := np.isfinite(table[:, k])).sum() > 1
                else np.nan
                for k in range(grid.size)
            ]
        found = np.clip(-np.array(slope) * current[slowest], 0.0, 0.3)
        drop = np.where(np.isfinite(found), found, drop)
        middle = (grid > 0.15) & (grid < 0.85) & np.isfinite(found)
        drop = np.where((grid < 0.15) | (grid > 0.85), np.median(drop[middle]) if middle.any() else drop, drop)
    at_rest = table[slowest] + drop
    known = np.isfinite(at_rest)
    return _smoothed(grid[known], at_rest[known])


def built_up(since_s: Value) -> Value:
    """Share of what a load drops in the end that is there so long [s] after it began."""
    share: Value = (1.0 + LASTING * (1.0 - np.exp(-since_s / LASTING_S))) / (1.0 + LASTING)
    return share


def _smoothed(soc: Array, volts: Array) -> MonotoneSpline:
    order = np.argsort(soc)
    soc, volts = soc[order], volts[order]
    fitted = np.empty_like(KNOTS)
    for k, knot in enumerate(KNOTS):
        reach = 0.5 * (KNOTS[min(k + 1, KNOTS.size - 1)] - KNOTS[max(k - 1, 0)]) + 0.004
        near = np.abs(soc - knot) <= reach
        if near.sum() < 5:
            fitted[k] = np.interp(knot, soc, volts) if soc[0] <= knot <= soc[-1] else np.nan
            continue
        inner = soc[near].min() < knot - 0.3 * reach and soc[near].max() > knot + 0.3 * reach
        fitted[k] = np.polyval(np.polyfit(soc[near] - knot, volts[near], 2 if inner and near.sum() > 8 else 1), 0.0)
    known = np.isfinite(fitted)
    missing = ~known
    if missing.any():
        fitted[missing] = monotone_cubic(KNOTS[known], np.maximum.accumulate(fitted[known]), KNOTS[missing])
    return rising(KNOTS, fitted)
