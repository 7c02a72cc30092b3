"""What no effect of the catalogue explains, laid over everything that was recorded: the describer of the unknown.

A voltage, or a resistance, that varies smoothly with one recorded variable is added to an explanation, and its
evidence is taken by one linear step, which is exact: it only adds to the voltage. It is a description, never physics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bhm_service.discrepancy.fitting import Fitted, one_step, weights
from bhm_service.discrepancy.lab import hats
from bhm_service.discrepancy.locate import variables
from bhm_service.units import Array

Kind = Literal["voltage", "resistance"]
_TELLING = 30.0  # [nats] as for what looks like a model's structure: a pattern can take many forms
_KNOTS = 5
_VOLTAGE_SD = 0.01  # [V] of a cell: what a pattern is expected to be off by
_RESISTANCE_SD = 0.15  # of the pack's resistance, likewise
_OPEN = frozenset({"soc", "current_A"})  # over these the lab leaves both open already


@dataclass(frozen=True, slots=True)
class Pattern:
    """A voltage [V] or resistance [Ohm] that varies with one variable, straight between knots."""

    kind: Kind
    variable: str
    knots: Array
    heights: Array
    sd: Array
    nats: float  # of evidence beyond the explanation that it was added to
    varies_v: float  # [V] of the pack, about its mean: what is the same everywhere is no pattern


def telling(fitted: Fitted) -> Pattern | None:
    """The most telling pattern on top of a fit, if any says enough.

    What varies by less than the lab's own model is off by is one of that model's errors, whatever it follows.
    """
    lab = fitted.joint.lab
    least_v = lab.series * lab.voltage_error_v if lab.identified else 0.0
    return next((p for p in patterns(fitted) if p.nats >= _TELLING and p.varies_v > least_v), None)


def patterns(fitted: Fitted) -> list[Pattern]:
    """All patterns on top of a fit, the most telling first."""
    flights = fitted.joint.flights
    soc = [modelled.soc for modelled in fitted.joint.all_predicted(fitted.x[None, :])]
    over = variables(flights, soc)
    current = np.concatenate([f.current_a for f in flights])
    lab = fitted.joint.lab
    ohm = lab.series * lab.ohm / lab.parallel
    found = []
    kinds: tuple[tuple[Kind, Array, float], ...] = (
        ("voltage", np.ones(current.size), _VOLTAGE_SD * lab.series),
        ("resistance", -current, _RESISTANCE_SD * ohm),
    )
    for name, values in over.items():
        shapes, knots = _shapes(values)
        if name in _OPEN or knots.size < 2:
            continue
        for kind, by, sd in kinds:
            heights, spread, nats = _added(fitted, sd * by * shapes)
            varies_v = float(np.std((sd * heights @ shapes * by)[np.isfinite(values)]))
            found.append(Pattern(kind, name, knots, sd * heights, sd * spread, nats, varies_v))
    return sorted(found, key=lambda p: -p.nats)


def _added(fitted: Fitted, shapes: Array) -> tuple[Array, Array, float]:
    """Size, spread and evidence [nats] of shapes (shapes, T of all flights) with a prior of one."""
    begin = 0
    size = shapes.shape[0]
    score, across, own = np.zeros(size), np.zeros((size, fitted.x.size)), np.zeros((size, size))
    for k, (data, row, slope) in enumerate(zip(fitted.joint.flights, fitted.rows, fitted.slopes, strict=True)):
        count = data.time_s.size
        white = fitted.joint.whitened(shapes[:, begin : begin + count], k, fitted.noise)
        white[:, ~np.isfinite(data.voltage_v)] = 0.0
        weighted = white * weights(row[:count])
        score += weighted @ row[:count]
        across += slope.until(count).back(weighted)
        own += weighted @ white.T
        begin += count
    # A fit that stopped a little before its end, or at a bound, must not look like a pattern.
    score -= across @ np.linalg.solve(fitted.curvature, fitted.gradient)
    information = own - across @ np.linalg.solve(fitted.curvature, across.T)
    heights, nats = one_step(information, score)
    return heights, np.sqrt(np.diag(np.linalg.inv(information + np.eye(size)))).astype(float), nats


def _shapes(values: Array) -> tuple[Array, Array]:
    """Triangles over a variable's own knots (knots, T), zero where it is not known, and the knots."""
    known = np.isfinite(values)
    if known.sum() < 20 or np.ptp(values[known]) <= 1e-9:
        return np.zeros((0, values.size)), np.zeros(0)
    distinct = np.unique(values[known])
    knots = distinct if distinct.size <= 2 * _KNOTS else np.unique(
        np.quantile(values[known], np.linspace(0.0, 1.0, _KNOTS))
    )  # fmt: skip
    return np.where(known, hats(knots, np.where(known, values, knots[0])), 0.0), knots
