"""The suite of real recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sim.proof.cases import Batch
from sim.proof.real.bench import NASA, maxamps, nasa, panasonic
from sim.proof.real.injected import injected
from sim.proof.real.matrice import matrice

_COUNTS = {"matrice": 5, "panasonic": 3, "maxamps": 2, "nasa": len(NASA), "injected": 9}
CASES = sum(_COUNTS.values())


def real_cases(data: Path, seed: int) -> list[Batch]:
    """Every case of it, numbered in an order that says nothing."""
    numbers = iter(np.random.default_rng(seed).permutation(CASES).tolist())
    names = {kind: [f"real-{next(numbers):03d}" for _ in range(count)] for kind, count in _COUNTS.items()}
    return [
        *matrice(data, seed, names["matrice"]),
        *panasonic(data, names["panasonic"]),
        *maxamps(data, names["maxamps"]),
        *nasa(data, names["nasa"]),
        *injected(data, seed, names["injected"]),
    ]
