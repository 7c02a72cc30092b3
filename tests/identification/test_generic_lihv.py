"""The LiHV cell that ships, against packs whose curve is known and against recorded ones that it was not made from."""

from __future__ import annotations

import numpy as np
import pytest

from bhm_service.battery.battery_file import read_battery
from bhm_service.config import shipped
from bhm_service.identification.generic_lihv import charged_higher, laid, rests
from bhm_service.mavlink.log import read_log
from bhm_service.mavlink.recording import record

CAPACITY_C = 4.9 * 3600.0


@pytest.fixture(scope="module")
def fleet(data):
    paths = sorted((data / "flights" / "wadl_m100").glob("*.csv"))
    return {path.stem: record(read_log(path), 0, 6, CAPACITY_C) for path in paths}


def rests_off(battery, flights, reserve):
    at, volts = rests(flights, float(battery.circ.r_s))
    return volts - np.asarray(battery.circ.open_circuit(reserve + (1.0 - reserve) * at))


def test_span_and_reserve_of_a_known_curve_are_found(generic):
    known, generator = generic.circ.ocv, np.random.default_rng(5)
    gauge = np.concatenate([generator.uniform(0.0, 1.0, 40), np.full(60, 0.98)])
    reached = 1.12 * (0.06 + 0.94 * gauge)
    slope = (float(known.voltage(1.0)) - float(known.voltage(0.9))) / 0.1
    volts = np.asarray(known.voltage(np.minimum(reached, 1.0))) + slope * np.maximum(reached - 1.0, 0.0)
    found = laid(known, gauge, volts + generator.normal(0.0, 0.003, gauge.size))
    assert found.span == pytest.approx(1.12, abs=0.01)
    assert found.reserve == pytest.approx(0.06, abs=0.01)
    assert float(found.curve.voltage(1.0)) == pytest.approx(float(known.voltage(1.0)) + 0.12 * slope, abs=0.01)


def test_packs_of_other_vehicles_rest_where_it_says(fleet, generic):
    """Made from one vehicle's flights, looked at on another's; the cell charged to 4.20 V beside it."""
    first, other = ([f for name, f in fleet.items() if name.startswith(who)] for who in ("waddle1", "waddle3"))
    made = laid(generic.circ.ocv, *rests(first, float(generic.circ.r_s)))
    off = rests_off(charged_higher(generic, made), other, made.reserve)
    assert np.sqrt(np.mean(off**2)) < 0.025
    assert np.sqrt(np.mean(rests_off(generic, other, 0.0) ** 2)) > 0.1


def test_what_ships_is_what_the_flights_make_of_the_lipo_cell(fleet):
    lipo = read_battery(shipped("batteries", "generic-lipo.toml"))
    made = charged_higher(lipo, laid(lipo.circ.ocv, *rests(list(fleet.values()), float(lipo.circ.r_s))))
    ships = read_battery(shipped("batteries", "generic-lihv.toml"))
    soc = np.linspace(0.0, 1.0, 51)
    for model in ("circ", "chem"):
        of_made, of_ships = (np.asarray(battery.cell(model).open_circuit(soc)) for battery in (made, ships))
        assert of_ships == pytest.approx(of_made, abs=2e-4)
    assert ships.circ.c_max == pytest.approx(made.circ.c_max, rel=1e-4)
    assert ships.name == made.name
