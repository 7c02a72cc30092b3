"""What the voltages of single cells, where a log has them, say of a weak one.

All cells carry one current, and what a model of the pack gets wrong it gets wrong in all of them: so a weak cell stands
out of the others where it is lost in the pack's voltage. Cells are never quite alike, though, nor always balanced. What
the lowest one lies below the others is explained as matched cells differ and as a weak cell does, either balanced when
full or not; how much likelier it is of a weak one is its credit, and what size it has there is all that the pack's
voltage is asked to agree with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from bhm_service.battery.effects import Effect, WeakCell
from bhm_service.battery.pack import PackModel, Simulation
from bhm_service.discrepancy.candidate import Candidate, NotExcited
from bhm_service.discrepancy.fitting import huber
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.noise import CELL_FLOOR_V, LASTING_DOUBT, Noise, estimated
from bhm_service.discrepancy.readings import bridged
from bhm_service.units import Array, Flags

_SHARE = 0.5  # of a flight's samples that have to tell every cell
_DECLARED = tuple(p for p in WeakCell.parameters() if p.prior is not None)  # loss, then resistance
# By how much the worst of a pack's matched cells differs from the others: capacity, resistance; and charge when full.
_MATCHED_SDS = (0.02, 0.1)
_BALANCED_SD, _UNBALANCED_SD = 0.005, 0.05
_OPEN_SDS = (0.3, 1.0)  # of these two, where hardly anything is known of them
_FOLLOWED = 0.1  # of a weak cell's size: closer it is not told by a curve and a charge that are off as well
_TRIED = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6)  # losses from which a fit may begin
_STEP = 1e-3  # of charge, over which a curve's slope is taken


def with_cells(
    tried: Sequence[Candidate], lab: Lab, flights: Sequence[FlightData]
) -> tuple[list[Candidate], list[NotExcited]]:
    """The candidates, the weak cell as single cells tell of it; without it where these show that there is none."""
    cell = lowest_cell(flights)
    if cell is None or all(c.id != WeakCell.id for c in tried):
        return list(tried), []
    told = _told(lab, [_Seen.by(lab, f, cell) for f in flights if _tells(f)])
    others = [c for c in tried if c.id != WeakCell.id]
    if told.nats <= 0.0:
        return others, [NotExcited(WeakCell.id, f"its cells were measured one by one: {told.in_words(cell)}")]
    return [told.by(c) if c.id == WeakCell.id else c for c in tried], []


def lowest_cell(flights: Sequence[FlightData]) -> int | None:
    """Which cell lies lowest under load, the more the less charge is left; None where no flight tells every cell."""
    below = [_weighed(f) for f in flights if _tells(f)]
    return int(np.argmin(np.sum(below, axis=0))) if below else None


def _tells(data: FlightData) -> bool:
    """Whether a flight tells more than one cell most of the time."""
    if data.cells_v is None or data.cells_v.shape[1] < 2:
        return False
    return bool(np.mean(np.isfinite(data.cells_v).all(axis=1)) > _SHARE)


def _weighed(data: FlightData) -> Array:
    assert data.cells_v is not None
    apart = np.nan_to_num(data.cells_v - np.median(data.cells_v, axis=1, keepdims=True))
    return np.asarray((np.clip(data.current_a, 0.0, None) * np.clip(data.charge_c, 0.0, None)) @ apart)


@dataclass(frozen=True, slots=True)
class _Seen:
    """The lowest cell of one flight beside the others, and what a model makes of that."""

    lab: Lab
    data: FlightData
    below_v: Array  # (T,), straight where it is not known
    known: Flags
    bare_v: Array  # (T,) of the pack without a weak cell
    slope: Array  # (T,) of the curve [V]

    @classmethod
    def by(cls, lab: Lab, data: FlightData, cell: int) -> _Seen:
        assert data.cells_v is not None
        # Their median: one whose wire reads anything else makes no weak cell of another.
        below = data.cells_v[:, cell] - np.median(np.delete(data.cells_v, cell, axis=1), axis=1)
        known = np.isfinite(below)
        run = _run(lab, data)
        bare, slope = np.ravel(run.voltage), lab.slope_v(np.ravel(run.soc), _STEP)
        return cls(lab, data, bridged(below, known), known, bare, slope)

    def left(self, loss: float, resistance: float, charge: float) -> Array:
        """What a weak cell of this size, fuller than the others by a ``charge`` at first, leaves (T,). [V]"""
        weak = _run(self.lab, self.data, WeakCell(loss=loss, resistance=resistance))
        return np.asarray(self.below_v - (np.ravel(weak.voltage) - self.bare_v) - charge * self.slope)


def _run(lab: Lab, data: FlightData, *more: Effect) -> Simulation:
    """The pack along a flight as the battery file has it, and with more effects."""
    pack = PackModel(lab.cell, lab.series, lab.parallel, (*lab.effects, *more))
    soc = 1.0 if data.reading is None else data.reading
    return pack.simulate(data.time_s, data.current_a, soc, data.temperature_k)


@dataclass(frozen=True, slots=True)
class _Sizes:
    """What a weak cell has by the cells' voltages, and how much likelier that is than cells that are matched."""

    mean: Array  # (2,)
    sd: Array
    nats: float
    unbalanced: float  # mean charge of the lowest one beyond the others' when full; zero: as balanced packs have it

    def in_words(self, cell: int) -> str:
        """How the lowest cell differs from the others, where it is no weak one."""
        if not self.unbalanced:
            return f"cell {cell + 1}, the lowest, differs as matched cells do"
        return f"cell {cell + 1} begins with {-100.0 * self.unbalanced:.1f} % less charge and loses no more: balance it"

    def by(self, candidate: Candidate) -> Candidate:
        """The candidate with these sizes."""
        numbers = zip(self.mean.tolist(), self.sd.tolist(), strict=True)
        told = dict(zip((p.name for p in _DECLARED), numbers, strict=True))
        unknowns = tuple(
            replace(u, prior=told[u.declared.name]) if u.declared.name in told else u for u in candidate.unknowns
        )
        return replace(candidate, unknowns=unknowns, credit=self.nats)


