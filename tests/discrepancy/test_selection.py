"""Which of the fitted sets may be said: those that explain by themselves, and no leavings of a refuted one."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discrepancy.flown import flown, searching

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.search import NATS
from bhm_service.discrepancy.selection import select, share

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
