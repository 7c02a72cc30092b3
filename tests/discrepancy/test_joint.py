"""All flights under one hypothesis: the model that is fitted is the pack model, and its derivatives are right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import AMBIENT_K, BATTERY, SERIES, base, catalogue, flown, told_its_form, with_members

from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.pack import PackModel
from bhm_service.discrepancy.confirm import restricted, subset
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.noise import Noise

NOISE = Noise(0.95, 0.7, 0.008)
FLIGHTS = [flown(number=k, kelvin=AMBIENT_K[k], samples=150) for k in range(2)]
MEMBERS = [
    {"capacity-fade"}, {"resistance-temperature"}, {"unseen-load", "contact-resistance"}, {"partial-charge"},
    {"voltage-offset", "hysteresis"}, {"time-skew"},
    {"slow-diffusion"},
]  # fmt: skip
IDS = ["+".join(sorted(m)) for m in MEMBERS]


@pytest.mark.parametrize("model", ["circ", "chem"])
def test_the_battery_as_it_is_is_the_pack_model_itself(model):
    joint = base(FLIGHTS, model)
    modelled = joint.predicted(joint.unknowns.start[None, :], 0)
    pack = PackModel(BATTERY.cell(model), SERIES)
    data = FLIGHTS[0]
    run = pack.simulate(data.time_s, data.current_a, 1.0, data.temperature_k)
    np.testing.assert_allclose(modelled.voltage[0], np.ravel(run.voltage), atol=1e-9)
    np.testing.assert_allclose(modelled.soc, np.ravel(run.soc), atol=1e-12)


@pytest.mark.parametrize("name", ["capacity-fade", "resistance-temperature", "unseen-load"])
def test_a_member_is_its_effect_of_the_catalogue_and_what_it_adds_is_the_difference(name):
    joint = with_members(FLIGHTS, {name})
    x = joint.unknowns.start[None, :]
    (unknown,) = joint.members[0].amplitudes()
    size = joint.values(x)[unknown.name][0, 0] * unknown.declared.scale
    data = FLIGHTS[1]
    packs = [
        PackModel(BATTERY.cell("circ"), SERIES, 1.0, e) for e in ([EFFECTS[name](**{unknown.declared.name: size})], [])
    ]
    full, bare = (np.ravel(p.simulate(data.time_s, data.current_a, 1.0, data.temperature_k).voltage) for p in packs)
    modelled = joint.predicted(x, 1)
    np.testing.assert_allclose(modelled.voltage[0], full, atol=1e-9)
    np.testing.assert_allclose(modelled.members[0], full - bare, atol=1e-9)
    assert np.abs(full - bare).max() > 0.02


def test_a_drop_that_the_lab_told_is_the_cells_own_and_grows_with_it_in_the_cold():
    """As of a cell that has it in its resistance, or in a pair behind it which diffusion slows down."""
    cold = [replace(f, temperature_k=f.temperature_k - 15.0) for f in FLIGHTS]
    joint = with_members(cold, {"resistance-temperature"})
    joint = replace(joint, lab=told_its_form(joint.lab))
    law = EFFECTS["resistance-temperature"](activation_energy=22e3)
    cell, ohm, data = BATTERY.cell("circ"), 0.2 * joint.lab.ohm, cold[1]

    def told(name):
        x = joint.unknowns.start.copy()
        x[joint.places["resistance-temperature.activation_energy"]] = 22.0
        x[joint.places[name]] = 0.2
        return joint.predicted(x[None, :], 1).voltage[0]

    def flown_by(cell, *slow):
        pack = PackModel(cell, SERIES, 1.0, [law, *slow])
        return np.ravel(pack.simulate(data.time_s, data.current_a, 1.0, data.temperature_k).voltage)

    np.testing.assert_allclose(told("lab_drop_0"), flown_by(replace(cell, r_s=cell.r_s + ohm)), atol=1e-9)
    pair = EFFECTS["slow-diffusion"](resistance=ohm, time_constant=120.0)
    off = told("lab_drop_120") - flown_by(cell, pair)
    assert np.abs(off).max() < 0.1 * np.ptp(flown_by(cell, pair) - flown_by(cell))


def test_a_drop_that_the_lab_told_takes_longer_and_grows_where_diffusion_is_slower():
    """As one of a pair behind the cell, which diffusion slows down; what is there at once stays what it is."""
    joint = with_members(FLIGHTS, {"slow-diffusion"})
    joint = replace(joint, lab=told_its_form(joint.lab))
    cell, ohm, data = BATTERY.cell("circ"), 0.2 * joint.lab.ohm, FLIGHTS[1]

    def told(name):
        x = joint.unknowns.start.copy()
        x[joint.places["slow-diffusion.resistance"]] = 0.0
        x[joint.places["slow-diffusion.slowing"]] = 1.8
        x[joint.places[name]] = 0.2
        return joint.predicted(x[None, :], 1).voltage[0]

    def flown_by(cell, of_lab_ohm):
        slower = EFFECTS["slow-diffusion"](resistance=of_lab_ohm, time_constant=120.0, slowing=1.8)
        return np.ravel(PackModel(cell, SERIES, 1.0, [slower]).simulate(data.time_s, data.current_a, 1.0).voltage)

    np.testing.assert_allclose(told("lab_drop_0"), flown_by(replace(cell, r_s=cell.r_s + ohm), 0.0), atol=1e-9)
    off = told("lab_drop_120") - flown_by(cell, ohm)
    assert np.abs(off).max() < 0.1 * np.ptp(flown_by(cell, ohm) - flown_by(cell, 0.0))


@pytest.mark.parametrize("skew_s", [-2.0, -0.5, 1.0])
def test_a_skew_is_the_whole_voltage_of_another_instant_however_the_samples_were_averaged(skew_s):
    """With all that relaxes in it, not the ohmic drop alone."""
    cell = replace(BATTERY.cell("circ"), r_sp0=0.003, c_sp=600.0)
    fast = replace(BATTERY, circ=cell)
    data = flown(number=1, samples=360, step_s=1.0, rested=False)
    moved = np.interp(data.time_s + skew_s, data.time_s, data.current_a)
    run = PackModel(cell, SERIES).simulate(data.time_s, moved, 1.0)
    late = replace(data, voltage_v=np.ravel(run.voltage)).thinned(120)
    lab = lab_of(fast, "circ", None, None)
    joint = Joint(lab, (late,), tuple(catalogue([late], only={"time-skew"})))
    x = joint.unknowns.start.copy()
    plain = joint.predicted(x[None, :], 0).voltage[0]
    x[joint.places["time-skew.skew"]] = skew_s
    inner = slice(3, -3)
    off = (late.voltage_v - joint.predicted(x[None, :], 0).voltage[0])[inner]
    without = (late.voltage_v - plain)[inner]
    # What relaxes is followed along the averages, which run straight between each other.
    assert np.sqrt(np.mean(off**2)) < 0.25 * np.sqrt(np.mean(without**2))
    assert np.abs(without).max() > 0.05


@pytest.mark.parametrize("model", ["circ", "chem"])
@pytest.mark.parametrize("told", [False, True], ids=["", "told"])
@pytest.mark.parametrize("members", MEMBERS, ids=IDS)
def test_derivatives_are_those_of_the_residuals(model, told, members):
    """Against central differences with another step, number by number, with the lab's errors and the forms at work.

    Where derivatives leave out how these move with the charge and with what a member adds, a fit ends beside its best.
    """
    rng = np.random.default_rng(7)
    joint = with_members(FLIGHTS, members, model)
    joint = replace(joint, lab=told_its_form(joint.lab)) if told else joint
    x = joint.unknowns.start.copy()
    inner = 0.5 * (joint.unknowns.low + joint.unknowns.high)
    x[joint.places["start_soc"]] = 0.97  # below full, where the curve is defined on both sides
    for member in joint.members:
        for u in member.unknowns:
            where = joint.places[u.name]
            x[where] += 0.3 * joint.scale[where] * np.sign(inner[where] - x[where] + 1e-12)
    adding = np.flatnonzero(
        [not n.startswith("lab_skew") and n.startswith(("lab_", "form_")) for n in joint.unknowns.names]
    )
    x[adding] += joint.scale[adding] * rng.normal(size=adding.size)
    slopes = full_slopes(joint, x)
    step = 2e-4
    for k in range(x.size):
        sides = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[k] += sign * step * joint.scale[k]
            sides.append(np.concatenate(joint.linearised(moved, NOISE)[0]))
        truth = (sides[0] - sides[1]) / (2.0 * step)
        ours = np.concatenate([s[:, k] for s in slopes])
        assert np.linalg.norm(ours - truth) < 0.02 * np.linalg.norm(truth) + 1e-6, joint.unknowns.names[k]


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_full_charge_is_known_to_a_hundredth_and_from_flight_to_flight_to_a_third_of_that(count):
    joint = base([flown(number=k, samples=20) for k in range(count)])
    where, scale = joint.places["start_soc"], joint.scale
    spread = np.linalg.inv(joint.known)[where, where] * np.outer(scale[where], scale[where])
    common = 0.01**2 - 0.003**2
    np.testing.assert_allclose(spread, common + 0.003**2 * np.eye(count), rtol=1e-9)


def test_a_charge_that_a_gauge_told_says_nothing_of_other_flights():
    flights = [replace(flown(number=k, samples=20), reading=reading) for k, reading in enumerate([None, 0.7, None])]
    joint = base(flights)
    where, scale = joint.places["start_soc"], joint.scale
    spread = np.linalg.inv(joint.known)[where, where] * np.outer(scale[where], scale[where])
    np.testing.assert_allclose(spread[1], [0.0, 0.02**2, 0.0], atol=1e-15)
    assert spread[0, 2] == pytest.approx(0.01**2 - 0.003**2)


def test_what_belongs_to_a_flight_moves_no_other():
    joint = with_members(FLIGHTS, {"partial-charge"})
    slopes = full_slopes(joint, joint.unknowns.start)
    for name in ("start_soc", "partial-charge.deficit"):
        first = joint.places[name].start
        assert np.abs(slopes[0][:, first]).max() > 0.0
        assert not slopes[1][:, first].any()


def test_readings_that_are_missing_weigh_nothing():
    holed = replace(FLIGHTS[0], voltage_v=np.where(np.arange(150) == 60, np.nan, FLIGHTS[0].voltage_v))
    joint = base([holed, FLIGHTS[1]])
    rows, _ = joint.linearised(joint.unknowns.start, NOISE)
    slopes = full_slopes(joint, joint.unknowns.start)
    assert rows[0][60] == 0.0
    assert not slopes[0][60].any()
    assert np.isfinite(rows[0]).all()


def full_slopes(joint, x):
    """Of every flight by the whole vector."""
    return [slope.full() for slope in joint.linearised(x, NOISE)[1]]


UNLIKE = [
    flown(number=0, kelvin=AMBIENT_K[0], samples=150),
    flown(number=1, samples=90, step_s=4.0, rested=False),
    flown(number=2, kelvin=AMBIENT_K[2], samples=200, step_s=1.0),
]


@pytest.mark.parametrize("names", [set(), {"capacity-fade", "partial-charge"}, {"resistance-shape"}, {"time-skew"}])
def test_flights_side_by_side_are_as_each_alone(names):
    """Of different lengths and steps, with a temperature and without, rested and not, holes in the second."""
    volts = UNLIKE[1].voltage_v.copy()
    volts[[0, 40, 89]] = np.nan
    joint = with_members([UNLIKE[0], replace(UNLIKE[1], voltage_v=volts), UNLIKE[2]], names)
    start = joint.unknowns.start
    x = start + 0.3 * joint.scale * np.sin(np.arange(start.size))
    together = joint.all_predicted(x[None, :])
    rows, slopes = joint.linearised(x, NOISE)[0], full_slopes(joint, x)
    for k, (modelled, own) in enumerate(zip(together, joint.residuals(x, NOISE), strict=True)):
        alone = joint.predicted(x[None, :], k)
        np.testing.assert_allclose(modelled.voltage, alone.voltage, atol=1e-9)
        np.testing.assert_allclose(modelled.members, alone.members, atol=1e-9)
        assert (modelled.rested is None) is (alone.rested is None)
        np.testing.assert_allclose(rows[k], own, atol=1e-9)
        others = {"start_soc", "partial-charge.deficit", *(f"form_flight.{name}" for name in names)} & set(joint.places)
        single = subset(joint, [k])
        kept = restricted(Fitted(joint, NOISE, x, 0.0, [], np.zeros((0, 0)), np.zeros(0)), single, [k])
        (lone,), (slope,) = single.linearised(kept, NOISE)[0], full_slopes(single, kept)
        np.testing.assert_allclose(rows[k], lone, atol=1e-9)
        for name, where in joint.places.items():
            mine = (slopes[k] / joint.scale)[:, where]
            mine = mine[:, k : k + 1] if name in others else mine
            found = (slope / single.scale)[:, single.places[name]]
            # How one start is known depends on the others, and with it the step across the curve's bends.
            near = 3e-3 if name == "start_soc" else 1e-5
            np.testing.assert_allclose(mine, found, atol=near * np.abs(mine).max() + 1e-9)


@pytest.mark.parametrize("told", [None, False, True], ids=["", "told", "told by charge"])
@pytest.mark.parametrize("members", MEMBERS, ids=IDS)
def test_vectors_far_from_each_other_are_as_each_alone(told, members):
    """With lab's errors that bend over the charge, forms, and skews, more of them than are taken at once."""
    rng = np.random.default_rng(11)
    joint = with_members(UNLIKE, members)
    joint = joint if told is None else replace(joint, lab=told_its_form(joint.lab, by_charge=told))
    start, apart = joint.unknowns.start, rng.normal(size=(19, joint.scale.size))
    points = np.clip(start + joint.scale * apart, joint.unknowns.low, joint.unknowns.high)
    points[7] = points[3]
    for x, rows in zip(points, joint.each_residuals(points, NOISE), strict=True):
        for own, alone in zip(rows, joint.residuals(x, NOISE), strict=True):
            np.testing.assert_allclose(own, alone, atol=1e-6)


