"""Battery files that have the law of temperature already, from a bench that told it loosely, or for one model only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, catalogue, flown, told_its_form
from discrepancy.unrecorded import ENERGY, days, warmed

from bhm_service.battery.battery_file import Joined
from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.discrepancy.explain import Request, explain
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.search import search
from bhm_service.discrepancy.selection import select

LAW = "resistance-temperature"
LOOSE = EFFECTS[LAW](activation_energy=9e3)


def file_with(*models):
    law = tuple(Joined(effect=LOOSE, model=model, sd={"activation_energy": 6e3}) for model in models)
    return replace(BATTERY, joined=law)


def recorded():
    """Flights of seasons, as warm as they are; the pack follows temperature as cells do."""
    truth = [EFFECTS[LAW](activation_energy=1e3 * ENERGY)]
    return tuple(flown(truth, seed=4, number=k, kelvin=kelvin) for k, kelvin in enumerate((278.0, 286.0, 294.0, 300.0)))


def energies(battery):
    return {j.model: j.effect.activation_energy / 1e3 for j in battery.joined if j.effect.id == LAW}


MODELS = [("circ",), ("chem",), ("circ", "chem")]


@pytest.fixture(scope="module")
def unrecorded():
    """Flights whose temperature no log has, with the law in the file of no model, one or both."""
    flights = warmed(days(6))
    told = frozenset({LAW})
    return {m: explain(Request(battery=file_with(*m), flights=flights, told=told)) for m in ((), *MODELS)}


@pytest.mark.parametrize("models", MODELS, ids="+".join)
def test_a_law_that_nothing_drives_is_looked_for_as_if_the_file_had_none(unrecorded, models):
    assert unrecorded[models].findings == unrecorded[()].findings
    (effect,) = unrecorded[models].findings.effects
    assert abs(effect.parameters["activation_energy"].value - ENERGY) < 6.0


@pytest.mark.parametrize("models", MODELS, ids="+".join)
def test_its_repair_holds_one_law_and_one_carrier_for_each_model(unrecorded, models):
    repaired = unrecorded[models].repaired
    assert sorted((j.effect.id, j.model) for j in repaired.joined) == [
        (LAW, "chem"), (LAW, "circ"), ("self-heating", "chem"), ("self-heating", "circ"),
    ]  # fmt: skip
    assert all(abs(found - ENERGY) < 6.0 for found in energies(repaired).values())


def test_the_search_finds_a_law_that_the_other_models_file_has_already():
    """Of the other model nothing is asked that its lab has said."""
    found = explain(Request(battery=file_with("chem"), flights=recorded()))
    (effect,) = found.findings.effects
    assert effect.id == LAW
    number = effect.parameters["activation_energy"]
    assert abs(number.value - ENERGY) < 2.0 * number.sd < 6.0
    assert energies(found.repaired) == {"chem": 9.0, "circ": pytest.approx(number.value, abs=1.0)}


def test_a_recorded_temperature_drives_the_law_that_the_file_has():
    right = replace(file_with("circ"), joined=(Joined(effect=EFFECTS[LAW](activation_energy=1e3 * ENERGY), sd={}),))
    found = explain(Request(battery=right, flights=recorded()))
    assert found.findings.effects == []
    assert np.isclose(found.findings.fit.rmse_before_V, found.findings.fit.noise_floor_V, rtol=0.5)


@pytest.mark.parametrize(("apart_k", "more"), [(0.5, 0.14), (1.0, 0.17)])
def test_a_law_is_seen_through_a_resistance_that_the_lab_has_wrong(apart_k, more):
    """Which takes back in the mean what the warmth gives: the equation by itself explains hardly anything."""
    truth = [EFFECTS[LAW](activation_energy=1e3 * ENERGY), EFFECTS["resistance-growth"](growth=more, settled=1.0)]
    flights = tuple(flown(truth, seed=4, number=k, kelvin=296.5 - 1.5 * apart_k + apart_k * k) for k in range(4))
    known = replace(BATTERY, uncertainty=Uncertainty(voltage_error_v=0.003))
    lab = told_its_form(lab_of(known, "circ", None, None))
    found = search(Joint(lab, flights), catalogue(flights, only={LAW, "time-skew", "voltage-offset"}))
    assert select(found).names == {LAW}
