"""What a lab's recordings show of the errors of a model's form: as much as is in them, and as uncertain as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from battery.cells import CAPACITY_C
from discrepancy.flown import BATTERY, SERIES, flown, noise

from bhm_service.battery.pack import PackModel
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import BEND_SOC, DROP_SOC, LAG_SOC, followed
from bhm_service.discrepancy.lab_errors import Followed, lab_errors
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.identification.curve import LOW_SOC
from bhm_service.identification.experiment import Experiment, Kind

LAB = lab_of(BATTERY, "circ", None, None).at_worst(by_charge=False)
SIZE = sum(LAB.form_sizes.values())


def played(seed, wrong=None, kind=Kind.VARIABLE):
    """A recording of a cell that its model follows but for numbers of its form (n,), and for noise."""
    rng = np.random.default_rng([seed, 7])
    seconds = 3000 if kind is Kind.VARIABLE else 30000
    t = np.linspace(0.0, seconds, 1500)
    hover = 0.9 * CAPACITY_C / seconds
    steps = np.repeat(rng.choice([0.6, 1.0, 1.5], 75), 20) if kind is Kind.VARIABLE else np.ones(1500)
    current = hover * steps
    run = PackModel(LAB.cell, 1, 1.0, LAB.effects).simulate(t, current, 1.0, None)
    soc = np.ravel(run.soc)
    off = noise(rng, t.size) / SERIES
    if wrong is not None:
        shapes = LAB.added(followed(t, current), current, soc)[:SIZE] / SERIES
        off = off + wrong @ shapes
    experiment = Experiment(
        label=kind.value, kind=kind, time_s=t, current_a=current, voltage_v=np.ravel(run.voltage) + off
    )
    return Followed(experiment, off, soc)


def recordings(seed, wrong=None):
    return [played(seed, wrong), played(seed + 1000, wrong, Kind.SLOW)]


@pytest.fixture(scope="module")
def flight():
    return flown(seed=8)


def soc_of(flight):
    return 1.0 - flight.charge_c / CAPACITY_C


def vector(found):
    return np.concatenate([np.asarray(found.mean[name]) for name in LAB.form_sizes])


def drawn(rng):
    """Errors of form as a lab may leave them."""
    mean, covariance = LAB.form
    return 0.5 * rng.multivariate_normal(mean, covariance)


def test_what_a_model_is_off_by_is_found_to_within_what_is_said_of_it():
    """Every number within three standard deviations, nineteen times in twenty at least."""
    within, told = [], []
    for seed in range(12):
        wrong = drawn(np.random.default_rng(seed))
        found = lab_errors(LAB, recordings(seed, wrong))
        sds = np.sqrt(np.diag(found.covariance))
        within.append(np.abs(vector(found) - wrong) < 3.0 * sds)
        told.append(sds / np.sqrt(np.diag(LAB.form[1])))
    assert np.mean(within) > 0.95
    # The curve where the slow recording shows it, and the whole drop: the split between neighbours is hardly told.
    assert np.mean(np.array(told)[:, 4 : BEND_SOC.size]) < 0.5


def test_the_resistance_at_a_charge_is_told_better_than_how_fast_it_comes():
    """What comes at once and what follows sum to a drop that every recording shows."""
    covariance = lab_errors(LAB, recordings(3)).covariance
    knot = int(np.argmin(np.abs(DROP_SOC - 0.55)))
    drops = [BEND_SOC.size + k * DROP_SOC.size + knot for k in range(6)]
    together = float(np.sqrt(covariance[np.ix_(drops, drops)].sum()))
    assert together < 0.5 * float(np.sqrt(sum(covariance[k, k] for k in drops)))


def test_a_charge_that_lags_behind_the_load_is_foretold_where_the_curve_is_steeper():
    """A cell at its curve's voltage for 1.5 % less charge than it holds, half a minute after the load asks for it."""

    seen = [lagging(seed, kind)[0] for seed, kind in LAGGING]
    found = lab_errors(LAB, seen)
    assert "lag_at" not in found.mean
    assert sum(found.mean["lag"]) == pytest.approx(0.015, abs=3.0 * np.sqrt(lags_variance(found)))
    assert left_of_a_lag(LAB, vector(found), lagging(30, Kind.VARIABLE)) < 0.3


def test_a_lag_that_goes_by_charge_is_told_by_charge():
    seen = [lagging(seed, kind, slow_at_some, noise_share=0.3)[0] for seed, kind in LAGGING]
    found = lab_errors(LAB, seen)
    told = np.asarray(found.mean["lag_at"]) + sum(found.mean["lag"])
    shown = (LAG_SOC > 0.2) & (LAG_SOC < 0.95)
    assert np.corrcoef(told[shown], slow_at_some(LAG_SOC[shown]))[0, 1] > 0.95
    lab, numbers = LAB.at_worst(by_charge=True), np.concatenate(list(found.mean.values()))
    assert left_of_a_lag(lab, numbers, lagging(30, Kind.VARIABLE, slow_at_some, noise_share=0.3)) < 0.2


def test_recordings_of_one_load_do_not_tell_a_lag_by_charge_from_the_curve():
    seen = [lagging(seed, Kind.VARIABLE, slow_at_some, noise_share=0.3)[0] for seed in (21, 22)]
    resting = replace(seen[0], experiment=replace(seen[0].experiment, current_a=np.zeros(seen[0].soc.size)))
    for runs in (seen, [*seen, resting]):
        assert "lag_at" not in lab_errors(LAB, runs).mean


