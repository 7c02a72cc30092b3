"""The world of the concealed cases is a possible one: balances, rests, and what real cells were measured to do."""

from __future__ import annotations

import csv
import gzip
from dataclasses import replace

import numpy as np
import pytest

from sim.concealed.battery_effects import pulse_ohm
from sim.concealed.electrics import Electrics
from sim.concealed.flying import SECOND, fly
from sim.concealed.knobs import HeatKnobs, neutral
from sim.concealed.lab import empty_soc, recordings
from sim.concealed.load import DT, demand, fly_plans
from sim.concealed.packs import GRID, SERIES, draw_pack
from sim.concealed.strength import Shown, voltage_snr
from sim.concealed.thermal import Heat

ONE = np.ones(1)
PACKS = [draw_pack(np.random.default_rng(seed)) for seed in range(12)]


@pytest.fixture(scope="module")
def flown():
    """Two flights of a pack that heats, beside its twins at 25 degC."""
    rng, pack = np.random.default_rng(4), PACKS[0]
    plain = neutral(2, ("shuttle", "legs"), np.array([0.5, 0.4]))
    cold = np.array([5.0, 25.0])
    warms = replace(
        plain,
        cells=replace(plain.cells, arrhenius=1.0),
        heat=HeatKnobs(heats=True, start_c=cold, ambient_c=cold),
    )
    plan = fly_plans(rng, plain.demand.plan, np.array([240.0, 240.0]))
    return pack, fly(pack, warms, (plain,), demand(rng, pack, plain.demand, plan))


def test_the_load_takes_what_the_pack_gives(flown):
    _, f = flown
    for flight, end in enumerate(f.ends):
        given = f.voltage_v[flight, :end] * f.current_a[flight, :end]
        assert given == pytest.approx(f.power_w[flight, :end], rel=1e-9)


def test_charge_that_leaves_the_cells_went_through_the_shunt(flown):
    pack, f = flown
    for flight, end in enumerate(f.ends):
        second = (end - 1) // SECOND
        used = f.current_a[flight, : second * SECOND].sum() * DT / 3600.0
        assert f.soc[flight, 0] - f.soc[flight, second] == pytest.approx(used / pack.capacity_ah, rel=2e-4)


@pytest.mark.parametrize("pack", PACKS[:4], ids=lambda pack: pack.chemistry)
def test_the_reserve_is_counted_from_where_the_lab_calls_the_pack_empty(pack):
    """There the weakest cell's rested voltage is what the slow discharge was stopped at, but for a small drop."""
    slow = recordings(pack, np.random.default_rng(1))["slow"]
    mean = empty_soc(pack, slow)
    weakest = 1.0 - (1.0 - mean) / float(np.mean(1.0 / pack.capacity)) / float(pack.capacity.min())
    assert weakest < mean
    assert float(np.interp(weakest, GRID, pack.ocv_v)) == pytest.approx(3.0, abs=0.04)


def test_heat_is_stored_or_given_to_the_air(flown):
    _, f = flown
    assert f.heat_j == pytest.approx(f.lost_j + f.stored_j, rel=1e-6)
    assert (f.heat_j > 1e3).all()


def test_energy_given_and_heat_are_what_the_rested_voltage_held():
    pack = PACKS[1]
    cells = Electrics.of(pack, [neutral(1, ("hover",), ONE).cells], DT)
    current, warm = np.array([1.5 * pack.capacity_ah]), np.full((1, SERIES), 25.0)
    given = held = 0.0
    begin = cells.heat_j.sum()
    for k in range(round(600 / DT)):
        if k % SECOND == 0:
            cells.refresh(warm)
        source, ohm = cells.source(0.0 * ONE)
        given += float((source - ohm * current)[0] * current[0]) * DT
        held += float(np.interp(cells.z[0], GRID, pack.ocv_v).sum() * current[0]) * DT
        cells.step(current)
    # Elements that are still charged hold the difference of half a percent of the heat at most.
    heat = float(cells.heat_j.sum() - begin)
    assert given + heat == pytest.approx(held, abs=0.02 * heat)


