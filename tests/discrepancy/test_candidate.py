"""What of the catalogue can be tried on a set of flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import base, four

from bhm_service.discrepancy.candidate import alike, alike_sd, candidates
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.sidecar import Notes

WH = 200.0


def aged(*cycles):
    flights = four("capacity-fade")[: len(cycles)]
    return [replace(f, notes=Notes(cycles=c)) for f, c in zip(flights, cycles, strict=True)]


def candidate(name, flights):
    return next(c for c in candidates(flights, "circ", WH)[0] if c.id == name)


def test_age_is_counted_as_a_share_of_the_oldest_flight():
    fade = candidate("capacity-fade", aged(40.0, 200.0, 400.0))
    assert fade.fixed["capacity-fade.age"] == [0.1, 0.5, 1.0]
    sizes = {"fade": 0.2, "area": 0.5, "settled": 0.0}
    numbers = {f"capacity-fade.{name}": np.array([[own]]) for name, own in sizes.items()}
    (effect,) = fade.effects(numbers, 1)
    assert effect.fade * effect.age == np.array([[0.1]])


def test_how_much_of_a_loss_is_older_than_the_flights_is_asked_only_where_their_age_is_known():
    told = candidate("capacity-fade", aged(40.0, 200.0, 400.0))
    untold = candidate("capacity-fade", four("capacity-fade"))
    assert [u.declared.name for u in told.unknowns] == ["fade", "area", "settled"]
    assert [u.declared.name for u in untold.unknowns] == ["fade", "area"]


def test_days_in_storage_reach_the_effect_in_seconds():
    flights = [
        replace(f, notes=Notes(storage_days=d)) for f, d in zip(four("capacity-fade"), (1, 2, 3, 4), strict=True)
    ]
    assert candidate("self-discharge", flights).fixed["self-discharge.storage"][1] == 2 * 86400.0


def test_what_needs_a_driver_that_nobody_wrote_down_is_not_tried():
    tried, missing = candidates(four("capacity-fade"), "circ", WH)
    assert "self-discharge" not in {c.id for c in tried}
    assert "needs storage" in next(m.because for m in missing if m.id == "self-discharge")


def test_what_is_in_the_battery_already_is_not_tried_again():
    tried, missing = candidates(four("capacity-fade"), "circ", WH, joined=["capacity-fade"])
    assert "capacity-fade" not in {c.id for c in tried}
    assert next(m.because for m in missing if m.id == "capacity-fade") == "is in the battery file already"


def test_a_battery_that_has_slow_diffusion_may_lack_more_of_it():
    """Most packs are identified with a slow pair; what their flights lack may be another one."""
    tried, missing = candidates(four("capacity-fade"), "circ", WH, joined=["slow-diffusion"])
    assert "slow-diffusion" in {c.id for c in tried}
    assert "slow-diffusion" not in {m.id for m in missing}


def test_a_weak_cell_is_looked_for_only_where_a_flight_goes_deep():
    flights = four("capacity-fade")
    drawn = max(float(f.charge_c[-1]) for f in flights)
    for capacity, known in ((drawn / 0.65, True), (drawn / 0.55, False)):
        tried, missing = candidates(flights, "circ", WH, capacity_c=capacity)
        assert ("weak-cell" in {c.id for c in tried}) is known
        assert ("no flight goes below 40% of charge" in {m.because for m in missing}) is not known


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("capacity-fade", "capacity"), ("resistance-growth", "resistance"), ("contact-resistance", "resistance"),
        ("current-gain", "capacity and resistance"), ("partial-charge", "start"),
        ("voltage-gain", "open-circuit curve"), ("voltage-offset", "open-circuit curve"),
        ("ocv-shape", "open-circuit curve"), ("resistance-shape", "resistance"),
    ],
)  # fmt: skip
def test_what_a_battery_file_of_another_pack_leaves_open_is_no_missing_physics(name, what):
    flights = four("capacity-fade")
    assert name in {c.id for c in candidates(flights, "circ", WH)[0]}
    tried, missing = candidates(flights, "circ", WH, identified=False)
    assert name not in {c.id for c in tried}
    assert f"its {what} is open anyway" in next(m.because for m in missing if m.id == name)


def test_ageing_shows_on_any_pack_where_the_flights_are_of_different_age():
    tried, _ = candidates(aged(40.0, 200.0, 400.0), "circ", WH, identified=False)
    assert {"capacity-fade", "resistance-growth"} <= {c.id for c in tried}
    assert "current-gain" not in {c.id for c in tried}
    alike, _ = candidates(aged(200.0, 200.0, 200.0), "circ", WH, identified=False)
    assert not {"capacity-fade", "resistance-growth"} & {c.id for c in alike}


def test_a_single_cell_has_no_weaker_one_beside_it():
    flights = four("capacity-fade")
    assert "weak-cell" in {c.id for c in candidates(flights, "circ", WH, series=2)[0]}
    tried, missing = candidates(flights, "circ", WH, series=1)
    assert "weak-cell" not in {c.id for c in tried}
    assert "a single cell" in next(m.because for m in missing if m.id == "weak-cell")


def test_a_temperature_that_nobody_recorded_is_looked_for_where_it_shows_first():
    felt = {"resistance-temperature", "cold-capacity", "entropic-voltage"}
    blind = four("capacity-fade")
    warm = [replace(f, temperature_k=np.full(f.time_s.size, 290.0)) for f in blind]
    assert felt <= {c.id for c in candidates(warm, "circ", WH)[0]}
    tried, missing = candidates(blind, "circ", WH)
    assert felt & {c.id for c in tried} == {"resistance-temperature"}
    assert "needs a recorded temperature" in next(m.because for m in missing if m.id == "cold-capacity")


@pytest.mark.parametrize("identified", [True, False])
def test_how_warm_the_core_is_is_asked_only_of_the_pack_that_the_battery_file_is_of(identified):
    """What stands beside an inexact law of temperature would mend what the file of another pack gets wrong."""
    tried, missing = candidates(four("resistance-temperature"), "circ", WH, identified=identified)
    assert ("core-lag" in {c.id for c in tried}) is identified
    assert ("core-lag" in {m.id for m in missing}) is not identified


@pytest.mark.parametrize("count", [2, 6])
def test_what_is_alike_is_each_as_uncertain_as_said_and_differs_by_as_little(count):
    """Ten kelvins of weather, five from one flight to the next."""
    sd = alike_sd(count, 10.0, 5.0)
    rows = alike(count, sd, 5.0)
    covariance = sd**2 * np.linalg.inv(np.eye(count) + rows.T @ rows)
    each, apart = covariance[0, 0], covariance[0, 0] + covariance[1, 1] - 2.0 * covariance[0, 1]
    assert np.sqrt(each) == pytest.approx(10.0)
    assert np.sqrt(apart / 2.0) == pytest.approx(5.0)


@pytest.mark.parametrize(("count", "share"), [(4, 1.0), (36, 0.5)])
def test_many_flights_of_a_pack_that_nobody_identified_tell_no_more_of_what_they_share_than_a_few(count, share):
    """How far they are from each other they do tell."""
    flights = tuple(replace(f, temperature_k=None) for f in four("capacity-fade")) * (count // 4)
    joint = {}
    for identified in (True, False):
        found, _ = candidates(flights, "circ", WH, identified=identified)
        member = next(c for c in found if c.id == "resistance-temperature")
        joint[identified] = Joint(base(flights).lab, flights, (member,))

    def spread(identified, along):
        at = joint[identified]
        where = at.places["self-heating.ambient"]
        known = np.linalg.inv(at.known)[where, where] * np.outer(at.scale[where], at.scale[where])
        return float(np.sqrt(along @ known @ along))

    def size_sd(identified):
        return joint[identified].scale[joint[identified].places["resistance-temperature.activation_energy"]][0]

    mean, apart = np.full(count, 1.0 / count), np.eye(count)[0] - np.eye(count)[1]
    assert spread(True, mean) == pytest.approx(9.0, rel=0.05)
    assert spread(False, mean) == pytest.approx(5.0 / np.sqrt(count))
    assert spread(False, apart) == pytest.approx(spread(True, apart), rel=1e-6)
    assert size_sd(False) == pytest.approx(share * size_sd(True))
