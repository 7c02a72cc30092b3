"""The predictor app on its own: what it says at a tick, given what it has heard."""

from __future__ import annotations

import pytest

from bhm_service.apps.predictor import PredictorApp, PredictorSettings
from bhm_service.estimation.tracker import Tracker
from bhm_service.messages import (
    BatterySample,
    EndOfDischarge,
    FlightPhase,
    Model,
    PackChange,
    RemainingTime,
    Tick,
)
from bhm_service.prediction.demand import Load
from bhm_service.prediction.end_of_discharge import Limits

LIMITS = Limits(threshold_soc=0.2, cutoff_v=6 * 3.3)


@pytest.fixture
def tracker(generic):
    cell = generic.circ
    return Tracker(Model.CIRC, cell, 6, 16.0 * 3600.0 / cell.c_max, generic.effects("circ"), generic.uncertainty)


def app(tracker, **settings):
    return PredictorApp({Model.CIRC: tracker.pack}, PredictorSettings(limits=LIMITS, **settings))


def flown(tracker, predictor, seconds=60, amps=30.0, begin=0.0):
    track = None
    for k in range(seconds):
        t = begin + float(k)
        volts = 24.6 if k < 3 else 23.6
        sample = BatterySample(
            time_s=t, battery_id=0, voltage_v=volts, current_a=0.2 if k < 3 else amps, temperature_k=None
        )
        if k == 3:
            predictor.on_message(FlightPhase(time_s=t, airborne=True, because="test"))
        predictor.on_message(sample)
        track, estimate = tracker.step(track, sample)
        predictor.on_message(estimate)
    return begin + float(seconds)


def said(predictor, time_s):
    answers = predictor.on_message(Tick(time_s=time_s))
    return {type(a): a for a in answers}


def test_on_the_ground_without_a_known_load_there_is_no_time(tracker):
    predictor = app(tracker)
    now = flown(tracker, predictor, seconds=3)
    answers = said(predictor, now)
    assert EndOfDischarge not in answers
    assert answers[RemainingTime].median_s is None
    assert "load" in answers[RemainingTime].because
    assert answers[RemainingTime].soc is not None


def test_with_momentum_theory_there_is_one(tracker):
    predictor = app(tracker, hover=Load(mean_w=700.0, mean_sd_w=100.0, instant_sd_w=100.0))
    answers = said(predictor, flown(tracker, predictor, seconds=3))
    assert answers[EndOfDischarge].power_w == 700.0
    assert 500.0 < answers[EndOfDischarge].median_s < 2500.0


@pytest.mark.parametrize("over", ["samples", "sigma-points"])
def test_in_flight_the_load_is_the_one_that_is_flown(tracker, over):
    predictor = app(tracker, over=over)
    answers = said(predictor, flown(tracker, predictor))
    prediction = answers[EndOfDischarge]
    assert prediction.power_w == pytest.approx(23.6 * 30.0, rel=0.01)
    assert prediction.low_s < prediction.median_s < prediction.high_s
    assert len(prediction.samples_s) == 100


def test_samples_and_sigma_points_agree(tracker):
    medians = []
    for over in ("samples", "sigma-points"):
        predictor = app(tracker, over=over)
        prediction = said(predictor, flown(tracker, predictor))[EndOfDischarge]
        medians.append((prediction.low_s, prediction.median_s, prediction.high_s))
    assert medians[0] == pytest.approx(medians[1], rel=0.08)


def test_a_wider_spread_of_the_load_widens_the_band(tracker):
    width = {}
    for spread in ("quiet", "1sigma", "3sigma"):
        predictor = app(tracker, load_spread=spread)
        for k in range(200):
            predictor.on_message(FlightPhase(time_s=0.0, airborne=True, because=""))
            predictor.on_message(
                BatterySample(
                    time_s=k / 1.0, battery_id=0, voltage_v=23.6, current_a=30.0 + 8.0 * (-1) ** k, temperature_k=None
                )
            )
        prediction = said(predictor, flown(tracker, predictor, begin=200.0))[EndOfDischarge]
        width[spread] = prediction.high_s - prediction.low_s
    assert width["quiet"] < width["1sigma"] < width["3sigma"]


def test_an_old_estimate_says_nothing_of_now(tracker):
    predictor = app(tracker)
    now = flown(tracker, predictor)
    assert said(predictor, now)[RemainingTime].median_s is not None
    later = said(predictor, now + 60.0)[RemainingTime]
    assert later.median_s is None
    assert later.health == 2


def test_another_pack_is_nothing_known(tracker):
    predictor = app(tracker)
    now = flown(tracker, predictor)
    predictor.on_message(PackChange(time_s=now, because="test"))
    assert said(predictor, now)[RemainingTime].health == 2


def test_voltage_at_the_cut_off_for_some_seconds_is_the_end(tracker):
    predictor = app(tracker)
    now = flown(tracker, predictor)
    for k in range(6):
        predictor.on_message(
            BatterySample(time_s=now + k, battery_id=0, voltage_v=19.0, current_a=30.0, temperature_k=None)
        )
    assert said(predictor, now + 6.0)[RemainingTime].median_s == 0.0
