from pathlib import Path

import numpy as np
import pytest
from battery.cells import chem, circ
from battery.effects.plausible import ALL, IDS, hover, joined, sizes

from bhm_service.battery.battery_file import BatteryFile, Joined, read_battery, write_battery
from bhm_service.battery.effects import EFFECTS, ResistanceTemperature
from bhm_service.battery.pack import PackModel
from bhm_service.estimation.tracker import Tracker
from bhm_service.messages import BatterySample, Model
from bhm_service.prediction.demand_effects import DEMAND_EFFECTS
from bhm_service.prediction.end_of_discharge import Limits, end_of_discharge

CELLS = pytest.mark.parametrize("cell", [circ(), chem()], ids=["circ", "chem"])
EFFECT = pytest.mark.parametrize("effect", ALL, ids=IDS)
SOC = 0.93


def measured(effect):
    return "temperature" in effect.drivers


@CELLS
@EFFECT
def test_steps_and_whole_recording_agree(cell, effect):
    t, current, temperature = hover()
    known = temperature if measured(effect) else None
    pack = PackModel(cell, 6, 1.0, joined(effect, **sizes(effect)))
    whole = pack.simulate(t, current, SOC, known)
    states = np.array(pack.start(SOC))
    volts = [float(pack.voltage(states, current[0], None if known is None else known[0]))]
    for k in range(1, t.size):
        now = None if known is None else known[k]
        states = pack.step(states, t[k] - t[k - 1], current[k - 1], current[k], now)
        volts.append(float(pack.voltage(states, current[k], now)))
    np.testing.assert_allclose(whole.voltage, volts, rtol=1e-9)
    np.testing.assert_allclose([s[-1] for s in whole.states], states, rtol=1e-8, atol=1e-10)


@CELLS
@EFFECT
def test_without_its_size_an_effect_changes_nothing(cell, effect):
    t, current, temperature = hover()
    absent = {p.name: p.si(p.absent) for p in effect.parameters() if p.absent is not None}
    bare = PackModel(cell, 6).simulate(t, current, SOC, temperature)
    idle = PackModel(cell, 6, 1.0, [effect(**sizes(effect) | absent)]).simulate(t, current, SOC, temperature)
    np.testing.assert_allclose(idle.voltage, bare.voltage, rtol=1e-12)


@CELLS
@EFFECT
def test_at_a_plausible_size_an_effect_shows(cell, effect):
    """By millivolts at least, if the model is one that it is for."""
    t, current, temperature = hover()
    known = temperature if measured(effect) else None
    others = joined(effect, **sizes(effect))
    without = PackModel(cell, 6, 1.0, others[:-1]).simulate(t, current, SOC, known)
    run = PackModel(cell, 6, 1.0, others).simulate(t, current, SOC, known)
    assert np.max(np.abs(run.voltage - without.voltage)) > 5e-3


@CELLS
@EFFECT
def test_columns_of_parameters_are_as_many_single_runs(cell, effect):
    t, current, temperature = hover(200)
    known = temperature if measured(effect) else None
    base = sizes(effect)
    rows = [{name: value * scale for name, value in base.items()} for scale in (0.7, 0.9, 1.0)]
    columns = {name: np.array([[row[name]] for row in rows]) for name in base}
    together = PackModel(cell, 6, 1.0, joined(effect, **columns)).simulate(t, current, SOC, known)
    assert together.voltage.shape == (3, t.size)
    for k, row in enumerate(rows):
        alone = PackModel(cell, 6, 1.0, joined(effect, **row)).simulate(t, current, SOC, known)
        np.testing.assert_allclose(together.voltage[k], alone.voltage, rtol=1e-9)


@CELLS
@EFFECT
def test_power_is_current_times_voltage_as_the_sensors_read_them(cell, effect):
    pack = PackModel(cell, 6, 1.0, joined(effect, **sizes(effect)))
    states = pack.step(np.tile(np.array(pack.start(0.7), dtype=float), (4, 1)), 20.0, 10.0)
    power = np.array([20.0, 100.0, 220.0, 400.0])
    guess = power / 22.0
    for _ in range(20):  # the guess only matters where voltage bends with the current
        guess, deliverable = pack.current_at_power(states, power, guess)
    assert np.all(deliverable)
    np.testing.assert_allclose(guess * pack.voltage(states, guess), power, rtol=1e-9)


