"""A score in words: what every line of the card says, in the terminal, on the page and in the README."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from sim.proof.scoring.score import Row, SuiteScore

HEADER = ("measure", "value", "95 % interval", "n", "target", "")
ABOUT = {
    "shared": "the eight open cases (development, no evidence)",
    "quick": "a few concealed cases, as in `make test`",
    "development": "concealed world, for development",
    "exam": "concealed world, independent physics, six cells in series",
    "truth": "concealed world on PyBaMM",
    "real": "real recordings with a channel withheld",
}


def value(row: Row) -> str:
    """A row's value."""
    if math.isnan(row.value):
        return "not computed"
    return f"{100.0 * row.value:.1f} %" if row.percent else f"{row.value:.3g}"


def line(row: Row) -> tuple[str, ...]:
    """A row's cells, see HEADER."""
    interval = "" if row.interval is None else f"{100.0 * row.interval[0]:.1f}-{100.0 * row.interval[1]:.1f} %"
    met = {True: "met", False: "MISSED", None: "open" if row.target else ""}[row.met]
    return row.name, value(row), interval, str(row.n), row.target, met


def shown(score: SuiteScore) -> list[Row]:
    """The rows that say something: those with a target, and those with a value."""
    return [row for row in score.rows if row.target or not math.isnan(row.value)]


def outcome(scores: Sequence[SuiteScore]) -> str:
    """The run in one sentence."""
    asked = sum(bool(row.target) for s in scores for row in s.rows)
    missed, unsure = sum(s.failed for s in scores), sum(s.open for s in scores)
    if missed:
        return f"NOT PROVEN: {missed} of {asked} targets missed" + (f", {unsure} not computed" if unsure else "")
    return (
        f"Proven as far as computed: {unsure} of {asked} targets could not be"
        if unsure
        else (f"Proven: all {asked} targets met")
    )


_MEASURES = {
    "heldout_ratio": "held-out RMSE after over before",
    "accepted": "answered right (1)",
    "rmse": "RMSE",
    "r": "correlation of the changes",
    "bias": "bias",
    "change_rmse": "RMSE of the changes",
    "rise_error": "error of the largest rise",
}


def measure(name: str) -> str:
    """A measure's name as people read it."""
    kind, _, what = name.partition(".")
    if kind == "hidden":
        quantity, _, how = what.rpartition(".")
        words, _, unit = quantity.rpartition("_")
        return f"inferred {words}: {_MEASURES[how]}" + ("" if how == "r" else f" [{unit}]")
    if kind in ("named", "listed"):
        return f"{what.replace('|', ' or ')} {kind} (1) or not (0)"
    return what.replace(".", ": ") if kind == "parameter" else _MEASURES.get(name, name)


def circumstances(about: Mapping[str, Any]) -> str:
    """Date, seed, versions and commit."""
    kind = "exam seed, drawn for this run" if about["exam"] else "development seed"
    return (
        f"{about['started'].replace('T', ' ').removesuffix('+00:00')} UTC; answers by {about['answerer']}; "
        f"{kind} {about['seed']}; bhm-service {about['version']} at {about['commit']}; Python {about['python']}, "
        f"numpy {about['numpy']}, scipy {about['scipy']}; {about['seconds'] / 60.0:.1f} min"
    )
