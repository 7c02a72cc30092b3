"""What the lab leaves open: it adds to the voltage as it says, and contradictions of pack and vehicle are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from battery.cells import CAPACITY_C, circ
from discrepancy.flown import BATTERY, SERIES, base, flown, told_its_form

from bhm_service.battery.battery_file import BatteryFile, Joined
from bhm_service.battery.effects import DoubleLayer
from bhm_service.battery.left_open import left_open
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.discrepancy.lab import BEND_SOC, DROP_S, DROP_SOC, FORM, followed
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.errors import BadInputError

GENERIC = BatteryFile(name="generic", circ=circ(), uncertainty=Uncertainty(resistance=0.5, capacity=0.1))
FLIGHT = flown(samples=200)


@pytest.fixture(scope="module")
def joint():
    return base([FLIGHT])


@pytest.mark.parametrize("block", ["lab_bends", "lab_drop_0", "lab_drop_30", "lab_lag", "lab_lag_at", "lab_curve"])
def test_what_an_addition_adds_is_what_the_prediction_changes_by(joint, block):
    """Twice the number is twice the change, and it is the row that `added` gives."""
    joint = replace(joint, lab=told_its_form(joint.lab, block == "lab_lag_at")) if "lab_lag" in block else joint
    x = joint.unknowns.start
    where = np.arange(joint.places[block].start, joint.places[block].stop)
    knot = where[round(0.8 * (where.size - 1))]
    points = np.tile(x, (3, 1))
    points[1, knot] += joint.scale[knot]
    points[2, knot] += 2.0 * joint.scale[knot]
    modelled = joint.predicted(points, 0)
    once, twice = modelled.voltage[1] - modelled.voltage[0], modelled.voltage[2] - modelled.voltage[0]
    np.testing.assert_allclose(twice, 2.0 * once, atol=1e-9)
    rows = joint.lab.added(followed(FLIGHT.time_s, FLIGHT.current_a), FLIGHT.current_a, modelled.soc)
    row = rows[knot - joint.places["lab_bends"].start]
    np.testing.assert_allclose(once, joint.scale[knot] * row, atol=1e-9)
    assert np.abs(once).max() > 1e-4


def test_the_vehicles_meter_is_a_told_labs_to_half_a_thousandth_and_reads_nothing_after_landing(joint):
    joint = replace(joint, lab=told_its_form(joint.lab))
    points = np.tile(joint.unknowns.start, (2, 1))
    points[1, joint.places["lab_meter"]] += joint.scale[joint.places["lab_meter"]]
    modelled = joint.predicted(points, 0)
    np.testing.assert_allclose(modelled.voltage[1] - modelled.voltage[0], 5e-4 * 3.8 * SERIES, rtol=1e-9)
    assert modelled.rested[1] == modelled.rested[0]


def test_of_a_lab_that_told_no_form_no_meter_is_apart_from_its_curve(joint):
    assert "lab_meter" not in joint.places


def test_a_lag_is_of_charge_a_cell_is_at_its_curves_voltage_for_less_than_it_holds(joint):
    """At the hover's current, which has gone on for long; where the curve is steeper it costs the more voltage."""
    lab = told_its_form(joint.lab)
    soc, hover = np.array([0.15, 0.35, 0.9]), 2.0 * lab.capacity_c / 3600.0
    first = BEND_SOC.size + len(DROP_S) * DROP_SOC.size
    settled = np.concatenate([np.full((len(DROP_S), 3), hover), np.zeros((1, 3))])
    rows = lab.added(settled, np.full(3, hover), soc)[first : first + len(DROP_S)]
    curve = lab.cell.open_circuit
    np.testing.assert_allclose(0.02 * rows, np.tile(SERIES * (curve(soc - 0.02) - curve(soc)), (len(DROP_S), 1)))
    assert rows[0, 0] < 3.0 * rows[0, 1] < 0.0


def test_of_a_lab_that_told_no_form_no_lag_is_apart_from_its_drops(joint):
    assert "lab_lag" not in joint.places


def test_bends_are_millivolts_of_a_cell_at_their_charge(joint):
    rows = joint.lab.added(np.zeros((len(DROP_S) + 1, 3)), np.zeros(3), np.array([0.2, 0.5, 0.81]))[: BEND_SOC.size]
    np.testing.assert_allclose(rows.sum(axis=0), SERIES)
    assert rows[BEND_SOC.searchsorted(0.2), 0] == pytest.approx(SERIES)


