import math

from bhm_service.apps.publisher import PublisherApp
from bhm_service.messages import AutopilotClock, Ending, EndOfDischarge, Model, RemainingTime, StateEstimate


def fused(time_s=100.0, **changes):
    numbers = {
        "median_s": 500.0, "low_s": 400.0, "high_s": 600.0, "soc": 0.7, "soe": 0.65, "weights": (),
        "ending": Ending.SOC, "health": 0,
    }  # fmt: skip
    return RemainingTime(time_s=time_s, **(numbers | changes))


def estimate(model, time_s=100.0, valid=True):
    return StateEstimate(
        time_s=time_s, model=model, valid=valid, soc=0.7, soc_sd=0.02, soc_low=0.66, soc_high=0.74, soe=0.65,
        voltage_expected_v=None, voltage_expected_sd_v=None, voltage_measured_v=None, nis=None, rejected=None, mean=(),
        covariance=(),
    )  # fmt: skip


def prediction(model, time_s=100.0):
    return EndOfDischarge(
        time_s=time_s, model=model, median_s=490.0, low_s=400.0, high_s=600.0, ending=Ending.SOC, power_w=500.0,
        samples_s=(),
    )  # fmt: skip


def named(messages):
    publisher = PublisherApp()
    values = [v for m in messages for v in publisher.on_message(m)]
    return {v.name: v.value for v in values}, values


def test_everything_that_is_known_is_said_under_its_name():
    heard = [m for model in Model for m in (estimate(model), prediction(model))]
    names, values = named([*heard, fused()])
    assert names == {
        "BHM_RFT": 500.0, "BHM_RFTLO": 400.0, "BHM_RFTHI": 600.0, "BHM_SOC": 0.7, "BHM_SOE": 0.65,
        "RFT_CIRC": 490.0, "RFT_CHEM": 490.0, "SOC_CIRC": 0.7, "SOC_CHEM": 0.7, "BHM_HLTH": 0.0,
    }  # fmt: skip
    assert all(len(v.name) <= 9 and v.name.isascii() and v.name == v.name.upper() for v in values)


def test_what_is_not_known_is_not_said():
    names, _ = named([fused(median_s=None, low_s=None, high_s=None, soc=None, soe=None, health=2)])
    assert names == {"BHM_HLTH": 2.0}


def test_old_or_invalid_estimates_and_predictions_are_not_said():
    old = [estimate(Model.CIRC, 60.0), prediction(Model.CIRC, 99.0), estimate(Model.CHEM, valid=False)]
    names, _ = named([*old, fused()])
    assert not {"SOC_CIRC", "RFT_CIRC", "SOC_CHEM", "RFT_CHEM"} & set(names)


def test_times_are_on_the_autopilots_clock_and_wrap_with_it():
    _, values = named([AutopilotClock(time_s=40.0, boot_s=12.5), fused()])
    assert {v.boot_ms for v in values} == {72_500}
    _, values = named([AutopilotClock(time_s=99.0, boot_s=4294967.0), fused()])
    assert all(0 <= v.boot_ms < 2**32 for v in values)


def test_a_number_that_is_none_is_not_said():
    names, _ = named([fused(median_s=math.nan, high_s=math.inf)])
    assert names == {"BHM_RFTLO": 400.0, "BHM_SOC": 0.7, "BHM_SOE": 0.65, "BHM_HLTH": 0.0}
