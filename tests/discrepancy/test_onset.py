"""What is there from some flight on is found with that flight; what was always there, or never, is not given one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import base, catalogue, flown, told_its_form

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.onset import begun, first_flight
from bhm_service.discrepancy.search import Search, search
from bhm_service.discrepancy.selection import select
from bhm_service.discrepancy.sizes import Scene, size
from bhm_service.discrepancy.summary import change_points
from bhm_service.discrepancy.words import values_of

CONTACT, OHM = frozenset({"contact-resistance"}), 0.012
NAMES = {"contact-resistance", "resistance-growth", "capacity-fade", "voltage-offset", "charge-transfer"}


def worn(there: Sequence[bool], names: set[str] = NAMES) -> Search:
    """A search over flights of which some have a worn connector."""
    flights = [
        flown([EFFECTS["contact-resistance"](resistance=OHM)] if is_there else [], seed=5, number=k)
        for k, is_there in enumerate(there)
    ]
    return search(base(flights), catalogue(flights, only=names))


@pytest.mark.parametrize(("there", "first"), [((0, 0, 1, 1, 1), 2), ((1, 1, 1, 1), 0)])
def test_a_connector_is_worn_from_the_flight_on_from_which_it_is(there, first):
    """One that always was looks like a pack that has aged, which is commoner."""
    found = worn(there)
    chosen = select(found)
    assert CONTACT in ({chosen.names} if first else {chosen.names, *chosen.alternatives})
    fitted = found.fitted(CONTACT)
    (member,) = fitted.joint.members
    assert first_flight(member) == first
    milliohm = fitted.joint.values(fitted.x[None, :])["contact-resistance.resistance"][0, 0]
    assert milliohm == pytest.approx(1e3 * OHM, rel=0.15)
    assert [(c.flight, c.time_s) for c in change_points(fitted)] == ([(f"{first:02d}.tlog", 0.0)] if first else [])
    scene = Scene(
        "contact-resistance", values_of(fitted, "contact-resistance"), fitted.joint.lab, found.base.flights, ()
    )
    assert ("from flight 02 on" in size(scene)) is bool(first)


def test_a_temperature_that_nobody_recorded_does_not_hide_from_which_flight_on():
    """As warm as it needs to be in each flight, it does what the connector does: no onset shows beside that."""
    found = worn((0, 0, 1, 1, 1), NAMES | {"resistance-temperature"})
    assert select(found).names == CONTACT
    assert first_flight(found.fitted(CONTACT).joint.members[0]) == 2


@pytest.mark.parametrize("told", [False, True])
def test_nor_do_larger_effects_that_took_it_for_their_own(told):
    """Colder flights, and from the third on a worn connector: growth from flight to flight does nearly the same."""
    warmth = frozenset({"resistance-temperature"})
    flights = []
    for k, kelvin in enumerate((300.0, 299.0, 290.0, 285.0, 284.0)):
        physics = [EFFECTS["resistance-temperature"](activation_energy=22e3)]
        physics += [EFFECTS["contact-resistance"](resistance=0.030)] if k > 1 else []
        flights.append(flown(physics, seed=5, number=k, kelvin=kelvin))
    pack = base(flights)
    pack = replace(pack, lab=told_its_form(pack.lab)) if told else pack
    found = search(pack, catalogue(flights, only=NAMES | warmth))
    assert select(found).names == CONTACT | warmth
    contact = next(c for c in found.candidates if c.id in CONTACT)
    assert first_flight(contact) == 2


@pytest.mark.parametrize(("ahead_by", "first"), [(11.5, 3), (11.0, 0)])
def test_a_beginning_pays_for_having_been_looked_for(ahead_by, first):
    """Ten nats, and one of four flights that it might have been."""
    (contact,) = catalogue([flown()], only=CONTACT)

    def gain(tried):
        return 50.0 + (ahead_by if first_flight(tried) == 3 else 0.0)

    found = begun(contact, 5, gain, 10.0)
    assert first_flight(found) == first
    assert found.price == pytest.approx(np.log(4.0) if first else 0.0)


def test_what_cannot_begin_is_left_as_it_is():
    (fade,) = catalogue([flown()], only={"capacity-fade"})
    assert begun(fade, 5, lambda _: 0.0, 10.0) is fade