def test_a_drop_is_ohms_law_at_once_and_lags_by_its_time(joint):
    t, amps = np.arange(0.0, 400.0, 2.0), np.full(200, 10.0)
    rows = joint.lab.added(followed(t, amps), amps, np.full(200, DROP_SOC[1]))
    drops = rows[BEND_SOC.size :][: len(DROP_S) * DROP_SOC.size].reshape(len(DROP_S), DROP_SOC.size, -1)
    full = -SERIES * joint.lab.ohm * 10.0
    np.testing.assert_allclose(drops[0, 1], full)
    np.testing.assert_allclose(drops[3, 1], full * (1.0 - np.exp(-t / DROP_S[3])), atol=0.02 * abs(full))
    assert not drops[:, 3].any()


def test_ties_hold_the_resistance_at_each_charge_however_it_is_split(joint):
    """What one scale of resistance does, opposite drops undo: such a sum costs nothing, both alike cost much."""
    x = joint.unknowns.start.copy()
    # One per cent more resistance, ohmic and of polarisation, in numbers of the fit.
    x[joint.places["lab_resistance"]] = x[joint.places["lab_polarisation"]] = 0.01
    ties = joint.lab.known(joint.unknowns)[x.size :]
    alone = ties @ joint.unknowns.pulls(x)[0]
    x[joint.places["lab_drop_0"]] = -0.01 * joint.lab.ohmic_share
    x[joint.places["lab_drop_30"]] = -0.01 * (1.0 - joint.lab.ohmic_share)
    undone = ties @ joint.unknowns.pulls(x)[0]
    assert np.abs(alone).max() > 0.05
    np.testing.assert_allclose(undone, 0.0, atol=1e-9)


def test_shapes_are_widened_by_what_a_fit_shows_and_never_narrowed(joint):
    lab = joint.lab
    blocks = {b.name: b.start.size for b in lab.additions()}
    same = lab.widened(lambda name: np.full(blocks[name], 0.2))
    wider = lab.widened(lambda name: np.full(blocks[name], 2.0 if name in ("lab_bends", "lab_drop_30") else 0.2))
    most = lab.widened(lambda name: np.full(blocks[name], 100.0))
    assert same.bend_sd_v == lab.bend_sd_v
    assert same.drop_sds == pytest.approx(lab.drop_sds)
    assert wider.bend_sd_v == pytest.approx(2.0 * lab.bend_sd_v)
    assert wider.drop_sds == pytest.approx(lab.drop_sds | {30.0: 2.0 * lab.drop_sds[30.0]})
    assert max(most.drop_sds[t] / lab.drop_sds[t] for t in DROP_S) < 10.0


@pytest.mark.parametrize("form", [{"bends": 3}, dict(reversed(FORM.items()))], ids=["another", "in another order"])
def test_a_lab_that_told_something_else_is_refused_with_what_to_do(form):
    other = left_open({name: np.zeros(count) for name, count in form.items()}, np.eye(sum(form.values())))
    with pytest.raises(BadInputError, match=r"left_open.circ is of another version of bhm\s+identify the pack again"):
        lab_of(replace(BATTERY, left_open={"circ": other}), "circ", None, None)


def test_what_the_lab_left_open_is_widened_by_what_differs_in_flight_only():
    """As far as its own recordings show it, no flight makes it less known."""
    size = sum(FORM.values())
    told = left_open({name: np.zeros(count) for name, count in FORM.items()}, 1e-4 * np.eye(size))
    lab = lab_of(replace(BATTERY, left_open={"circ": told}), "circ", None, None)
    wider = lab.widened(lambda name: np.full(FORM[name.removeprefix("lab_")], 2.0))
    before, after = (one.form[1] - told.covariance for one in (lab, wider))
    drops = slice(BEND_SOC.size, -2)
    np.testing.assert_allclose(after[drops, drops], 4.0 * before[drops, drops])


@pytest.mark.parametrize(("error_v", "sd_v"), [(0.002, 0.003), (0.02, 0.006), (0.06, 0.018)])
def test_of_a_told_form_flights_may_be_apart_by_a_share_of_what_the_model_is_off_by(error_v, sd_v):
    """However far it is off; of a form that no lab told nobody takes a curve to be off by more than labs leave it."""
    plain = replace(BATTERY, uncertainty=replace(BATTERY.uncertainty, voltage_error_v=error_v))
    told = lab_of(replace(plain, left_open={"circ": told_its_form(base([]).lab).left_open}), "circ", None, None)
    assert told.bend_sd_v == pytest.approx(sd_v)
    assert lab_of(plain, "circ", None, None).bend_sd_v == pytest.approx(min(sd_v, 0.010))