@pytest.mark.parametrize("members", MEMBERS, ids=IDS)
def test_derivatives_by_some_numbers_are_those_among_all(members):
    joint = with_members(UNLIKE, members)
    x = joint.unknowns.start + 0.3 * joint.scale * np.sin(np.arange(joint.scale.size))
    first, blocks = sorted(members)[0], joint.places
    moving = {"start_soc", "lab_bends", "form_flight." + first, *(n for n in blocks if n.startswith(f"{first}."))}
    asked = np.concatenate([np.arange(blocks[n].start, blocks[n].stop) for n in moving])
    rows, some = joint.linearised(x, NOISE, moving)
    whole = joint.linearised(x, NOISE)
    for own, alone, slope, full in zip(rows, whole[0], some, whole[1], strict=True):
        np.testing.assert_allclose(own, alone, atol=1e-9)
        kept = np.zeros_like(full.full())
        kept[:, asked] = full.full()[:, asked]
        # Heat that feeds back is swept until all rows are near enough, so it depends on which there are.
        np.testing.assert_allclose(slope.full(), kept, atol=1e-4 * np.abs(kept).max())


def test_a_companion_that_two_members_have_is_one():
    """Both carry the pack's own heat, because no flight has a temperature: the first copy is the one that counts."""
    flights = [flown(number=k, samples=150) for k in range(2)]
    one = with_members(flights, {"resistance-temperature"})
    (member,) = one.members
    companion = next(part for part in member.parts if part[0] == "self-heating")
    other = replace(
        member,
        id="cold-capacity",
        parts=(("cold-capacity", EFFECTS["cold-capacity"]), companion),
        unknowns=tuple(u for u in member.unknowns if u.effect == "self-heating"),
    )
    joint = replace(one, members=(member, other))
    names = [b.name for b in joint.unknowns.blocks]
    assert names.count("self-heating.ambient") == 2
    assert all(joint.places[name] == joint.unknowns.slice_of(name) for name in names)


