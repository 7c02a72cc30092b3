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


@pytest.mark.parametrize("ohm", [0.005, 0.06])
@pytest.mark.parametrize(("rest_s", "step_s"), [(60.0, 15.0), (0.0, 15.0), (120.0, 120.0)])
def test_one_discharge_that_is_logged_slowly_tells_the_curve_by_what_its_load_drops(ohm, rest_s, step_s):
    """From a rest; without one, or after minutes, what drops is what cells usually drop."""
    rng = np.random.default_rng(5)
    time_s = np.arange(0.0, rest_s + 3600.0, step_s)
    amps = np.where(time_s >= rest_s, 0.95 * CAPACITY_C / 3600.0, 0.0)
    cell = circ(r_s=ohm, r_sp0=0.4 * ohm)
    recording = recorded(PackModel(cell, 1), "rate", Kind.RATE, time_s, amps, rng)
    premises = premises_of([recording], None)
    soc = np.linspace(0.3, 1.0, 71)  # of the charge that was taken out
    out = float(np.max(recording.charge_c)) / CAPACITY_C
    off = premises.curve.voltage(soc) - np.asarray(cell.ocv.voltage(1.0 - out * (1.0 - soc)))
    lasting = 1.4 * ohm * float(amps.max())
    usual = ohm == 0.005
    assert np.max(np.abs(off)) < (0.25 * lasting + 0.005 if usual or rest_s > step_s else lasting)


def test_a_discharge_that_full_and_empty_are_taken_from_begins_full():
    rng = np.random.default_rng(6)
    pack = PackModel(circ(r_s=0.06, r_sp0=0.03, c_sp=1300.0), 1)
    deep, short = (
        recorded(pack, "rate", Kind.RATE, time_s, np.where(time_s >= 60.0, CAPACITY_C / 3600.0, 0.0), rng)
        for time_s in (np.arange(0.0, 3600.0, 15.0), np.arange(0.0, 900.0, 15.0))
    )
    assert premises_of([deep, short], None).soc(deep)[0] == 1.0
    told, _ = premises_of([deep, short], None).soc(short)  # by the voltage that it rested at
    assert told == pytest.approx(1.0, abs=0.02)