def _told(lab: Lab, seen: Sequence[_Seen]) -> _Sizes:
    """Of a weak cell, by the voltages of the lowest one."""
    means, sds = np.array([p.prior for p in _DECLARED]).T
    none = np.zeros(len(_DECLARED))
    open_ = _fitted(seen, Noise.at_first(1), none, np.array(_OPEN_SDS), _UNBALANCED_SD)
    left = [own.left(open_.mean[0], open_.mean[1], charge) for own, charge in zip(seen, open_.charges, strict=True)]
    noise = estimated([row[own.known] for row, own in zip(left, seen, strict=True)], CELL_FLOOR_V)
    weak, matched = (
        [_fitted(seen, noise, mean, sd, charge_sd) for charge_sd in (_BALANCED_SD, _UNBALANCED_SD)]
        for mean, sd in ((means, sds), (none, np.array(_MATCHED_SDS)))
    )
    found = max(weak, key=lambda fitted: fitted.nats)
    # It was the lowest of all that was looked at.
    nats = _either(weak) - _either(matched) - float(np.log(lab.series))
    balanced, unbalanced = matched
    charge = float(unbalanced.charges.mean()) if unbalanced.nats > balanced.nats else 0.0
    return _Sizes(found.mean, np.hypot(found.sd, _FOLLOWED * found.mean), nats, min(charge, 0.0))


def _either(ways: Sequence[_Fitted]) -> float:
    """How likely what was seen is, where each of these is as likely as the others."""
    return float(np.logaddexp.reduce([way.nats for way in ways]))


@dataclass(frozen=True, slots=True)
class _Fitted:
    mean: Array  # (2,)
    sd: Array
    charges: Array  # (flights,) beyond the others when full
    nats: float


def _fitted(seen: Sequence[_Seen], noise: Noise, means: Array, sds: Array, charge_sd: float) -> _Fitted:
    """The likeliest sizes under a prior, and how likely that makes what was seen, but for what all priors share."""
    doubted = replace(noise, doubt=LASTING_DOUBT)
    spread = np.concatenate([sds, np.full(len(seen), charge_sd)])
    expected = np.concatenate([means, np.zeros(len(seen))])

    def off(x: Array) -> Array:
        rows = [own.left(x[0], x[1], q) for own, q in zip(seen, x[2:], strict=True)]
        white = [doubted.whitened(row)[own.known] for row, own in zip(rows, seen, strict=True)]
        innovations = np.concatenate(white)
        return np.concatenate([np.sign(innovations) * np.sqrt(huber(innovations)), (x - expected) / spread])

    low = np.concatenate([[p.low for p in _DECLARED], np.full(len(seen), -np.inf)])
    high = np.concatenate([[p.high for p in _DECLARED], np.full(len(seen), np.inf)])
    starts = [np.concatenate([[loss, means[1]], np.zeros(len(seen))]) for loss in _TRIED]
    start = min(starts, key=lambda x: float(np.sum(off(x) ** 2)))
    inside = np.clip(start, low + 1e-6, high - 1e-6)
    at = least_squares(off, inside, bounds=(low, high), x_scale=spread)
    curvature = at.jac.T @ at.jac
    volume = float(np.linalg.slogdet(curvature * np.outer(spread, spread))[1])
    sd = np.sqrt(np.diag(np.linalg.inv(curvature)))
    return _Fitted(at.x[:2], sd[:2], at.x[2:], -float(at.cost) - 0.5 * volume)