@pytest.mark.parametrize("seed", range(4))
def test_a_long_rest_ends_at_the_rested_voltage(seed):
    pack = PACKS[seed]
    cells = Electrics.of(pack, [neutral(1, ("hover",), ONE).cells], 1.0)
    warm = np.full((1, SERIES), 25.0)
    for second in range(3 * 3600):
        if second % 10 == 0:
            cells.refresh(warm)
        cells.step(ONE * (2.0 * pack.capacity_ah if second < 900 else 0.0))
    rested, _ = cells.source(0.0 * ONE)
    assert rested[0] == pytest.approx(np.interp(cells.z[0], GRID, pack.ocv_v).sum(), abs=1e-4)


def pulses(path):
    """Resistance [Ohm] of each pulse of a rest-pulse recording after ten seconds, by state of charge."""
    with gzip.open(path, "rt") as stream:
        rows = [(float(r["time_s"]), float(r["current_A"]), float(r["voltage_V"]), float(r["charge_Ah"]))
                for r in csv.DictReader(stream)]  # fmt: skip
    time, current, voltage, charge = np.array(rows).T
    found = []
    for k in np.flatnonzero((current[1:] > 2.0) & (np.abs(current[:-1]) < 0.05)):
        after = np.searchsorted(time, time[k] + 9.5)
        if after < len(time) and current[after] > 2.0 and time[after] - time[k] < 12.0:
            found.append((charge[k], (voltage[k] - voltage[after]) / current[after]))
    return np.array(found)


def test_resistance_follows_temperature_as_on_the_real_cell(data):
    folder = data / "lab" / "panasonic_18650pf"
    by_temperature = {c: pulses(folder / f"hppc_lite_{name}C.csv.gz") for c, name in
                      ((25, "25"), (10, "10"), (0, "0"), (-10, "n10"))}  # fmt: skip
    middle = {c: p[(p[:, 0] > 0.3) & (p[:, 0] < 2.0), 1] for c, p in by_temperature.items()}
    for celsius in (10, 0, -10):
        real = middle[celsius] / np.median(middle[25])
        world = [pulse_ohm(pack, celsius, pack.capacity_ah) / pulse_ohm(pack, 25.0, pack.capacity_ah) for pack in PACKS]
        assert real.min() * 0.9 < min(world) and max(world) < real.max() * 1.1, (celsius, real, world)


def test_packs_warm_as_the_real_pouch_does(data):
    with (data / "lab" / "maxamps_lipo5450" / "per_cycle_summary.csv").open() as stream:
        measured = [(float(r["c_rate"]), float(r["dT"])) for r in csv.DictReader(stream)]
    rises = {rate: [k for r, k in measured if r == rate] for rate in (1.0, 4.0)}
    for pack in PACKS[:5]:
        knobs = neutral(1, ("hover",), ONE)
        cells = Electrics.of(pack, [replace(knobs.cells, soc=0.86 * np.ones((1, SERIES)), arrhenius=1.0)], 1.0)
        heat = Heat.of(pack, 24.0 * ONE, 24.0 * ONE, ONE, ONE, ONE)
        current = 2.0 * pack.capacity_ah * ONE
        for _ in range(round(0.82 * 1800)):
            cells.refresh(heat.core_c)
            heat.step(cells.step(current), 0.0 * ONE, 1.0)
        rise = float(heat.surface_c.mean() - 24.0)
        assert min(rises[1.0]) < rise < max(rises[4.0]), (pack.chemistry, rise)


def test_an_effect_that_nuisances_can_absorb_has_no_strength():
    pack = PACKS[2]
    soc = np.linspace(1.0, 0.4, 600)
    current = np.full(600, 30.0) + 5.0 * np.sin(np.arange(600) / 9.0)
    spectrum = np.full(301, 0.02**2)
    slope = SERIES * np.interp(soc, GRID, np.gradient(pack.ocv_v, GRID))
    start = Shown(1e-4 * slope, spectrum, soc, current)
    steps = Shown(0.02 * np.sign(np.sin(np.arange(600) / 30.0)), spectrum, soc, current)
    assert voltage_snr(pack, [start])[0] < 0.1
    # One standard deviation in each of 600 samples, of which the nuisances can take little.
    assert voltage_snr(pack, [steps])[0] == pytest.approx(np.sqrt(600), rel=0.1)