def test_the_battery_file_gives_every_effect_back(tmp_path):
    path = tmp_path / "pack.toml"
    effects = [effect(**sizes(effect)) for effect in ALL]
    sd = [{p.name: 0.1 * p.si(p.prior[1]) for p in e.parameters() if p.prior} for e in effects]
    joined_ = tuple(Joined(effect=e, sd=s) for e, s in zip(effects, sd, strict=True))
    write_battery(path, BatteryFile(name="all of them", circ=circ(), joined=joined_))
    back = read_battery(path).joined
    assert [type(j.effect) for j in back] == ALL
    for effect, spread, read in zip(effects, sd, back, strict=True):
        for p in effect.parameters():
            assert getattr(read.effect, p.name) == pytest.approx(getattr(effect, p.name), rel=1e-7), p.name
        assert read.sd == pytest.approx(spread, rel=0.05)


@CELLS
@EFFECT
def test_filter_and_predictor_run_with_it(cell, effect):
    t, current, temperature = hover(240)
    pack = PackModel(cell, 6, 1.0, joined(effect, **sizes(effect)))
    voltage = pack.simulate(t, current, SOC, temperature if measured(effect) else None).voltage
    model = Model.CIRC if cell == circ() else Model.CHEM
    tracker = Tracker(model, cell, 6, 1.0, tuple(joined(effect, **sizes(effect))))
    track = None
    for k in range(t.size):
        sample = BatterySample(
            time_s=float(t[k]), battery_id=0, voltage_v=float(voltage[k]), current_a=float(current[k]),
            temperature_k=float(temperature[k]) if measured(effect) else None,
        )  # fmt: skip
        track, estimate = tracker.step(track, sample)
    assert estimate is not None
    assert estimate.valid
    assert track.restarts == 0
    assert np.linalg.eigvalsh(track.belief.covariance)[0] > 0.0
    points = track.belief.mean + np.zeros((5, 1))
    seconds, _ = end_of_discharge(
        tracker.pack,
        points,
        np.linspace(100.0, 300.0, 5),
        Limits(threshold_soc=0.2, cutoff_v=18.0),
        sample.temperature_k,
    )
    assert np.all(np.isfinite(seconds))
    assert np.all(np.diff(seconds) < 0.0)


def test_the_readme_lists_the_catalogue():
    rows = []
    for effect in (*EFFECTS.values(), *DEMAND_EFFECTS.values()):
        names = ", ".join(p.name + (f" [{p.unit}]" if p.unit != "1" else "") for p in effect.parameters())
        rows.append(f"| `{effect.id}` | {effect.equation} | {names} |")
    table = "\n".join(rows)
    readme = Path(__file__).parents[3] / "README.md"
    assert table in readme.read_text(encoding="utf-8"), f"the table should read\n{table}"


def test_effects_that_look_alike_say_so_of_each_other():
    for name, effect in EFFECTS.items():
        for other in effect.mimics:
            assert name in EFFECTS[other].mimics, f"{name} mimics {other}"


@EFFECT
def test_an_effect_says_what_the_search_needs(effect):
    assert effect.equation and effect.title and effect.source and effect.excited_by and effect.manoeuvre
    for p in effect.parameters():
        given = p.driver is not None or effect.id == "intermittent-contact"
        assert p.prior is not None or given, p.name
        if p.prior is not None:
            mean, sd = p.prior
            assert p.low <= mean <= p.high
            assert 0.0 < sd < p.high - p.low
        if p.absent is not None:
            assert p.low <= p.absent <= p.high
        if p.driver is not None:
            assert p.driver in (*effect.drivers, "age", "onset")
    assert set(effect.shown_by) <= set(EFFECTS)


def test_every_effect_that_needs_temperature_finds_one_who_supplies_it():
    assert any("temperature" in effect.supplies for effect in ALL)
    assert "temperature" in ResistanceTemperature.drivers


def test_a_heavier_pack_has_a_larger_heat_capacity():
    light, heavy = (EFFECTS["self-heating"].priors(wh) for wh in (80.0, 355.0))
    assert heavy["heat_capacity"][0] == pytest.approx(2.2e3, rel=0.05)
    assert light["heat_capacity"][0] == pytest.approx(500.0, rel=0.01)
    assert light["conductance"][0] < heavy["conductance"][0]
