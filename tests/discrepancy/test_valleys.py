"""A cost with several valleys: the charge of packs that were not quite full is found over the steps of their curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, SERIES, flown, noise_model, told_its_form

from bhm_service.battery.ocv import MonotoneSpline
from bhm_service.battery.pack import PackModel
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.joint import STARTS, Joint
from bhm_service.discrepancy.lab import lab_of
from bhm_service.discrepancy.search import Search

_STEP = 0.02  # of charge from one step of the curve to the next
_SOC = np.linspace(0.0, 1.0, 801)
_VOLTS = 3.2 + _SOC + 0.003 * np.sin(2.0 * np.pi * _SOC / _STEP)
STEPPED = replace(BATTERY.circ, ocv=MonotoneSpline(tuple(_SOC), tuple(_VOLTS)))


def begun_at(soc, number):
    """A flight of a pack with such a curve that began with so much charge."""
    flight = flown(seed=5, number=number)
    smooth, stepped = (
        np.ravel(PackModel(cell, SERIES).simulate(flight.time_s, flight.current_a, begin, None).voltage)
        for cell, begin in ((BATTERY.circ, 1.0), (STEPPED, soc))
    )
    return replace(
        flight, voltage_v=flight.voltage_v - smooth + stepped, notes=replace(flight.notes, rest_voltage_v=None)
    )


@pytest.mark.parametrize("soc", [0.985, 0.988, 1.0])
def test_a_charge_short_of_full_is_found_though_a_step_further_all_looks_alike(soc):
    lab = told_its_form(lab_of(replace(BATTERY, circ=STEPPED), "circ", None, None))
    joint = Joint(lab, tuple(begun_at(soc, number) for number in range(4)))
    found = Search(joint, (), noise_model()).fitted(frozenset())
    assert found.x[joint.places[STARTS]] == pytest.approx(soc, abs=0.001)
    nearest = fit(joint, noise_model()).x[joint.places[STARTS]]
    assert nearest == pytest.approx(soc if soc == 1.0 else soc + _STEP, abs=0.001)
