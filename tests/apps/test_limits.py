from itertools import pairwise

import pytest

from bhm_service.apps.limits import LimitsApp, Reserves
from bhm_service.messages import Ending, FlightPhase, PackChange, RemainingTime, Severity

RESERVES = Reserves(warning_s=180.0, critical_s=90.0, landing_soc=0.20)


def fused(time_s, median_s=None, soc=None):
    return RemainingTime(
        time_s=time_s, median_s=median_s, low_s=median_s, high_s=median_s, soc=soc, soe=soc, weights=(),
        ending=Ending.SOC, health=0,
    )  # fmt: skip


def phase(airborne, time_s=0.0):
    return FlightPhase(time_s=time_s, airborne=airborne, because="")


def said(messages, app=None):
    app = LimitsApp(RESERVES) if app is None else app
    return [text for message in messages for text in app.on_message(message)]


def flown(medians, socs=None, begin=1.0):
    return [
        fused(begin + k, median, None if socs is None else socs[k]) for k, median in enumerate(medians)
    ]  # fmt: skip


def test_each_reserve_is_told_once_on_the_way_down():
    texts = said([phase(True), *flown([float(s) for s in range(400, 0, -1)])])
    assert [t.severity for t in texts] == [Severity.WARNING, Severity.CRITICAL]
    assert texts[0].text == "Battery: 2:58 flying time left"
    assert texts[1].text == "Battery: land now, 1:28 flying time left"
    assert all(len(t.text) <= 50 and t.text.isascii() for t in texts)


def test_a_prediction_that_wavers_about_a_reserve_is_told_once():
    wavering = [185.0 + (8.0 if k // 4 % 2 else -8.0) for k in range(200)]
    assert [t.severity for t in said([phase(True), *flown(wavering)])] == [Severity.WARNING]


def test_a_single_low_value_is_not_a_reserve():
    assert said([phase(True), *flown([600.0, 600.0, 60.0, 600.0, 600.0])]) == []


def test_a_reserve_may_be_told_again_after_the_time_was_well_above_it():
    texts = said([phase(True), *flown([100.0] * 5 + [400.0] * 5 + [100.0] * 5)])
    assert [t.severity for t in texts] == [Severity.WARNING, Severity.WARNING]


def test_a_fall_beyond_both_reserves_at_once_says_only_that_landing_is_due():
    texts = said([phase(True), *flown([600.0] * 3 + [30.0] * 10)])
    assert [t.severity for t in texts] == [Severity.CRITICAL]


def test_the_charge_at_which_landing_is_due_is_told_without_any_time():
    texts = said([phase(True), *(fused(float(k), None, 0.25 - 0.01 * k) for k in range(12))])
    assert [(t.severity, t.text) for t in texts] == [(Severity.CRITICAL, "Battery: land now, 18 % charge left")]


def test_nothing_is_told_for_values_that_are_not_known_or_on_the_ground():
    assert said([phase(True), *(fused(float(k)) for k in range(30))]) == []
    assert said(flown([30.0] * 20, [0.1] * 20)) == []
    assert said([phase(True), phase(False, 1.0), *flown([30.0] * 20, [0.1] * 20, begin=2.0)]) == []


def test_a_value_before_a_silence_does_not_count_for_one_after_it():
    assert said([phase(True), fused(1.0, 100.0), fused(100.0, 100.0)]) == []


@pytest.mark.parametrize("fresh", [phase(True, 50.0), PackChange(time_s=50.0, because="")])
def test_another_flight_or_another_pack_is_told_of_anew(fresh):
    texts = said([phase(True), *flown([100.0] * 5), fresh, *flown([100.0] * 5, begin=60.0)])
    assert len(texts) == 2
    assert all(a.time_s < b.time_s for a, b in pairwise(texts))


def test_what_was_told_before_a_restart_is_not_told_again():
    before, after = LimitsApp(RESERVES), LimitsApp(RESERVES)
    assert len(said([phase(True), *flown([100.0] * 5)], before)) == 1
    after.restore(before.state())
    assert said(flown([100.0] * 20, begin=10.0), after) == []
