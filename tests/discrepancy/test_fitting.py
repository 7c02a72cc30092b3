"""Fits find the numbers that made the flights, and say how well."""

from __future__ import annotations

import numpy as np
import pytest
from discrepancy.flown import SIZES, base, four, noise_model, with_members

from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.parameters import parameters_of
from bhm_service.discrepancy.fitting import fit

NOISE = noise_model()


def found_again(name, model, seed=0):
    """How far each number of an effect is from the truth, in the standard deviation stated for it; and the fit."""
    joint = with_members(four(name, model, seed), {name}, model)
    fitted = fit(joint, NOISE)
    declared = {p.name: p for p in parameters_of(EFFECTS[name])}
    values = joint.values(fitted.x[None, :])
    off = []
    for key, true in SIZES[name].items():
        block = f"{name}.{key}"
        found = values[block][0] * declared[key].scale
        off.append((found - np.asarray(true)) / (fitted.sd(block) * declared[key].scale))
    return np.concatenate(off), fitted


@pytest.mark.parametrize("model", ["circ", "chem"])
@pytest.mark.parametrize("name", SIZES)
def test_a_known_effect_is_found_within_what_is_stated(name, model):
    off, fitted = found_again(name, model)
    assert np.abs(off).max() < 3.0
    (member,) = fitted.joint.members
    for u in member.amplitudes():
        assert np.all(fitted.sd(u.name) < 0.6 * fitted.joint.scale[fitted.joint.places[u.name]]), "told by the flights"


@pytest.mark.parametrize("name", ["capacity-fade", "resistance-growth"])
def test_stated_standard_deviations_are_neither_small_nor_idle_over_seeds(name):
    off = np.concatenate([found_again(name, "circ", seed)[0] for seed in range(5)])
    assert np.sqrt(np.mean(off**2)) < 1.6


def test_the_noise_explains_what_a_right_hypothesis_leaves():
    right, wrong = (fit(with_members(four("capacity-fade"), names), NOISE) for names in ({"capacity-fade"}, set()))
    assert right.misfit == pytest.approx(1.0, abs=0.15)
    assert right.cost < wrong.cost
    assert right.evidence(1.0) > wrong.evidence(1.0) + 6.0


def test_a_few_wild_readings_do_not_move_the_answer():
    flights = four("capacity-fade")
    clean = fit(with_members(flights, {"capacity-fade"}), NOISE)
    rng = np.random.default_rng(8)
    for f in flights:
        f.voltage_v[rng.integers(0, f.voltage_v.size, 4)] += 0.4 * rng.choice([-1.0, 1.0], 4)
    spoilt = fit(with_members(flights, {"capacity-fade"}), NOISE)
    where = clean.joint.places["capacity-fade.fade"]
    assert abs(spoilt.x[where][0] - clean.x[where][0]) < 1.5 * clean.sd("capacity-fade.fade")[0]


def test_blocks_that_are_not_to_move_stay():
    joint = base(four())
    fitted = fit(joint, NOISE, moving=["start_soc"])
    moved = fitted.x != joint.unknowns.start
    assert moved[joint.places["start_soc"]].any()
    moved[joint.places["start_soc"]] = False
    assert not moved.any()


@pytest.mark.parametrize("name", ["capacity-fade", "resistance-growth", "unseen-load"])
def test_an_effect_that_is_not_there_fits_no_worse_and_yet_costs_evidence(name):
    flights = four()
    bare, wider = (fit(with_members(flights, names), NOISE) for names in (set(), {name}))
    assert wider.misfit < bare.misfit + 0.002
    assert wider.evidence(1.0) < bare.evidence(1.0) - 1.0
