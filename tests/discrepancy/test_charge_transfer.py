"""Charge transfer that became slower: seen where the lab told it from the rest of the drop, and where it did not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discrepancy.flown import BATTERY, flown

from bhm_service.battery.battery_file import Joined
from bhm_service.battery.effects import EFFECTS, DoubleLayer
from bhm_service.discrepancy.explain import Request, explain

CHARGE_TRANSFER = "charge-transfer"
LAYER = DoubleLayer(exchange_current=4.0, time_constant=0.8)
KNOWN = replace(BATTERY, joined=(Joined(effect=LAYER, model="circ"),), chem=None)


def flights(speed):
    slower = EFFECTS[CHARGE_TRANSFER](speed=speed)
    return [flown([LAYER, slower], seed=4, number=k) for k in range(4)]


@pytest.mark.parametrize("speed", [0.3, 0.6])
def test_where_the_lab_told_it_from_the_rest_its_speed_and_the_other_electrode_are_all_that_is_open(speed):
    told = explain(Request(battery=KNOWN, flights=flights(speed), told=frozenset({CHARGE_TRANSFER})))
    (effect,) = told.findings.effects
    assert list(effect.parameters) == ["speed", "other"]
    found = effect.parameters["speed"]
    assert found.value == pytest.approx(speed, abs=3.0 * found.sd)
    assert found.sd < 0.2


def test_slower_charge_transfer_is_named_and_repaired():
    found = explain(Request(battery=KNOWN, flights=flights(0.2)))
    assert [e.id for e in found.findings.effects] == [CHARGE_TRANSFER]
    assert {j.effect.id for j in found.repaired.joined} == {"double-layer", CHARGE_TRANSFER}
    assert found.findings.fit.heldout_after_V < 0.3 * found.findings.fit.heldout_before_V


def test_charge_transfer_that_would_be_faster_than_in_the_lab_is_taken_for_no_physics_of_the_pack():
    """At one temperature nothing makes it so; told to measure it, it is found as in the lab."""
    told = explain(Request(battery=KNOWN, flights=flights(2.5), told=frozenset({CHARGE_TRANSFER})))
    assert [e.parameters["speed"].value for e in told.findings.effects] == [pytest.approx(1.0, abs=0.01)]
