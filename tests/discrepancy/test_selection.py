"""Which of the fitted sets may be said: those that explain by themselves, and no leavings of a refuted one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from battery.cells import CAPACITY_C
from discrepancy.flown import AMBIENT_K, SERIES, flown, searching

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.search import NATS
from bhm_service.discrepancy.selection import MUCH, select, share

FADE, CONTACT = frozenset({"capacity-fade"}), frozenset({"contact-resistance"})


@pytest.fixture(scope="module")
def both():
    """Flights of a pack that has lost capacity and whose connectors are worn, and these two effects to find."""
    effects = [EFFECTS["capacity-fade"](fade=0.12), EFFECTS["contact-resistance"](resistance=0.02)]
    found = searching(tuple(flown(effects, seed=5, number=k) for k in range(4)), {*FADE, *CONTACT})
    for names in (frozenset(), FADE, CONTACT, FADE | CONTACT):
        found.fitted(names)
    return found


def test_two_effects_are_chosen_together_and_explain_nearly_all(both):
    assert select(both).names == FADE | CONTACT
    assert share(both, FADE | CONTACT) > 0.9


def test_a_set_that_by_its_equations_alone_makes_the_battery_worse_is_not_chosen(both):
    """Whatever evidence it has: that comes of the lab's errors, which were bent to suit it."""
    fitted = both.fitted(FADE | CONTACT)
    wrong = fitted.x.copy()
    wrong[fitted.joint.unknowns.slice_of("contact-resistance.resistance")] *= -1.0
    turned = replace(both, fits={frozenset(): both.fits[frozenset()], FADE | CONTACT: replace(fitted, x=wrong)})
    assert share(turned, FADE | CONTACT) < share(both, FADE | CONTACT)
    assert select(turned).names != FADE | CONTACT


def test_of_a_refuted_set_only_a_part_is_left_to_choose(both):
    best = both.evidence(FADE | CONTACT)
    assert max(both.evidence(FADE), both.evidence(CONTACT)) < best - NATS
    assert select(both, [FADE | CONTACT]).names in (FADE, CONTACT)


def test_what_a_refuted_set_leaves_to_be_had_is_no_explanation(both):
    strong, weak = sorted((FADE, CONTACT), key=both.evidence, reverse=True)
    assert both.evidence(weak) < both.evidence(strong) - NATS
    hopeless = replace(both.fits[FADE | CONTACT], cost=1e6)
    alone = replace(both, fits={**both.fits, FADE | CONTACT: hopeless})
    assert select(alone).names == strong
    assert select(alone, [strong]).names == frozenset()


def test_what_the_lab_was_off_by_besides_does_not_hide_an_effect_of_much_evidence():
    """Resistance moves with temperature by 6 kJ/mol; the open-circuit curve is off by up to 25 mV a cell as well."""
    effects = [EFFECTS["resistance-temperature"](activation_energy=6e3)]
    flights = [flown(effects, number=k, kelvin=kelvin) for k, kelvin in enumerate(AMBIENT_K)]
    off = [0.025 * SERIES * np.sin(2.0 * np.pi * f.charge_c / CAPACITY_C) for f in flights]
    warmth = frozenset({"resistance-temperature"})
    found = searching([replace(f, voltage_v=f.voltage_v + v) for f, v in zip(flights, off, strict=True)], warmth)
    found.fitted(frozenset())
    found.fitted(warmth)
    assert 0.0 < share(found, warmth) < MUCH
    assert select(found).names == warmth
