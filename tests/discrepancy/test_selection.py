"""Which of the fitted sets may be said: those that explain by themselves, and no leavings of a refuted one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import AMBIENT_K, flown, off_by_its_curve, searching, told_its_form
from discrepancy.unrecorded import days, warmed

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.first_order import expected_snr
from bhm_service.discrepancy.odds import NATS, STRONG
from bhm_service.discrepancy.selection import MUCH, select, share
from bhm_service.discrepancy.sidecar import Notes

FADE, CONTACT = frozenset({"capacity-fade"}), frozenset({"contact-resistance"})
SKEW = frozenset({"time-skew"})


def earning(found, names, nats):
    """Lets a set have so much evidence."""
    cost = found.fits[names].cost + 2.0 * found.inflation * (found.evidence(names) - nats)
    found.fits[names] = replace(found.fits[names], cost=cost)
    assert found.evidence(names) == pytest.approx(nats)


@pytest.fixture(scope="module")
def both():
    """Flights of a pack that has lost capacity and whose connectors are worn, and these two effects to find."""
    effects = [EFFECTS["capacity-fade"](fade=0.14), EFFECTS["contact-resistance"](resistance=0.02)]
    found = searching(tuple(flown(effects, seed=5, number=k) for k in range(4)), {*FADE, *CONTACT})
    for names in (frozenset(), FADE, CONTACT, FADE | CONTACT):
        found.fitted(names)
    return found


def test_what_is_left_of_the_best_set_without_a_member_that_has_no_place_is_met():
    effects = [EFFECTS["capacity-fade"](fade=0.12), EFFECTS["contact-resistance"](resistance=0.02)]
    starts = frozenset({"partial-charge"})
    found = searching(tuple(flown(effects, seed=5, number=k) for k in range(4)), FADE | CONTACT | starts)
    for names in (frozenset(), FADE, CONTACT, FADE | CONTACT | starts):
        found.fitted(names)
    assert select(found).names == FADE | CONTACT


@pytest.mark.parametrize(("ahead_by", "chosen"), [(2.0, "capacity-fade"), (4.0, "unseen-load")])
def test_what_is_common_comes_first_unless_the_flights_clearly_like_another_better(ahead_by, chosen):
    """Odds of twenty to one are clear; either way the recordings do not exclude the other."""
    load = frozenset({"unseen-load"})
    flights = tuple(flown([EFFECTS["unseen-load"](current=2.0)], seed=5, number=k) for k in range(4))
    found = searching(flights, load | FADE)
    for names in (frozenset(), load, FADE):
        found.fitted(names)
    earning(found, FADE, found.evidence(load) - ahead_by)
    selected = select(found)
    assert selected.names == {chosen}
    assert selected.alternatives == ((load | FADE) - {chosen},)


@pytest.mark.parametrize(("days", "nats", "chosen"), [
    ((0.0, 4.0, 12.0, 24.0), STRONG + 1.0, {"self-discharge"}), ((0.0, 4.0, 12.0, 24.0), STRONG - 1.0, set()),
    ((1.0, 1.0, 2.0, 1.0), STRONG + 1.0, set()), ((1.0, 1.0, 2.0, 1.0), NATS + 1.0, {"self-discharge"}),
])  # fmt: skip
def test_what_storage_does_to_every_pack_needs_strong_evidence_only_where_noted_days_would_show_it(days, nats, chosen):
    stored = [EFFECTS["self-discharge"](rate=5e-3 / 86400.0, storage=86400.0 * d) for d in days]
    flights = tuple(
        replace(flown([one], seed=5, number=k), notes=Notes(storage_days=d))
        for k, (one, d) in enumerate(zip(stored, days, strict=True))
    )
    lost = frozenset({"self-discharge"})
    found = searching(flights, lost)
    found.base = replace(found.base, lab=told_its_form(found.base.lab))
    (storage,) = found.candidates
    for names in (frozenset(), lost):
        found.fitted(names)
    found.snr = {storage.id: expected_snr(found.fits[frozenset()], found.joint(lost), storage)}
    earning(found, lost, nats)
    assert select(found).names == chosen


@pytest.mark.parametrize(("told", "beside", "chosen"), [
    (True, frozenset(), {"slow-diffusion"}), (False, frozenset(), set()), (True, FADE, FADE),
])  # fmt: skip
def test_structure_alone_has_to_beat_noise_only_where_the_lab_took_its_own_off(told, beside, chosen):
    slow = frozenset({"slow-diffusion"})
    effects = [EFFECTS["slow-diffusion"](resistance=1.6e-3, time_constant=300.0)]
    effects += [EFFECTS["capacity-fade"](fade=0.12)] if beside else []
    found = searching(tuple(flown(effects, seed=5, number=k) for k in range(4)), slow | beside)
    if told:
        found.base = replace(found.base, lab=told_its_form(found.base.lab))
    for names in {frozenset(), beside, slow, slow | beside}:
        found.fitted(names)
    by_fade = found.evidence(beside)
    earning(found, slow | beside, by_fade + NATS + 2.0)
    if beside:
        earning(found, slow, 0.0)
    assert select(found).names == chosen


@pytest.mark.parametrize(("beside", "nats", "slow_too"), [("warmth", 24.0, False), ("warmth", 32.0, True),
                                                          ("fade", 24.0, True)])  # fmt: skip
def test_what_a_lab_told_of_the_drops_structure_it_did_not_tell_of_other_temperatures(beside, nats, slow_too):
    slow = frozenset({"slow-diffusion"})
    other, effect, kelvins = {
        "warmth": (frozenset({"resistance-temperature"}), {"activation_energy": 22e3}, AMBIENT_K),
        "fade": (FADE, {"fade": 0.12}, (298.15,) * 4),
    }[beside]
    effects = [EFFECTS["slow-diffusion"](resistance=1.6e-3, time_constant=300.0), EFFECTS[min(other)](**effect)]
    flights = tuple(flown(effects, seed=5, number=k, kelvin=kelvin) for k, kelvin in enumerate(kelvins))
    found = searching(flights, slow | other)
    found.base = replace(found.base, lab=told_its_form(found.base.lab))
    for names in (frozenset(), other, slow, slow | other):
        found.fitted(names)
    earning(found, slow | other, found.evidence(other) + nats)
    earning(found, slow, 0.0)
    assert select(found).names == other | (slow if slow_too else frozenset())


@pytest.mark.parametrize(("behind_by", "rivals"), [(4.0, 1), (7.0, 0)])
def test_what_is_hardly_behind_is_a_rival_though_it_has_not_earned_a_name_by_itself(behind_by, rivals):
    """Once the battery as it is is ruled out, only how they compare tells two effects apart."""
    load, earned = frozenset({"unseen-load"}), NATS + 2.0
    flights = tuple(flown([EFFECTS["unseen-load"](current=2.0)], seed=5, number=k) for k in range(4))
    found = searching(flights, load | FADE)
    found.base = replace(found.base, lab=told_its_form(found.base.lab))
    for names in (frozenset(), load, FADE):
        found.fitted(names)
    for names, nats in ((load, earned), (FADE, earned - behind_by)):
        earning(found, names, nats)
    selected = select(found)
    assert selected.names == load
    assert selected.alternatives == (FADE,) * rivals


def test_two_effects_are_chosen_together_and_explain_nearly_all(both):
    assert select(both).names == FADE | CONTACT
    assert share(both, FADE | CONTACT) > 0.9


@pytest.mark.parametrize(("other", "ahead_by", "first"), [
    ("resistance-growth", 2.0, "resistance-growth"), ("resistance-growth", 4.0, "contact-resistance"),
    ("charge-transfer", -5.0, "contact-resistance"),
])  # fmt: skip
def test_of_equals_ageing_comes_before_a_bad_contact_and_that_before_structure(other, ahead_by, first):
    """Every pack ages. Structure would have to be ahead by what it has to earn more, and then they are no equals."""
    contact, rival = frozenset({"contact-resistance"}), frozenset({other})
    effects = [EFFECTS["contact-resistance"](resistance=0.015)]
    found = searching(tuple(flown(effects, seed=5, number=k) for k in range(4)), contact | rival)
    for names in (frozenset(), contact, rival):
        found.fitted(names)
    earning(found, rival, found.evidence(contact) - ahead_by)
    selected = select(found)
    assert selected.names == {first}
    assert selected.alternatives == ((contact | rival) - {first},)


@pytest.mark.parametrize(("ahead_by", "chosen"), [(-3.0, "unseen-load"), (3.0, "current-offset")])
def test_of_equals_that_are_as_common_the_likelier_comes_first(ahead_by, chosen):
    """A load past the sensor comes first in the catalogue, and does the same to every flight as an offset."""
    load, shift = frozenset({"unseen-load"}), frozenset({"current-offset"})
    flights = tuple(flown([EFFECTS["unseen-load"](current=2.0)], seed=5, number=k) for k in range(4))
    found = searching(flights, load | shift)
    for names in (frozenset(), load, shift):
        found.fitted(names)
    lead = found.evidence(shift) - found.evidence(load)
    cost = found.fits[load].cost + 2.0 * (ahead_by - lead)
    doctored = replace(found, fits={**found.fits, load: replace(found.fits[load], cost=cost)})
    assert doctored.evidence(shift) - doctored.evidence(load) == pytest.approx(ahead_by)
    assert select(doctored).names == {chosen}


@pytest.mark.parametrize(("deficits", "named"), [((0.01, 0.0, 0.01, 0.0), False), ((0.04, 0.0, 0.03, 0.01), True)])
def test_a_start_that_is_off_by_what_a_full_charge_is_known_to_is_none_that_anybody_missed(deficits, named):
    """Whatever it earns."""
    name = frozenset({"partial-charge"})
    flights = [flown([EFFECTS["partial-charge"](deficit=d)], seed=5, number=k) for k, d in enumerate(deficits)]
    found = searching(tuple(flights), name)
    found.fitted(frozenset())
    fitted = found.fitted(name)
    favoured = replace(found, fits={**found.fits, name: replace(fitted, cost=fitted.cost - 80.0)})
    assert favoured.evidence(name) > 30.0
    assert (select(favoured).names == name) is named


@pytest.mark.parametrize(
    ("kelvin", "named"),
    [
        ((279, 284, 289, 294, 299), False),
        ((289, 299, 279, 284, 294), True),
        (tuple(289.0 + 2e-13 * k for k in range(5)), True),  # as warm as each other but for rounding
    ],
)
def test_sizes_of_single_flights_that_follow_their_temperature_are_what_another_cause_leaves(kelvin, named):
    """The same deficits, from the coldest flight to the warmest or in no such order."""
    name, deficits = frozenset({"partial-charge"}), (0.12, 0.095, 0.07, 0.05, 0.02)
    effects = [EFFECTS["partial-charge"](deficit=d) for d in deficits]
    flights = [flown([e], seed=5, number=k, kelvin=at) for k, (e, at) in enumerate(zip(effects, kelvin, strict=True))]
    found = searching(tuple(flights), name)
    for names in (frozenset(), name):
        found.fitted(names)
    assert (select(found).names == name) is named


@pytest.mark.parametrize(("deficits", "both"), [
    ((0.11, 0.05, 0.08, 0.02, 0.17, 0.14), False), ((0.14, 0.02, 0.11, 0.05, 0.17, 0.08), True),
])  # fmt: skip
def test_they_are_that_too_where_it_is_inferred_how_warm_the_flights_were(deficits, both):
    """The larger the warmer the day, in the order of the days or not quite in it."""
    law, name = frozenset({"resistance-temperature"}), frozenset({"partial-charge"})
    flights = warmed(days(6), [EFFECTS["partial-charge"](deficit=deficit) for deficit in deficits])
    found = searching(flights, law | name)
    for names in (frozenset(), law, name, law | name):
        found.fitted(names)
    assert (select(found).names == law | name) is both


def test_evidence_that_the_equations_have_no_part_in_chooses_nothing():
    """Whatever it amounts to: it comes of the lab's errors, which were bent to suit the set."""
    found = searching(off_by_its_curve(flown(number=k) for k in range(4)), CONTACT)
    for names in (frozenset(), CONTACT):
        found.fitted(names)
    fitted = found.fitted(CONTACT)
    felt = fitted.x.copy()
    felt[fitted.joint.places["contact-resistance.resistance"]] = 10.0  # [mohm]
    favoured = replace(found, fits={**found.fits, CONTACT: replace(fitted, x=felt, cost=fitted.cost - 80.0)})
    assert favoured.evidence(CONTACT) > 30.0
    assert share(favoured, CONTACT) < MUCH
    assert select(favoured).names == frozenset()


