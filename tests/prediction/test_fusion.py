import numpy as np
import pytest

from bhm_service.messages import Ending, EndOfDischarge, Model, StateEstimate
from bhm_service.prediction.fusion import Voice, fuse


def voice(model, median, error_v, soc=0.6, width=100.0):
    samples = np.random.default_rng(12).normal(median, width, 100)
    low, middle, high = np.quantile(samples, (0.05, 0.5, 0.95))
    prediction = EndOfDischarge(
        time_s=10.0, model=model, median_s=middle, low_s=low, high_s=high, ending=Ending.SOC, power_w=250.0,
        samples_s=tuple(samples),
    )  # fmt: skip
    estimate = StateEstimate(
        time_s=10.0, model=model, valid=True, soc=soc, soc_sd=0.02, soc_low=soc - 0.03, soc_high=soc + 0.03,
        soe=soc * 0.9, voltage_expected_v=22.0, voltage_expected_sd_v=0.05, voltage_measured_v=22.0, nis=0.0,
        rejected=None, mean=(), covariance=(),
    )  # fmt: skip
    return Voice(estimate=estimate, prediction=prediction, error_v=error_v)


def test_two_that_agree_say_the_same_together():
    both = fuse(10.0, [voice(Model.CIRC, 600, 0.005), voice(Model.CHEM, 600, 0.005)], 2, at_cutoff=False)
    assert both.median_s == pytest.approx(600.0, abs=15.0)
    assert both.health == 0


def test_the_one_that_predicts_the_voltage_better_counts_more():
    good, bad = voice(Model.CIRC, 500, 0.004), voice(Model.CHEM, 900, 0.040)
    both = fuse(10.0, [good, bad], 2, at_cutoff=False)
    assert dict(both.weights)[Model.CIRC] > 0.9
    assert both.median_s < 560.0


def test_where_they_differ_the_band_covers_both_and_it_says_so():
    low, high = voice(Model.CIRC, 400, 0.005, width=20), voice(Model.CHEM, 800, 0.005, width=20)
    both = fuse(10.0, [low, high], 2, at_cutoff=False)
    assert both.low_s < 420.0
    assert both.high_s > 780.0
    assert both.health == 1
    assert "disagree" in both.because


@pytest.mark.parametrize("errors", [(0.004, 0.004), (0.004, 0.03), (0.03, 0.004)])
def test_it_is_never_more_optimistic_than_the_evidence(errors):
    circ, chem = voice(Model.CIRC, 400, errors[0]), voice(Model.CHEM, 800, errors[1])
    both = fuse(10.0, [circ, chem], 2, at_cutoff=False)
    weights = dict(both.weights)
    mean = weights[Model.CIRC] * circ.prediction.median_s + weights[Model.CHEM] * chem.prediction.median_s
    assert both.median_s <= mean + 1e-9
    assert both.high_s <= chem.prediction.high_s + 50.0


def test_a_pack_at_its_cut_off_has_nothing_left_whatever_the_models_say():
    both = fuse(10.0, [voice(Model.CIRC, 600, 0.005), voice(Model.CHEM, 600, 0.005)], 2, at_cutoff=True)
    assert (both.low_s, both.median_s, both.high_s) == (0.0, 0.0, 0.0)
    assert both.ending is Ending.VOLTAGE


def test_one_model_alone_is_a_degraded_answer_and_none_is_none():
    alone = fuse(10.0, [voice(Model.CHEM, 600, 0.005)], 2, at_cutoff=False)
    assert alone.median_s is not None
    assert alone.health == 1
    nothing = fuse(10.0, [], 2, at_cutoff=False)
    assert nothing.median_s is None
    assert nothing.health == 2
