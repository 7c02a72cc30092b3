"""Cells drawn at random come back from their recordings as well as is stated; `make prove` draws 200 of each model."""

from __future__ import annotations

import pytest
from identification.known import ALLOWED, found_again

TOLD_AT_LEAST = {"circ": ("r_s", "r_sp0", "c_sp"), "chem": ("t_diffusion", "r_o", "i_p0", "tau_p")}


@pytest.mark.parametrize("model", ["circ", "chem"])
def test_parameters_come_back_within_three_of_their_standard_deviations(model):
    found = found_again(model, seed=1)
    off = {p.name: p.off for p in found if p.told}
    assert set(TOLD_AT_LEAST[model]) <= set(off)
    assert all(abs(by) < ALLOWED for by in off.values()), off