@pytest.mark.parametrize(
    ("told", "beside", "nats"),
    [(True, (), 10.0), (True, ("partial-charge",), 10.0), (True, ("capacity-fade",), 18.0),
     (True, ("partial-charge", "capacity-fade"), 18.0), (False, ("partial-charge",), 30.0)],
)  # fmt: skip
def test_what_looks_like_structure_has_to_earn_no_more_beside_what_flights_begin_with(told, beside, nats):
    """The equation of that leaves nothing: beside it as alone only noise is left, where the lab told its form."""
    found = searching([flown(seed=3)], ["slow-diffusion", *beside])
    if told:
        found.base = replace(found.base, lab=told_its_form(found.base.lab))
    assert found.needed("slow-diffusion", frozenset({"slow-diffusion", *beside})) == pytest.approx(nats)


@pytest.mark.parametrize(("told", "chosen"), [(True, CONTACT), (False, frozenset())])
def test_where_the_lab_told_its_form_equations_claim_what_a_member_has_to_earn(told, chosen):
    """Otherwise a part of any evidence may be what its form is off by, and more is asked for."""
    flights = tuple(flown([EFFECTS["contact-resistance"](resistance=0.02)], seed=5, number=k) for k in range(4))
    found = searching(flights, CONTACT)
    if told:
        found.base = replace(found.base, lab=told_its_form(found.base.lab))
    for names in (frozenset(), CONTACT):
        found.fitted(names)
    earned = 1.3 * NATS
    cost = found.fits[CONTACT].cost + 2.0 * found.inflation * (found.evidence(CONTACT) - earned)
    found.fits[CONTACT] = replace(found.fits[CONTACT], cost=cost)
    assert found.evidence(CONTACT) == pytest.approx(earned)
    assert share(found, CONTACT) > 0.9
    assert select(found).names == chosen


