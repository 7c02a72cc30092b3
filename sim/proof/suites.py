"""The suites by name: which cases a seed draws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bhm_service.errors import BadInputError
from sim.concealed.suites import SUITES as CONCEALED
from sim.proof.cases import Batch
from sim.proof.concealed_cases import concealed
from sim.proof.real.suite import CASES as REAL_CASES
from sim.proof.real.suite import real_cases
from sim.proof.shared_cases import shared_cases

SHARED = Path(__file__).resolve().parents[3] / "shared"
_OPEN_SEEDS = 100_000  # development draws below this, an exam above: they never share a seed


@dataclass(frozen=True, slots=True)
class Suite:
    """A suite that can be drawn: its cases unless told otherwise, and who draws them."""

    name: str
    about: str
    cases: int
    draw: Callable[[int, int], list[Batch]]


def _shared(seed: int, cases: int) -> list[Batch]:
    folder = SHARED / "cases"
    if not folder.is_dir():
        raise BadInputError("--suite shared", f"the open cases are not here: {folder}")
    order = np.random.default_rng(seed).permutation(len(list(folder.glob("*/truth.json"))))
    return list(shared_cases(folder, order.tolist()[:cases]))


def _real(seed: int, cases: int) -> list[Batch]:
    if not (SHARED / "data").is_dir():
        raise BadInputError("--suite real", f"the real recordings are not here: {SHARED / 'data'}")
    batches = real_cases(SHARED / "data", seed)
    return [batches[k] for k in np.random.default_rng(seed).permutation(len(batches))[:cases]]


def _concealed(name: str) -> Callable[[int, int], list[Batch]]:
    return lambda seed, cases: concealed(name, seed, cases)


SUITES = {
    s.name: s
    for s in (
        *(Suite(name, "the concealed world", count, _concealed(name)) for name, count in CONCEALED.items()),
        Suite("shared", "the eight open cases", 8, _shared),
        Suite("real", "real recordings with a channel withheld", REAL_CASES, _real),
    )
}


def exam_seed(entropy: int) -> int:
    """A seed that no development run can have had, from so much entropy."""
    return _OPEN_SEEDS + entropy


def checked_seed(seed: int, exam: bool) -> int:
    """A development seed as given. Raises BadInputError for one that belongs to exams."""
    if not exam and not 0 <= seed < _OPEN_SEEDS:
        raise BadInputError("--seed", f"{seed} belongs to exams", f"development has 0 to {_OPEN_SEEDS - 1}")
    return seed


def suite(name: str) -> Suite:
    """A suite by name. Raises BadInputError for one that is not known."""
    if name not in SUITES:
        raise BadInputError(f"--suite {name}", "is not known", f"known are {', '.join(SUITES)}")
    return SUITES[name]


def shares(total: int, parts: int) -> list[int]:
    """``total`` in at most ``parts`` of like size, the larger first."""
    size = max(1, math.ceil(total / max(parts, 1)))
    return [min(size, total - begin) for begin in range(0, total, size)]
