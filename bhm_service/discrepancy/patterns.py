"""What no effect of the catalogue explains, laid over everything that was recorded: the describer of the unknown.

A voltage, or a resistance, that varies smoothly with one recorded variable is added to an explanation, and its
evidence is taken by one linear step, which is exact: it only adds to the voltage. It is a description, never physics.

Over what no effect of the catalogue, and no error of a cell's model, has to do with (how fast and how high the vehicle
flies, how warm the autopilot is) a straight line is tried as well. It can take one form only, so it needs to tell less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bhm_service.discrepancy.first_order import Beside
from bhm_service.discrepancy.fitting import Fitted, one_step
from bhm_service.discrepancy.lab import hats
from bhm_service.discrepancy.locate import variables
from bhm_service.discrepancy.odds import NATS
from bhm_service.discrepancy.readings import bridged
from bhm_service.units import ZERO_CELSIUS_K, Array, Flags

Kind = Literal["voltage", "resistance"]
_TELLING = 30.0  # [nats] as for what looks like a model's structure: a pattern can take many forms
_KNOTS = 5
_TOLD_SHARE = 0.8  # of a flight's samples that have to tell what a line is drawn over
VOLTAGE_SD = 0.01  # [V] of a cell: what a pattern is expected to be off by
_RESISTANCE_SD = 0.15  # of the pack's resistance, likewise
_OPEN = frozenset({"soc", "current_A"})  # over these the lab leaves both open already
_KINDS: tuple[Kind, ...] = ("voltage", "resistance")
BOARD = "board_C"
# What these have nothing to do with in a battery. Where an autopilot is warm a pack is, and its resistance follows.
_FOREIGN: dict[str, tuple[Kind, ...]] = {"speed_mps": _KINDS, "altitude_m": _KINDS, BOARD: ("voltage",)}


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
    line: bool = False  # straight from the lowest to the highest


def telling(fitted: Fitted, lines_only: bool = False) -> Pattern | None:
    """The most telling pattern on top of a fit, if any says enough.

    What varies by less than the lab's own model is off by is one of that model's errors, whatever it follows. Not so a
    line, where the lab told which errors these are; ``lines_only`` asks for no other pattern.
    """
    lab = fitted.joint.lab
    if lines_only and not lab.form_told:
        return None
    least_v = lab.series * lab.voltage_error_v if lab.identified else 0.0

    def tells(pattern: Pattern) -> bool:
        if pattern.line:
            return lab.form_told and pattern.nats >= NATS
        return pattern.nats >= _TELLING and pattern.varies_v > least_v

    return next(filter(tells, patterns(fitted, lines_only)), None)


def patterns(fitted: Fitted, lines_only: bool = False) -> list[Pattern]:
    """All patterns on top of a fit, or the lines among them, the most telling first."""
    flights = fitted.joint.flights
    soc = [modelled.soc for modelled in fitted.joint.all_predicted(fitted.x[None, :])]
    over = variables(flights, soc)
    lengths = [f.time_s.size for f in flights]
    # How warm an autopilot is goes with how warm its pack is and how long it flies: no form but a line is looked at.
    board = [f.board_k for f in flights if f.board_k is not None]
    boards = {BOARD: np.concatenate(board) - ZERO_CELSIUS_K} if len(board) == len(flights) else {}
    forms = [(n, _line(v, lengths), _FOREIGN[n]) for n, v in (over | boards).items() if n in _FOREIGN]
    if not lines_only:
        forms += [(n, _triangles(v), _KINDS) for n, v in over.items() if n not in _OPEN]
    tried = [(name, form, kind) for name, form, kinds in forms if form is not None for kind in kinds]
    current = np.concatenate([f.current_a for f in flights])
    lab = fitted.joint.lab
    usual: dict[Kind, tuple[Array, float]] = {
        "voltage": (np.ones(current.size), VOLTAGE_SD * lab.series),
        "resistance": (-current, _RESISTANCE_SD * lab.pack_ohm),
    }
    found = []
    for name, form, kind in tried:
        by, sd = usual[kind]
        sizes, spread, nats = added(fitted, sd * by * form.shapes)
        varies_v = float(np.std((sd * sizes @ form.shapes * by)[form.known]))
        heights, sds = sd * form.at_knots @ sizes, sd * np.abs(form.at_knots) @ spread
        found.append(Pattern(kind, name, form.knots, heights, sds, nats, varies_v, form.line))
    return sorted(found, key=lambda p: -p.nats)


def added(fitted: Fitted, shapes: Array) -> tuple[Array, Array, float]:
    """Size, spread and evidence [nats] of shapes (shapes, T of all flights) with a prior of one."""
    flights = np.split(shapes, np.cumsum([f.time_s.size for f in fitted.joint.flights])[:-1], axis=1)
    parts = [Beside.of(fitted, k, own) for k, own in enumerate(flights)]
    score, across, own = (np.sum(of_flights, axis=0) for of_flights in zip(*parts, strict=True))
    score, information = Beside(score, across, own).freed(fitted)
    heights, nats = one_step(information, score)
    return heights, np.sqrt(np.diag(np.linalg.inv(information + np.eye(score.size)))).astype(float), nats


@dataclass(frozen=True, slots=True)
class _Form:
    """How something may follow a variable: shapes (shapes, T), and what one of each is at the knots (knots, shapes)."""

    knots: Array
    shapes: Array
    at_knots: Array
    known: Flags  # samples that tell the variable (T,)
    line: bool = False


def _triangles(values: Array) -> _Form | None:
    """Over a variable's own knots, zero where it is not known; None where it hardly varies."""
    known = np.isfinite(values)
    if known.sum() < 20 or np.ptp(values[known]) <= 1e-9:
        return None
    distinct = np.unique(values[known])
    knots = distinct if distinct.size <= 2 * _KNOTS else np.unique(
        np.quantile(values[known], np.linspace(0.0, 1.0, _KNOTS))
    )  # fmt: skip
    shapes = np.where(known, hats(knots, np.where(known, values, knots[0])), 0.0)
    return _Form(knots, shapes, np.eye(knots.size), known) if knots.size > 1 else None


def _line(values: Array, lengths: Sequence[int]) -> _Form | None:
    """From a variable's least to its most, over flights of so many samples; None where one does not tell most of it."""
    flights = np.split(values, np.cumsum(lengths)[:-1])
    if any(np.mean(np.isfinite(own)) < _TOLD_SHARE for own in flights):
        return None
    # Steps to nothing and back, where a sample lacks it, would be all that a filter of noise sees.
    told = np.concatenate([bridged(own, np.isfinite(own)) for own in flights])
    ends = np.array([told.min(), told.max()])
    middle, width = float(told.mean()), float(told.std())
    if width <= 1e-9:
        return None
    shape, at_ends = (told - middle)[None, :] / width, ((ends - middle) / width)[:, None]
    return _Form(ends, shape, at_ends, np.isfinite(values), line=True)