@pytest.mark.parametrize(("nats", "joules", "recorded", "chosen", "heard"), [
    (5.0, 22e3, True, True, 3.0), (2.0, 22e3, True, False, 3.0), (5.0, 22e3, False, False, 6.0),
    (5.0, 1.5e3, True, False, 6.0), (13.0, 1.5e3, True, True, 6.0),
])  # fmt: skip
def test_a_law_has_to_be_seen_only_where_what_drives_it_was_recorded_and_it_is_of_known_size(
    nats, joules, recorded, chosen, heard
):
    """That resistance follows temperature needs no long odds; a temperature that nobody recorded does.

    So does what follows temperature by a tenth of what any cell does: that is another thing.
    """
    warmth = frozenset({"resistance-temperature"})
    physics = [EFFECTS["resistance-temperature"](activation_energy=joules)]
    flights = [flown(physics, seed=5, number=k, kelvin=t) for k, t in enumerate(AMBIENT_K)]
    flights = [f if recorded else replace(f, temperature_k=None) for f in flights]
    found = searching(tuple(flights), warmth)
    found.base = replace(found.base, lab=told_its_form(found.base.lab))
    for names in (frozenset(), warmth):
        found.fitted(names)
    cost = found.fits[warmth].cost + 2.0 * found.inflation * (found.evidence(warmth) - nats)
    found.fits[warmth] = replace(found.fits[warmth], cost=cost)
    assert found.evidence(warmth) == pytest.approx(nats)
    assert (select(found).names == warmth) is chosen
    (name,) = warmth
    assert found.heard(name, warmth) == heard  # by its own equation, and with the other model


