"""A cost with several valleys: charge that is missing, whatever made it so, is found over the steps of a curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, SERIES, catalogue, flown, noise_model, told_its_form

from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.ocv import MonotoneSpline
from bhm_service.battery.pack import PackModel
from bhm_service.discrepancy.crossing import witness
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.hypothesis import STARTS
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.search import Search, search

_SOC = np.linspace(0.0, 1.0, 801)


def with_steps(apart, height_v):
    """The cell with an open-circuit curve of steps so far apart, in charge."""
    volts = 3.2 + _SOC + height_v * np.sin(2.0 * np.pi * _SOC / apart)
    return replace(BATTERY.circ, ocv=MonotoneSpline(tuple(_SOC), tuple(volts)))


_STEP = 0.02  # of charge
STEPPED = with_steps(_STEP, 0.003)
GRAPHITE = with_steps(0.05, 0.006)


def over(flights, cell):
    """The battery as it is, with such a cell, over flights; its lab told its form."""
    return Joint(told_its_form(lab_of(replace(BATTERY, circ=cell), "circ", None, None)), tuple(flights))


def begun_at(soc, number, cell=STEPPED, effects=()):
    """A flight of a pack with such a curve that began with so much charge."""
    flight = flown(seed=5, number=number)
    smooth, stepped = (
        np.ravel(PackModel(c, SERIES, 1.0, own).simulate(flight.time_s, flight.current_a, begin, None).voltage)
        for c, begin, own in ((BATTERY.circ, 1.0, ()), (cell, soc, effects))
    )
    return replace(
        flight, voltage_v=flight.voltage_v - smooth + stepped, notes=replace(flight.notes, rest_voltage_v=None)
    )


@pytest.mark.parametrize("soc", [0.985, 0.988, 1.0])
def test_a_charge_short_of_full_is_found_though_a_step_further_all_looks_alike(soc):
    joint = over((begun_at(soc, number) for number in range(4)), STEPPED)
    found = Search(joint, (), noise_model()).fitted(frozenset())
    assert found.x[joint.places[STARTS]] == pytest.approx(soc, abs=0.001)
    nearest = fit(joint, noise_model()).x[joint.places[STARTS]]
    assert nearest == pytest.approx(soc if soc == 1.0 else soc + _STEP, abs=0.001)


LARGE = {
    "capacity-fade": ("fade", 0.20),
    "current-gain": ("gain", 0.15),
    "current-offset": ("offset", -1.5),
}


def searched(name, tried):
    """A search among ``tried`` on flights of a pack with one of these effects and a curve with steps like graphite's.

    With it the battery as it is, and what the effect's number is.
    """
    number, size = LARGE[name]
    flights = tuple(begun_at(1.0, k, GRAPHITE, [EFFECTS[name](**{number: size})]) for k in range(3))
    return over(flights, GRAPHITE), catalogue(flights, only=tried), f"{name}.{number}", size


@pytest.mark.parametrize("name", LARGE)
def test_a_large_effect_is_found_though_every_small_part_of_it_crosses_a_step(name):
    base, tried, number, size = searched(name, {name})
    found = search(base, tried).fitted(frozenset({name}))
    assert found.x[found.joint.places[number]] == pytest.approx(size, rel=0.1)


def test_another_model_of_the_cell_begins_with_the_size_that_was_found():
    """A witness that stops at a step on its way would refute what is there."""
    names = frozenset({"capacity-fade"})
    base, tried, number, size = searched("capacity-fade", names)
    other = witness(base.lab, base, tried, other=search(base, tried)).fitted(names)
    assert other.x[other.joint.places[number]] == pytest.approx(size, rel=0.1)
    by_itself = witness(base.lab, base, tried).fitted(names)
    assert by_itself.x[other.joint.places[number]] != pytest.approx(size, rel=0.2)


def test_what_is_behind_for_the_way_it_came_is_fitted_from_the_valley_of_its_rival():
    """Over these flights a load past the sensor and an offset of the sensor do the same."""
    load, shift, bare = frozenset({"unseen-load"}), frozenset({"current-offset"}), frozenset()
    flights = tuple(begun_at(1.0, k, STEPPED, [EFFECTS["unseen-load"](current=2.5)]) for k in range(3))
    found = Search(over(flights, STEPPED), tuple(catalogue(flights, only=load | shift)), noise_model())
    found.fitted(bare)
    for names in (load, shift):
        found.fitted(names, found.fits[bare])
    found.look_by_equation([load])
    assert found.evidence(load) > found.evidence(shift) + 100.0
    found.look_across(load, [shift])
    assert found.evidence(load) == pytest.approx(found.evidence(shift), abs=20.0)
