"""Cells drawn at random come back from their recordings as well as is stated; `make proofs` draws 200 of each model."""

from __future__ import annotations

import pytest
from identification.known import ALLOWED, found_again

TOLD_AT_LEAST = {"circ": ("r_s", "r_sp0", "c_sp"), "chem": ("t_diffusion", "r_o", "i_p0", "tau_p")}


# Chem's seed 22 has its overpotentials' time constants within a factor of two: which is whose is told by little.
@pytest.mark.parametrize(("model", "seed"), [("circ", 1), ("chem", 1), ("chem", 22)])
def test_parameters_come_back_within_three_of_their_standard_deviations(model, seed):
    found = found_again(model, seed)
    off = {p.name: p.off for p in found if p.told}
    assert set(TOLD_AT_LEAST[model]) <= set(off)
    assert all(abs(by) < ALLOWED for by in off.values()), off