@pytest.mark.parametrize(("nats", "tried"), [(3.0, False), (30.0, True)])
def test_others_are_tried_in_the_place_of_members_only_where_they_could_earn_a_name(nats, tried):
    """Two effects have to earn twenty nats: of flights that like nothing by more than three, no two do."""
    mimic = frozenset({"resistance-growth"})  # of a contact
    found = searching(tuple(flown(seed=5, number=k) for k in range(3)), FADE | CONTACT | mimic)
    for names in (frozenset(), FADE, CONTACT, mimic, FADE | CONTACT):
        found.fitted(names)
    earning(found, FADE | CONTACT, nats)
    select(found)
    assert (FADE | mimic in found.fits) is tried


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


def test_where_a_part_of_a_refuted_set_may_be_said_so_may_what_is_as_simple_and_likelier():
    gain = frozenset({"current-gain"})
    effects = [EFFECTS["capacity-fade"](fade=0.14), EFFECTS["contact-resistance"](resistance=0.02)]
    found = searching(tuple(flown(effects, seed=5, number=k) for k in range(4)), {*FADE, *CONTACT, *gain})
    for names in (frozenset(), FADE, CONTACT, gain, FADE | CONTACT, gain | CONTACT):
        found.fitted(names)
    found.fits[FADE | CONTACT] = replace(found.fits[FADE | CONTACT], cost=1e6)
    assert found.evidence(gain) < found.evidence(FADE) < found.evidence(gain | CONTACT) - NATS
    assert select(found, [gain | CONTACT]).names == FADE