@pytest.mark.parametrize(("said_v", "own_v"), [(0.002, 0.002), (None, 0.02)])
def test_how_well_a_model_follows_the_lab_is_its_own_and_how_flights_may_differ_is_of_the_worse(said_v, own_v):
    """A model that follows a lab closely need not follow flights as closely."""
    told = told_its_form(base([]).lab).left_open
    known = replace(BATTERY, uncertainty=replace(BATTERY.uncertainty, voltage_error_v=0.02))
    lab, silent = (
        lab_of(replace(known, left_open={"circ": replace(told, error_v=v)}), "circ", None, None) for v in (said_v, None)
    )
    assert lab.own_error_v == own_v
    assert replace(lab, own_error_v=0.0, left_open=told) == replace(silent, own_error_v=0.0, left_open=told)


@pytest.mark.parametrize(("load_v", "counted_v"), [(0.03, 0.03), (0.008, 0.008), (0.001, 0.003), (None, 0.02)])
def test_flights_may_differ_by_what_a_varying_load_that_no_fit_saw_is_off_by(load_v, counted_v):
    """That of this model, whatever the other one is off by; where no recording told it, the worse of both on pieces."""
    told = replace(told_its_form(base([]).lab).left_open, load_error_v=load_v)
    known = replace(BATTERY, uncertainty=replace(BATTERY.uncertainty, voltage_error_v=0.02))
    lab = lab_of(replace(known, left_open={"circ": told}), "circ", None, None)
    assert lab.voltage_error_v == counted_v
    assert lab.bend_sd_v == pytest.approx(max(0.3 * counted_v, 0.003))


def test_what_a_double_layer_holds_back_for_a_second_goes_at_once_for_a_log_at_one_hertz():
    """Its pair and the series resistance share what another identification has in the series resistance alone."""
    layers = [Joined(effect=DoubleLayer(exchange_current=20.0, time_constant=s)) for s in (1.0, 20.0)]
    bare, quick, slow = (
        lab_of(replace(BATTERY, joined=joined), "circ", None, None) for joined in [(), *((layer,) for layer in layers)]
    )
    assert quick.ohm == slow.ohm > 1.1 * bare.ohm
    assert quick.ohmic - bare.ohmic == pytest.approx(SERIES * (quick.ohm - bare.ohm))
    assert slow.ohmic == pytest.approx(bare.ohmic) == pytest.approx(SERIES * circ().r_s)


def test_a_curve_is_off_by_about_the_same_at_charges_that_are_near():
    told = left_open({name: np.zeros(count) for name, count in FORM.items()}, 1e-12 * np.eye(sum(FORM.values())))
    lab = lab_of(replace(BATTERY, left_open={"circ": told}), "circ", None, None)
    covariance = lab.form[1][: BEND_SOC.size, : BEND_SOC.size]
    alike = covariance / np.outer(lab.bend_sds_v, lab.bend_sds_v)
    assert alike[12, 13] > 0.9
    assert alike[5, 20] < 0.1


def test_a_cell_like_its_own_is_known_less_well_than_the_very_pack():
    own, like = lab_of(BATTERY, "circ", None, None), lab_of(GENERIC, "circ", SERIES, 2.0 * CAPACITY_C)
    assert own.identified
    assert not like.identified
    assert like.resistance_sd > own.resistance_sd
    assert like.parallel == pytest.approx(2.0)
    assert like.capacity_c == pytest.approx(2.0 * CAPACITY_C)


def test_a_vehicle_with_another_number_of_cells_is_refused():
    with pytest.raises(BadInputError, match="known: is a pack of 6 cells, the vehicle file says 4"):
        lab_of(BATTERY, "circ", 4, None)


def test_a_cell_without_a_number_of_cells_is_asked_about():
    with pytest.raises(BadInputError, match="how many cells"):
        lab_of(GENERIC, "circ", None, None)


def test_a_model_that_the_file_has_not_is_named():
    with pytest.raises(BadInputError, match=r"no \[chem\] section"):
        lab_of(replace(BATTERY, chem=None), "chem", None, None)
