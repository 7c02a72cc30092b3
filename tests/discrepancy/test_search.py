"""What is behind four flights is named among its mimics, and nothing is named where there is nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import (
    AMBIENT_K,
    BATTERY,
    SIZES,
    base,
    catalogue,
    flown,
    four,
    noise_model,
    searching,
    told_its_form,
    with_steps_that_come_earlier,
)

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.explain import Request, explain
from bhm_service.discrepancy.first_order import saturated_noise
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.odds import needed
from bhm_service.discrepancy.search import Search, search
from bhm_service.discrepancy.selection import select, share

FLOWN = [*((name, "circ") for name in SIZES), ("resistance-growth", "chem")]


@pytest.mark.parametrize(("name", "model"), FLOWN)
def test_an_effect_is_named_among_its_mimics(name, model):
    """Equals are told by the one that is commoner, so the name may only lose to a set that is said to be equal."""
    flights = four(name, model, seed=1)
    tried = catalogue(flights, model, {name, *EFFECTS[name].mimics})
    assert len(tried) > 2
    found = search(base(flights, model), tried)
    chosen = select(found)
    assert chosen.names
    assert frozenset({name}) in {chosen.names, *chosen.alternatives}
    assert len(chosen.names) == 1
    assert chosen.earned[next(iter(chosen.names))] > 6.0


def test_what_stands_beside_a_larger_effect_is_not_taken_for_an_error_of_the_lab():
    """A slow drop of 4 mOhm a cell that is left out makes the lab's own slow drops three times as uncertain."""
    effects = [EFFECTS["capacity-fade"](fade=0.15), EFFECTS["slow-diffusion"](resistance=0.004, time_constant=200.0)]
    flights = tuple(flown(effects, seed=6, number=k) for k in range(4))
    tried = catalogue(flights, only={"capacity-fade", "slow-diffusion", "hysteresis"})
    found = search(base(flights), tried)
    assert max(found.base.lab.widening.values()) < 1.5
    assert select(found).names == {"capacity-fade", "slow-diffusion"}


CORE, WARMTH = "core-lag", "resistance-temperature"


def warm(*effects):
    """Four flights in all weathers with the pack's temperature logged, and what is tried of cores and warmth."""
    flights = tuple(flown(effects, seed=8, number=k, kelvin=kelvin) for k, kelvin in enumerate(AMBIENT_K))
    return flights, catalogue(flights, only={CORE, WARMTH})


def sized(fitted, name):
    """A number of a fit, as the catalogue declares it."""
    return fitted.joint.values(fitted.x[None, :])[name][0, 0]


def test_steps_of_a_curve_that_come_earlier_in_the_cold_are_no_more_than_the_law_of_temperature_may_be_off_by():
    """What a law of one number leaves beside them looks like entropy, contacts or charge transfer."""
    law = frozenset({WARMTH})
    kelvin = (272.0, 282.0, 292.0, 302.0)
    still = [
        flown([EFFECTS[WARMTH](activation_energy=30e3)], seed=3, number=k, kelvin=at) for k, at in enumerate(kelvin)
    ]
    flights = tuple(with_steps_that_come_earlier(f, 30e3) for f in still)
    found = searching(flights, law)
    found.base = replace(found.base, lab=told_its_form(found.base.lab))
    fitted = found.fitted(law)
    steps = max(np.std(f.voltage_v - g.voltage_v) for f, g in zip(flights, still, strict=True))
    left = [np.std(f.voltage_v - p.voltage[0])
            for f, p in zip(flights, fitted.joint.all_predicted(fitted.x[None, :]), strict=True)]  # fmt: skip
    assert steps > 0.05
    assert max(left) < 0.3 * steps


def test_what_shows_only_beside_another_is_tried_beside_it():
    """A core that is warmer than its sensor changes nothing but what the warmth does."""
    effects = [EFFECTS[WARMTH](activation_energy=25e3), EFFECTS[CORE](thermal_resistance=1.5, time_constant=200.0)]
    flights, tried = warm(*effects)
    found = search(base(flights), tried)
    both = frozenset({CORE, WARMTH})
    assert select(found).names == both
    assert found.earned(both)[CORE] > needed(CORE)
    energy = {names: sized(found.fitted(names), f"{WARMTH}.activation_energy") for names in (both, both - {CORE})}
    assert 0.0 < 25.0 - energy[both] < 0.6 * (25.0 - energy[both - {CORE}])
    # What the warmer core adds is not counted as the warmth's a second time.
    assert share(found, both) > 0.9


def test_a_warmth_that_nobody_recorded_is_found_from_where_there_is_none_of_it():
    """At no activation energy nothing tells which way the temperature has to go: a fit from there would stay there."""
    warms = EFFECTS["self-heating"](heat_capacity=60.0, conductance=0.25, ambient=298.15, start_above=0.0)
    flights = tuple(flown([EFFECTS[WARMTH](activation_energy=25e3), warms], seed=8, number=k) for k in range(4))
    found = Search(base(flights), tuple(catalogue(flights, only={WARMTH})), noise_model())
    hidden = frozenset({WARMTH})
    fitted = found.fitted(hidden, found.fitted(frozenset()))
    assert sized(fitted, f"{WARMTH}.activation_energy") > 10.0
    assert found.evidence(hidden) > 10.0