@pytest.mark.parametrize(("ahead_by", "named"), [(1.5 * NATS, True), (2.5 * NATS, False)])
def test_what_is_beyond_physics_counts_by_what_it_has_to_spare(both, ahead_by, named):
    """One more effect that needs a resistance at the end of its range has to earn its own place first."""
    pair = both.fits[FADE | CONTACT]
    where = pair.joint.places["contact-resistance.resistance"]
    x = pair.x.copy()
    x[where] = pair.joint.unknowns.high[where]
    lead = both.evidence(FADE | CONTACT) - both.evidence(FADE)
    cost = pair.cost + 2.0 * both.inflation * (lead - ahead_by)
    weak = replace(both.fits[CONTACT], cost=1e6)
    found = replace(both, fits={**both.fits, FADE | CONTACT: replace(pair, x=x, cost=cost), CONTACT: weak})
    assert found.evidence(FADE | CONTACT) - found.evidence(FADE) == pytest.approx(ahead_by)
    assert select(found).names == (FADE if named else frozenset())


def test_what_the_lab_was_off_by_besides_does_not_hide_an_effect_of_much_evidence():
    """Resistance moves with temperature by 6 kJ/mol; the open-circuit curve is off by up to 25 mV a cell as well."""
    effects = [EFFECTS["resistance-temperature"](activation_energy=6e3)]
    flights = off_by_its_curve(flown(effects, number=k, kelvin=kelvin) for k, kelvin in enumerate(AMBIENT_K))
    warmth = frozenset({"resistance-temperature"})
    found = searching(flights, warmth)
    found.fitted(frozenset())
    found.fitted(warmth)
    assert 0.0 < share(found, warmth) < MUCH
    assert select(found).names == warmth


@pytest.fixture(scope="module")
def lagging():
    """Flights of a cell with hysteresis, and nothing else to find."""
    name = frozenset({"hysteresis"})
    found = searching(tuple(flown([EFFECTS["hysteresis"](amplitude=0.03)], seed=5, number=k) for k in range(4)), name)
    for names in (frozenset(), name):
        found.fitted(names)
    return found, name


@pytest.mark.parametrize(
    ("told", "cell_v", "matters"), [(False, 0.003, False), (False, 0.005, True), (True, 0.003, True)]
)
def test_what_looks_like_a_models_structure_moves_the_voltage_by_more_than_a_model_may_be_off(
    lagging, told, cell_v, matters
):
    """By less where the lab told what its model's form is off by: that is taken off already."""
    whole, name = lagging
    lab = whole.base.lab
    found = replace(whole, base=replace(whole.base, lab=told_its_form(lab) if told else lab), fits=dict(whole.fits))
    found._added[name] = np.full_like(whole.added(name), cell_v * lab.series)
    assert (select(found).names == name) == matters


def with_parts(found, parts):
    """The same search where the pair's members do that by themselves (2, samples) [V]."""
    other = replace(found, fits=dict(found.fits))
    other._alone[FADE | CONTACT] = parts
    return other


@pytest.mark.parametrize(("earned", "stands"), [(1.0, False), (20.0, True)])
def test_two_look_alikes_that_work_against_each_other_have_to_earn_what_a_models_structure_has(both, earned, stands):
    """Contacts have grown worse and cells better by as much: any small error of the resistance looks like that."""
    told = replace(both, base=replace(both.base, lab=told_its_form(both.base.lab)), fits=dict(both.fits))
    for one in (FADE, CONTACT):
        behind = told.evidence(FADE | CONTACT) - told.evidence(one) - NATS - earned
        told.fits[one] = replace(told.fits[one], cost=told.fits[one].cost - 2.0 * told.inflation * behind)
    fade, contact = both.alone(FADE | CONTACT)
    assert select(with_parts(told, np.vstack([fade, contact]))).names == FADE | CONTACT
    against = np.vstack([1.9 * fade + contact, -0.9 * fade])
    assert (select(with_parts(told, against)).names == FADE | CONTACT) == stands


def test_a_member_counts_by_what_its_own_equation_explains_beside_the_others(both):
    """Evidence that comes of the lab's errors, which it lets the others bend, is none of its own."""
    fade, contact = both.alone(FADE | CONTACT)
    assert select(with_parts(both, np.vstack([fade + contact, 1e-3 * contact]))).names != FADE | CONTACT
