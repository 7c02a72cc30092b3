"""A battery's own numbers go where its flights have them, and its file says how well they tell its charge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import (
    BATTERY,
    SERIES,
    base,
    error,
    flown,
    four,
    noise_model,
    off_by_its_curve,
    told_its_form,
    with_members,
)

from bhm_service.battery.battery_file import read_battery, write_battery
from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.as_flown import as_flown
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import BEND_SOC
from bhm_service.discrepancy.lab_file import lab_of

NOISE = noise_model()
OFF_V = 0.008  # of a cell
FLOWN_SOC = np.linspace(0.45, 0.95, 11)
ONE_PER_CENT = 0.01


def bent(model, seed=0):
    """Flights of a pack whose curve lies lower than its lab's by a little where it is half full."""
    return off_by_its_curve(four(model=model, seed=seed), OFF_V)


def fitted_where_told(flights, model):
    """A fit of no effect by a lab that told what its model's form is off by: little else than its curve is open."""
    return fit(Joint(told_its_form(lab_of(BATTERY, model, None, None)), tuple(flights)), NOISE)


def test_resistance_and_capacity_go_into_the_cell_itself():
    joint = base(four("resistance-growth"))
    fitted = fit(joint, NOISE)
    new = as_flown(BATTERY, [fitted])
    ohmic, charge = (float(np.exp(fitted.x[joint.places[f"lab_{name}"]][0])) for name in ("resistance", "capacity"))
    assert ohmic > 1.01
    assert new.circ.r_s == pytest.approx(ohmic * BATTERY.circ.r_s)
    assert new.circ.c_max == pytest.approx(charge * BATTERY.circ.c_max)
    assert new.chem.r_o == pytest.approx(ohmic * BATTERY.chem.r_o)  # of one pack, told by one model
    assert new.sd["circ"]["c_max"] == pytest.approx(new.circ.c_max * fitted.sd("lab_capacity")[0])


@pytest.mark.parametrize("model", ["circ", "chem"])
def test_the_curve_goes_where_the_flights_have_it(model, tmp_path):
    write_battery(tmp_path / "battery.toml", as_flown(BATTERY, [fitted_where_told(bent(model), model)]))
    new = read_battery(tmp_path / "battery.toml")
    moved = new.cell(model).open_circuit(FLOWN_SOC) - BATTERY.cell(model).open_circuit(FLOWN_SOC)
    assert np.corrcoef(moved, OFF_V * np.sin(2.0 * np.pi * (1.0 - FLOWN_SOC)))[0, 1] > 0.9
    unseen = bent(model, seed=9)
    assert error(new, model, unseen) < 0.75 * error(BATTERY, model, unseen)


def test_a_rest_of_the_curve_that_was_there_stays_in_it():
    once = as_flown(BATTERY, [fitted_where_told(bent("chem"), "chem")])
    plain = fitted_where_told(four(model="chem"), "chem")
    twice, alone = as_flown(once, [plain]), as_flown(BATTERY, [plain])

    def moved(new, old):
        return new.chem.open_circuit(FLOWN_SOC) - old.chem.open_circuit(FLOWN_SOC)

    assert np.max(np.abs(moved(once, BATTERY))) > 0.4 * OFF_V
    assert moved(twice, once) == pytest.approx(moved(alone, BATTERY), abs=1e-5)


def test_a_curve_of_one_model_is_not_bent_by_what_the_other_is_off_by():
    new = as_flown(BATTERY, [fit(base(bent("circ")), NOISE)])
    assert new.chem.curve_rest == BATTERY.chem.curve_rest
    assert new.circ.ocv != BATTERY.circ.ocv


def test_what_the_lab_left_open_of_a_curve_stays_where_it_was():
    fitted = fitted_where_told(bent("circ"), "circ")
    battery = replace(BATTERY, left_open={"circ": fitted.joint.lab.left_open})
    new = as_flown(battery, [fitted])
    left_v = np.array(new.left_open["circ"].mean["bends"])
    assert np.max(np.abs(left_v)) > 0.3 * OFF_V
    assert new.circ.open_circuit(BEND_SOC) + left_v == pytest.approx(BATTERY.circ.open_circuit(BEND_SOC), abs=5e-4)


def test_the_file_says_how_well_the_fit_tells_the_charge_its_effects_with_it():
    joint = with_members([flown([EFFECTS["capacity-fade"](fade=0.1)], number=k, samples=150) for k in range(2)],
                         {"capacity-fade"})  # fmt: skip
    fitted = fit(joint, NOISE)
    drawn = np.random.default_rng(1).multivariate_normal(fitted.x, fitted.covariance, 4000)
    told = joint.values(drawn)
    left = told["lab_capacity"][:, 0] + np.log1p(-told["capacity-fade.fade"][:, 0])
    assert np.std(left) > 1.2 * ONE_PER_CENT
    assert as_flown(BATTERY, [fitted]).uncertainty.capacity == pytest.approx(np.std(left), rel=0.1)


def test_charge_past_the_sensor_is_a_part_of_it():
    joint = with_members(four("unseen-load"), {"unseen-load"})
    fitted = fit(joint, NOISE)
    flight = joint.flights[-1]
    amps = float(np.mean(flight.current_a[flight.airborne]))
    load = float(joint.values(fitted.x[None, :])["unseen-load.current"][0, 0])
    counted = joint.counted_c(fitted.x[None, :], 3)[0]
    capacity = float(np.exp(fitted.x[joint.places["lab_capacity"]][0])) * BATTERY.circ.c_max
    assert counted == pytest.approx(capacity * amps / (amps + load), rel=1e-6)


def test_no_file_is_surer_of_a_pack_than_a_lab_is():
    fitted = fit(base(four()), NOISE)
    assert fitted.sd("lab_capacity")[0] < ONE_PER_CENT
    assert as_flown(BATTERY, [fitted]).uncertainty.capacity == ONE_PER_CENT


def test_a_file_of_a_cell_that_any_pack_may_be_built_from_has_the_resistance_alone():
    """Its pack's charge is the vehicle file's: of a larger cell a pack would have fewer side by side, and no more."""
    cell = replace(BATTERY, series=None)
    lab = lab_of(cell, "circ", SERIES, 2.0 * BATTERY.circ.c_max)
    fitted = fit(Joint(lab, tuple(four("capacity-fade"))), NOISE)
    new = as_flown(cell, [fitted])
    assert abs(fitted.x[fitted.joint.places["lab_capacity"]][0]) > ONE_PER_CENT
    assert new.circ == replace(cell.circ, r_s=new.circ.r_s)
    assert new.circ.r_s == pytest.approx(cell.circ.r_s * np.exp(fitted.x[fitted.joint.places["lab_resistance"]][0]))
    assert new.uncertainty == cell.uncertainty
    assert set(new.sd["circ"]) == {"r_s"}
