"""Which capacity the fits start from."""

from __future__ import annotations

import numpy as np
import pytest
from battery.cells import CAPACITY_C, circ
from identification.known import cell_of, one_c, recorded, slow, variable

from bhm_service.battery.pack import PackModel
from bhm_service.identification.experiment import Kind
from bhm_service.identification.premises import premises_of

MAKERS = (slow, one_c, variable)


@pytest.mark.parametrize("model", ["circ", "chem"])
def test_a_cell_that_did_not_age_keeps_the_capacity_of_its_slow_discharge(model):
    rng = np.random.default_rng(2)
    pack = PackModel(cell_of(model, rng), 1)
    premises = premises_of([make(pack, rng) for make in MAKERS], None)
    assert premises.capacity_c == pytest.approx(CAPACITY_C, rel=0.005)


@pytest.mark.parametrize("seconds", [3420.0, 3720.0])
def test_more_charge_than_the_slow_discharge_gave_is_believed_only_where_it_was_taken_out(seconds):
    """Cells do not grow; a fit that wants them to makes up for what its model lacks."""
    rng = np.random.default_rng(4)
    given, larger = (PackModel(circ(c_max=share * CAPACITY_C), 1) for share in (1.0, 1.05))
    time_s = np.arange(0.0, 4500.0, 5.0)
    amps = np.where((time_s >= 60.0) & (time_s < 60.0 + seconds), CAPACITY_C / 3600.0, 0.0)
    one = recorded(larger, "one-C", Kind.ONE_C, time_s, amps, rng)
    premises = premises_of([slow(given, rng), one, variable(larger, rng)], None)
    told = 1.05 if seconds > 3600.0 else 1.0
    assert premises.capacity_c == pytest.approx(told * CAPACITY_C, rel=0.01)


def test_a_cell_that_aged_after_its_slow_discharge_is_the_later_one():
    rng = np.random.default_rng(3)
    new, aged = (PackModel(circ(c_max=share * CAPACITY_C), 1) for share in (1.0, 0.95))
    premises = premises_of([slow(new, rng), one_c(aged, rng), variable(aged, rng)], None)
    assert premises.capacity_c == pytest.approx(0.95 * CAPACITY_C, rel=0.01)
    assert any("less capacity than the slow discharge gave" in said for said in premises.remarks)