def slow_at_some(soc):
    """A lag as where particles diffuse slowly at some fillings only: twice it comes, and twice it goes."""
    return 0.04 * np.sin(4.0 * np.pi * soc) ** 2


LAGGING = ((21, Kind.VARIABLE), (22, Kind.VARIABLE), (23, Kind.SLOW))


def lagging(seed, kind, at=lambda soc: 0.015, noise_share=1.0):
    """A recording of a cell at its curve's voltage for less charge than it holds, and what that costs."""
    loud = played(seed, kind=kind)
    clean = replace(loud, misfit_v=noise_share * loud.misfit_v)
    e = replace(loud.experiment, voltage_v=loud.experiment.voltage_v + clean.misfit_v - loud.misfit_v)
    late = followed(e.time_s, e.current_a)[3]
    curve, lag = LAB.cell.open_circuit, at(clean.soc) * late / (2.0 * CAPACITY_C / 3600.0)
    cost = np.asarray(curve(np.maximum(clean.soc - lag, 0.0)) - curve(clean.soc))
    off = clean.misfit_v + cost
    return replace(clean, experiment=replace(e, voltage_v=e.voltage_v + cost), misfit_v=off), cost


def left_of_a_lag(lab, numbers, recording):
    """Of what it costs in a recording, the share that numbers of a form leave unexplained."""
    unseen, cost = recording
    e = unseen.experiment
    shapes = lab.added(followed(e.time_s, e.current_a), e.current_a, unseen.soc)[: numbers.size] / SERIES
    above = unseen.soc > LOW_SOC
    return np.std((numbers @ shapes - cost)[above]) / np.std(cost[above])


def lags_variance(found):
    """Of the sum of all lags."""
    first = BEND_SOC.size + 6 * DROP_SOC.size
    return float(found.covariance[first : first + 6, first : first + 6].sum())


def test_where_no_recording_reaches_nothing_is_known():
    shallow = [
        replace(r, experiment=replace(r.experiment, voltage_v=np.where(r.soc > 0.5, r.experiment.voltage_v, np.nan)))
        for r in recordings(4)
    ]
    found = lab_errors(LAB, shallow)
    told = np.sqrt(np.diag(found.covariance) / np.diag(LAB.form[1]))[: BEND_SOC.size]
    assert told[BEND_SOC < 0.4] == pytest.approx(1.0, abs=0.02)
    assert np.asarray(found.mean["bends"])[BEND_SOC < 0.4] == pytest.approx(0.0, abs=1e-4)
    assert told[(BEND_SOC > 0.6) & (BEND_SOC < 0.9)].max() < 0.6
    empty = [replace(r, soc=np.full(r.soc.size, 0.5 * LOW_SOC)) for r in recordings(4)]
    np.testing.assert_allclose(lab_errors(LAB, empty).covariance, LAB.form[1], atol=1e-12)


def test_a_charge_that_is_a_little_off_at_the_start_is_no_error_of_the_curve():
    """All of a recording's voltages are those of a charge a fifth of a per cent below."""
    ahead = 0.002
    plain = recordings(5)
    moved = [
        replace(r, misfit_v=r.misfit_v + LAB.cell.open_circuit(r.soc - ahead) - LAB.cell.open_circuit(r.soc))
        for r in plain
    ]
    before, after = (np.asarray(lab_errors(LAB, runs).mean["bends"])[4:] for runs in (plain, moved))
    wholly = LAB.cell.open_circuit(BEND_SOC[4:] - ahead) - LAB.cell.open_circuit(BEND_SOC[4:])
    assert np.abs(after - before).max() < 0.7 * np.abs(wholly).max()


def test_a_few_spikes_change_little():
    plain = recordings(6)
    rng = np.random.default_rng(6)
    spiked = [replace(r, misfit_v=r.misfit_v + np.where(rng.random(r.soc.size) < 0.004, 2.0, 0.0)) for r in plain]
    before, after = (lab_errors(LAB, runs) for runs in (plain, spiked))
    sds = np.sqrt(np.diag(before.covariance))
    assert np.mean(np.abs(vector(after) - vector(before)) / sds) < 1.0


def test_flights_are_held_against_what_the_lab_showed(flight):
    """A model's own error is no misfit of its flights any more, and what the lab told no fit may move."""
    wrong = drawn(np.random.default_rng(8))
    found = lab_errors(LAB, recordings(8, wrong))
    plain, known = (lab_of(b, "circ", None, None) for b in (BATTERY, replace(BATTERY, left_open={"circ": found})))
    off = wrong @ LAB.added(followed(flight.time_s, flight.current_a), flight.current_a, soc_of(flight))[:SIZE]
    data = (replace(flight, voltage_v=flight.voltage_v + off),)
    by_plain, by_known = (float(np.std(Joint(lab, data).misfits[0])) for lab in (plain, known))
    assert by_known < 0.6 * by_plain
    joint = Joint(known, data)
    where = slice(joint.places["lab_bends"].start, joint.places["lab_curve"].stop)
    scale = joint.scale[where]
    np.testing.assert_allclose(
        np.linalg.inv(joint.known[where, where]) * np.outer(scale, scale), known.form[1], rtol=1e-6, atol=1e-12
    )
    assert np.all(np.linalg.eigvalsh(known.form[1] - found.covariance) > 0.0)  # in flight it may differ a little
    x = joint.unknowns.start.copy()
    assert joint.pulls(x) == pytest.approx(0.0)