# ---- the voltage rested after landing ------------------------------------------------------------------------------


def rested(effects=(), names=(), rest_s=2e5):
    """Rested voltage that a hypothesis expects after a flight from full, at the sizes it starts with."""
    data = flown(effects, samples=150)
    data = replace(data, notes=replace(data.notes, rest_s=rest_s))
    joint = with_members([data], set(names))
    return float(joint.predicted(joint.unknowns.start[None, :], 0).rested[0, 0]), data, joint


def test_after_a_long_rest_the_voltage_is_the_open_circuits_at_the_charge_that_is_left():
    found, data, _ = rested()
    left = 1.0 - data.charge_c[-1] / float(BATTERY.circ.c_max)
    assert found == pytest.approx(SERIES * float(BATTERY.circ.ocv.voltage(np.array(left))), abs=1e-4)


def test_a_sensor_on_board_changes_nothing_of_what_another_meter_reads_at_rest():
    assert rested(names=("voltage-gain", "voltage-offset"))[0] == pytest.approx(rested()[0], abs=1e-9)


def test_a_load_past_the_sensor_stops_when_the_pack_is_unplugged():
    found, data, joint = rested(names=("unseen-load",))
    amps = joint.values(joint.unknowns.start[None, :])["unseen-load.current"][0, 0]
    left = 1.0 - (data.charge_c[-1] + amps * data.time_s[-1]) / float(BATTERY.circ.c_max)
    assert found == pytest.approx(SERIES * float(BATTERY.circ.ocv.voltage(np.array(left))), abs=1e-4)


def test_a_flight_without_that_voltage_has_one_residual_less():
    plain = replace(FLIGHTS[0], notes=replace(FLIGHTS[0].notes, rest_voltage_v=None))
    with_it, without = (base([f]).linearised(base([f]).unknowns.start, NOISE)[0][0] for f in (FLIGHTS[0], plain))
    assert with_it.size == without.size + 1
