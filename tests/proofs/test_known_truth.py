"""Two hundred cells of each model, drawn at random, come back from their recordings (`make proofs`)."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import pytest
from identification.known import ALLOWED, PARAMETERS, found_again

SEEDS = int(os.environ.get("BHM_SEEDS", "200"))
SHARE = 0.95


@pytest.mark.parametrize("model", ["circ", "chem"])
def test_every_told_parameter_is_within_three_standard_deviations(model, capsys):
    with ProcessPoolExecutor() as pool:
        cells = list(pool.map(partial(found_again, model), range(SEEDS)))
    shares = {}
    for name in PARAMETERS[model]:
        off = np.array([abs(p.off) for cell in cells for p in cell if p.name == name and p.told])
        if off.size:
            shares[name] = float(np.mean(off < ALLOWED))
            with capsys.disabled():
                print(f"\n{model} {name}: {shares[name]:.1%} of the {off.size} of {SEEDS} seeds that told it", end="")
    assert shares
    assert all(share >= SHARE for share in shares.values()), shares