def test_a_driver_that_nobody_recorded_is_looked_for_anew_where_the_noise_is_another():
    """A first search, of other noise, may have taken cold flights for warm ones, and what the cold does for the lab's.

    How cold it was and how much resistance minds that trade against each other; which side of the lab it was does not.
    """
    cold = EFFECTS["self-heating"](heat_capacity=60.0, conductance=0.25, ambient=268.15, start_above=0.0)
    flights = tuple(flown([EFFECTS[WARMTH](activation_energy=25e3), cold], seed=8, number=k) for k in range(4))
    tried, hidden = tuple(catalogue(flights, only={WARMTH})), frozenset({WARMTH})
    first = Search(base(flights), tried, noise_model())
    joint, ambient = first.joint(hidden), "self-heating.ambient"
    x = joint.unknowns.start.copy()
    x[joint.places[ambient]] = 313.0
    warm = fit(joint, first.noise, x, moving=[b.name for b in joint.unknowns.blocks if b.name != ambient])
    found = Search(base(flights), tried, replace(first.noise, sigma_v=1.1 * first.noise.sigma_v))
    fitted = found.fitted(hidden, warm)
    assert np.mean(fitted.joint.values(fitted.x[None, :])[ambient]) < 288.0
    assert sized(fitted, f"{WARMTH}.activation_energy") > 10.0


def test_on_two_cores_the_same_is_found_to_the_last_bit():
    flights, tried = warm(EFFECTS[WARMTH](activation_energy=25e3))
    one, two = (search(base(flights), tried, cores=cores) for cores in (1, 2))
    assert one.ranked() == two.ranked()
    for names, fitted in one.fits.items():
        assert np.array_equal(fitted.x, two.fits[names].x)
        assert one.evidence(names) == two.evidence(names)


def worn(*effects):
    """Four flights of a pack of half as much resistance again, and a search of what wears packs over them."""
    effects = [EFFECTS["resistance-growth"](growth=0.5), *effects]
    return searching([flown(effects, seed=3, number=k) for k in range(4)], {"resistance-growth", "capacity-fade"})


def test_what_a_fit_brought_to_nothing_is_begun_anew_where_it_is_expected():
    """A sensor that reads high bent the start the way that more capacity would: from there no fade seems to be best."""
    one, both = frozenset({"resistance-growth"}), frozenset({"resistance-growth", "capacity-fade"})
    found, other = worn(EFFECTS["capacity-fade"](fade=0.2)), worn(EFFECTS["current-gain"](gain=1.05))
    fitted = found.fitted(both, other.fitted(one, other.fitted(frozenset())))
    assert sized(fitted, "capacity-fade.fade") > 0.1


def test_what_shows_only_beside_another_is_not_tried_without_it():
    flights, tried = warm(EFFECTS["contact-resistance"](resistance=0.02))
    found = search(base(flights), [*tried, *catalogue(flights, only={"contact-resistance"})])
    assert CORE not in found.snr
    assert not any(CORE in names for names in found.fits)


@pytest.mark.parametrize(("offset", "deficit", "most"), [(0.06, 0.0, 2), (0.25, 0.06, 3)])
def test_a_third_effect_is_looked_for_only_beside_two_that_both_earn_a_place(offset, deficit, most):
    """An offset of 60 mV has hardly any evidence beside a growth, one of 250 mV has much."""
    both = [EFFECTS["resistance-growth"](growth=0.5), EFFECTS["voltage-offset"](offset=offset)]
    short = EFFECTS["partial-charge"](deficit=deficit)
    flights = tuple(flown([*both, short] if k == 2 else both, seed=5, number=k) for k in range(4))
    tried = catalogue(flights, only={"resistance-growth", "voltage-offset", "partial-charge"})
    assert max(map(len, search(base(flights), tried).fits)) == most


def missing(name, **sizes):
    """A search over one effect on flights that carry it, and what the fit without it pays for what the lab knows."""
    flights = tuple(flown([EFFECTS[name](**sizes)], seed=3, number=k) for k in range(4))
    found = Search(base(flights), tuple(catalogue(flights, only={name})), noise_model())
    bare = found.fitted(frozenset())
    return found, float(np.sum(bare.joint.pulls(bare.x) ** 2))


@pytest.mark.parametrize(
    ("name", "size"), [("contact-resistance", {"resistance": 0.01}), ("resistance-growth", {"growth": 0.2})]
)
def test_what_a_candidate_is_expected_to_add_is_what_its_fit_adds(name, size):
    """The lab's errors have been bent to make up for it, and it gets back what that cost."""
    found, pulled = missing(name, **size)
    assert pulled > 30.0
    assert found.gains(frozenset())[name] == pytest.approx(found.evidence(frozenset({name})), rel=0.3)


