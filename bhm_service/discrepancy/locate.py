"""Where a model is off: the ranges of what was measured in which most of the misfit lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.slow import slow
from bhm_service.units import ZERO_CELSIUS_K, Array, Flags

_BINS = 8
_LEAST_LIFT = 1.35  # a region holds at least this times the misfit that its samples would
_LEAST_SHARE = 0.25
_MOST = 4
_LEAST_SPAN = {"temperature_C": 1.0}  # less is a thermometer's own: no place of anything


@dataclass(frozen=True, slots=True)
class Region:
    """A box of one or two variables."""

    where: dict[str, tuple[float, float]]
    flights: tuple[str, ...]
    share_of_misfit: float
    share_of_samples: float
    sign: int


@dataclass(frozen=True, slots=True)
class Map:
    """Mean misfit over each variable: what the page draws."""

    variable: str
    edges: Array
    mean_v: Array
    share: Array  # of the squared misfit in each bin


def variables(flights: Sequence[FlightData], soc: Sequence[Array]) -> dict[str, Array]:
    """Everything that a misfit may be laid over and that varies by more than it is read to, all flights in one row."""
    found: dict[str, list[Array]] = {}
    for k, data in enumerate(flights):
        rate = np.gradient(data.current_a, data.time_s) if data.time_s.size > 2 else np.zeros_like(data.current_a)
        own = {
            "since_takeoff_s": data.since_takeoff_s,
            "soc": soc[k],
            "current_A": data.current_a,
            "current_slope_A_per_s": rate,
            "flight": np.full(data.time_s.size, float(k)),
            "altitude_m": data.altitude_m,
            "speed_mps": data.speed_mps,
        }
        if data.temperature_k is not None:
            own["temperature_C"] = data.temperature_k - ZERO_CELSIUS_K
        if data.notes.cycles is not None:
            own["cycles"] = np.full(data.time_s.size, data.notes.cycles)
        if data.notes.storage_days is not None:
            own["storage_days"] = np.full(data.time_s.size, data.notes.storage_days)
        for name, values in own.items():
            found.setdefault(name, []).append(values)
    rows = {name: np.concatenate(parts) for name, parts in found.items() if len(parts) == len(flights)}
    return {name: row for name, row in rows.items() if not np.ptp(row) < _LEAST_SPAN.get(name, 0.0)}


def regime_maps(misfit: Array, over: dict[str, Array]) -> list[Map]:
    """Mean misfit over each variable that varies."""
    found = []
    total = float(np.nansum(misfit**2))
    for name, values in over.items():
        edges = _edges(values)
        if edges.size < 3:
            continue
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
        mean = np.array([_mean(misfit[place == k]) for k in range(edges.size - 1)])
        share = np.array([np.nansum(misfit[place == k] ** 2) for k in range(edges.size - 1)]) / max(total, 1e-12)
        found.append(Map(name, edges, mean, share))
    return found


def locate(
    misfits: Sequence[Array], flights: Sequence[FlightData], soc: Sequence[Array], floor_v: float
) -> list[Region]:
    """Boxes that hold most of the misfit beyond ``floor_v`` [V], the most telling first."""
    smooth = np.concatenate([slow(m, f) for m, f in zip(misfits, flights, strict=True)])
    excess = np.maximum(np.nan_to_num(smooth) ** 2 - floor_v**2, 0.0)
    total = float(excess.sum())
    if total <= 0.0:
        return []
    over = variables(flights, soc)
    numbers = over["flight"].astype(int)
    everywhere = np.ones(numbers.size, dtype=bool)
    found: list[Region] = []
    for name, values in over.items():
        box = _interval(values, excess, everywhere)
        if box is None:
            continue
        inside, where = box[0], {name: box[1]}
        deeper = [
            (other, second)
            for other, more in over.items()
            if other != name and (second := _interval(more, excess, inside)) is not None
        ]
        if deeper:
            other, second = max(deeper, key=lambda item: _lift(excess, inside & item[1][0]))
            inside, where = inside & second[0], where | {other: second[1]}
        share = float(excess[inside].sum()) / total
        held = [flights[k].label for k in np.unique(numbers[inside])]
        sign = 1 if float(np.nansum(smooth[inside])) >= 0.0 else -1
        where = {n: w for n, w in where.items() if n != "flight"} or where
        found.append(Region(where, tuple(held), share, float(inside.mean()), sign))
    found = [r for r in found if r.share_of_misfit >= _LEAST_SHARE]
    found.sort(key=lambda r: -r.share_of_misfit / max(r.share_of_samples, 1e-3) ** 0.5)
    return found[:_MOST]


def _interval(values: Array, excess: Array, among: Flags) -> tuple[Flags, tuple[float, float]] | None:
    """The run of bins that holds most misfit for its samples; None where no run stands out."""
    edges = _edges(values[among])
    if edges.size < 3:
        return None
    place = np.where(
        np.isfinite(values) & (values >= edges[0]) & (values <= edges[-1]) & among,
        np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2),
        -1,
    )
    sums = np.array([excess[place == k].sum() for k in range(edges.size - 1)])
    counts = np.array([np.sum(place == k) for k in range(edges.size - 1)])
    total, samples = float(excess[among].sum()), float(among.sum())
    best: tuple[float, int, int] | None = None
    for low in range(edges.size - 1):
        for high in range(low + 1, edges.size):
            share, part = sums[low:high].sum() / max(total, 1e-12), counts[low:high].sum() / samples
            if part <= 0.0 or part > 0.8 or share / part < _LEAST_LIFT or share < _LEAST_SHARE:
                continue
            telling = share - part
            if best is None or telling > best[0]:
                best = (telling, low, high)
    if best is None:
        return None
    _, low, high = best
    return (place >= low) & (place < high), (float(edges[low]), float(edges[high]))


def _lift(excess: Array, inside: Flags) -> float:
    return float(excess[inside].sum() / max(excess.sum(), 1e-12) - inside.mean())


def _edges(values: Array) -> Array:
    known = values[np.isfinite(values)]
    if known.size < 20 or np.ptp(known) <= 1e-9:
        return np.zeros(0)
    distinct = np.unique(known)
    if distinct.size <= _BINS:
        return np.append(distinct, distinct[-1] + 1.0) if distinct.size > 1 else np.zeros(0)
    return np.unique(np.quantile(known, np.linspace(0.0, 1.0, _BINS + 1)))


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