def test_a_candidate_that_moves_the_charge_beside_a_bent_curve_is_expected_to_add_no_more_than_it_does():
    """One linear step sees the bend where it stands, and a fit takes it along."""
    found, pulled = missing("unseen-load", current=1.0)
    assert pulled > 40.0
    assert 10.0 < found.gains(frozenset())["unseen-load"] < found.evidence(frozenset({"unseen-load"}))


def test_an_effect_of_two_sizes_that_bend_each_other_is_expected_to_add_most_of_what_its_fit_adds():
    found, _ = missing("charge-transfer", bend=3.0, straight=1.0)
    assert found.gains(frozenset())["charge-transfer"] > 0.5 * found.evidence(frozenset({"charge-transfer"})) > 50.0


def test_small_sizes_that_flights_have_each_of_their_own_pay_for_no_wider_prior_than_they_need():
    """Charge that is missing at the start is declared to differ by 8 % between flights; here it does by 3 %."""
    missing_charge = (0.045, 0.0, 0.03, 0.015)
    kind = EFFECTS["partial-charge"]
    flights = tuple(flown([kind(deficit=d)], seed=3, number=k) for k, d in enumerate(missing_charge))
    tried = catalogue(flights, only={"partial-charge"})
    names = frozenset({"partial-charge"})
    found = search(base(flights), tried)
    (told,) = next(c for c in found.candidates if c.id == "partial-charge").unknowns
    assert told.prior[1] == pytest.approx(float(np.sqrt(np.mean(np.square(missing_charge)))), abs=0.01)
    as_declared = Search(found.base, tuple(tried), found.noise)
    as_declared.fitted(frozenset())
    assert found.evidence(names) > as_declared.evidence(names) + 1.0


def test_noise_is_what_no_candidate_explains_whatever_spread_the_candidates_are_expected_to_have():
    """A candidate that is in the fit already is not added to it once more."""
    kind = EFFECTS["partial-charge"]
    flights = tuple(flown([kind(deficit=d)], seed=3, number=k) for k, d in enumerate((0.045, 0.0, 0.03, 0.015)))
    (tried,) = catalogue(flights, only={"partial-charge"})
    at = Search(base(flights), (tried,), noise_model()).fitted(frozenset({"partial-charge"}))
    finer = tried.as_spread({name: rows[0] for name, rows in at.joint.values(at.x[None, :]).items()})
    assert finer != tried
    assert saturated_noise(at, [finer]) == saturated_noise(at, [tried])


@pytest.fixture(scope="module")
def growth():
    """The whole of it for flights with more resistance."""
    return explain(Request(battery=BATTERY, flights=four("resistance-growth", seed=2)))


@pytest.fixture(scope="module")
def nothing():
    """The whole of it for flights that the battery file describes."""
    return explain(Request(battery=BATTERY, flights=four(seed=2)))


def test_against_the_whole_catalogue_the_name_and_its_number_are_found(growth):
    (effect,) = growth.findings.effects
    assert effect.id == "resistance-growth"
    (number,) = effect.parameters.values()
    assert abs(number.value - 0.5) < 3.0 * number.sd
    assert number.unit == "1"
    assert effect.p_familywise <= 0.02
    assert effect.share_of_misfit > 0.9
    assert effect.decoys_beaten is None  # it follows no temperature


def test_a_name_that_has_rivals_is_called_ambiguous_and_comes_with_what_would_settle_it(growth):
    found = growth.findings
    assert found.verdict == ("ambiguous" if found.alternatives else "named")
    assert bool(found.advice) == bool(found.alternatives)
    assert all("resistance-growth" not in rival for rival in found.alternatives)


def test_the_fit_is_better_on_flights_that_it_did_not_see(growth):
    fit = growth.findings.fit
    assert fit.rmse_after_V < 0.2 * fit.rmse_before_V
    assert fit.heldout_after_V < 0.3 * fit.heldout_before_V
    assert fit.noise_floor_V < 0.02


def test_misfit_that_was_there_has_a_place(growth):
    assert all(r.sign == -1 for r in growth.findings.localisation)


def test_flying_time_is_shorter_on_a_pack_with_more_resistance(growth):
    assert len(growth.flying) == 4
    assert all(0.0 < f.after_s < f.before_s + 1.0 for f in growth.flying)


def test_flights_that_the_battery_describes_need_no_physics(nothing):
    found = nothing.findings
    assert found.verdict == "none"
    assert found.effects == []
    assert found.alternatives == []
    assert found.unexplained_rest == 0.0
    assert nothing.repaired is None
    assert found.fit.heldout_after_V == found.fit.heldout_before_V


def test_what_could_not_be_seen_is_said(nothing):
    because = {n.id: n.because for n in nothing.not_excited}
    assert "storage" in because["self-discharge"]
    assert all(np.isfinite(v) for v in nothing.search.snr.values())
