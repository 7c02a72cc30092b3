"""The assessor on answers and findings made by hand, against numbers worked out otherwise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import beta

from sim.proof.scoring.answers import Answer, Criterion, Moment, Quantity, answer_from_json, answer_to_json
from sim.proof.scoring.findings import Outcome, UnreadableError, findings_from_json, outcome_from_json
from sim.proof.scoring.judge import judge
from sim.proof.scoring.rates import Rate, coverage
from sim.proof.scoring.score import score


def names(*entries):
    return tuple(frozenset(entry.split("+")) for entry in entries)


def answer(*accept, case="c", **more):
    given = {"kind": "k", "truth": frozenset(accept[0].split("+")) - {"none", "unknown"}} | more
    return Answer(case=case, accept=names(*accept), **given)


def raw(verdict, *effects, **more):
    found = {
        "verdict": verdict,
        "effects": [{"id": e, "parameters": {}} if isinstance(e, str) else e for e in effects],
        "alternatives": [],
        "unexplained_rest": 0.0,
        "localisation": [],
        "change_points": [],
        "inferred": [],
        "fit": {"heldout_before_V": 0.2, "heldout_after_V": 0.1},
        "advice": [],
        "battery_file": None,
    }
    return found | more


def said(verdict, *effects, case="c", oracle=None, inferred=None, **more):
    findings = findings_from_json(raw(verdict, *effects, **more))
    return Outcome(case=case, findings=findings, oracle_heldout_v=oracle, inferred=inferred or {}, seconds=1.0)


def row(suite_score, name):
    return next(r for r in suite_score.rows if r.name == name)


@pytest.mark.parametrize(("hits", "n"), [(0, 150), (2, 150), (7, 7), (41, 48)])
def test_intervals_of_rates_are_those_of_clopper_and_pearson(hits, n):
    low, high = Rate(hits, n).interval
    assert low == pytest.approx(beta.ppf(0.025, hits, n - hits + 1) if hits else 0.0)
    assert high == pytest.approx(beta.ppf(0.975, hits + 1, n - hits) if hits < n else 1.0)


def test_honest_intervals_are_covered_as_often_as_they_say():
    z = np.random.default_rng(3).standard_normal(20_000)
    assert coverage(list(z), 0.9).value == pytest.approx(0.9, abs=0.01)
    assert coverage(list(2.0 * z), 0.9).value == pytest.approx(0.589, abs=0.02)  # P(|Z| < 1.645 / 2)


@pytest.mark.parametrize(
    ("truth", "what", "right"),
    [
        (("none",), ("none",), True),
        (("none",), ("parameter",), True),
        (("none",), ("not-excited",), True),
        (("none",), ("named", "capacity-fade"), False),
        (("none",), ("unknown",), False),
        (("unseen-load", "current-offset"), ("sensor-suspect", "current-offset"), True),
        (("unseen-load", "current-offset"), ("named", "unseen-load", "hysteresis"), False),
        (("capacity-fade",), ("none",), False),
        (("capacity-fade+resistance-growth",), ("named", "resistance-growth", "capacity-fade"), True),
        (("capacity-fade+resistance-growth",), ("named", "capacity-fade"), False),
        (("unknown", "intermittent-contact"), ("unknown",), True),
        (("unknown", "intermittent-contact"), ("named", "intermittent-contact"), True),
        (("unknown", "intermittent-contact"), ("named", "weak-cell"), False),
    ],
)
def test_an_answer_is_right_when_it_is_one_of_those_accepted(truth, what, right):
    assert judge(answer(*truth), said(*what)).accepted is right


def test_an_unexplained_rest_flags_what_is_not_in_the_catalogue_and_counts_where_all_is():
    strange = judge(answer("unknown"), said("named", "weak-cell", unexplained_rest=0.6))
    assert strange.flagged
    both = [answer("unknown", case="a"), answer("capacity-fade", case="b")]
    found = score("dev", both, [said("none", case=k, unexplained_rest=0.6) for k in "ab"])
    assert row(found, "out of catalogue: flagged").value == 1.0
    assert row(found, "catalogue suffices: flagged all the same").value == 1.0


def test_the_first_name_counts_for_precision_and_a_companion_as_a_spurious_extra():
    answers = [answer("capacity-fade", case=c) for c in "abcd"]
    outcomes = [
        said("named", "capacity-fade", case="a"),
        said("named", "capacity-fade", "hysteresis", case="b"),
        said("named", "weak-cell", case="c"),
        said("not-excited", case="d"),
    ]
    found = score("dev", answers, outcomes)
    assert row(found, "naming precision, one effect").value == pytest.approx(2 / 3)
    assert row(found, "found, SNR not known").value == pytest.approx(2 / 4)
    assert row(found, "one effect: a spurious extra").value == pytest.approx(2 / 3)


def test_sensitivity_is_counted_in_classes_of_snr():
    snr = {"a": 2.0, "b": 4.0, "c": 5.0, "d": 15.0, "e": 300.0}
    answers = [answer("capacity-fade", case=c, snr=s) for c, s in snr.items()]
    outcomes = [said("named", "capacity-fade", case=c) for c in "ce"] + [said("none", case=c) for c in "abd"]
    found = score("dev", answers, outcomes)
    counted = {n: row(found, f"found at SNR {n}") for n in ("3-5", "5-15", "over 15")}
    assert {n: (r.value, r.n) for n, r in counted.items()} == {"3-5": (0.0, 1), "5-15": (1.0, 1), "over 15": (0.5, 2)}
    assert "capacity-fade" not in found.never_shown
    assert "capacity-fade" in score("dev", answers[:1], outcomes).never_shown


def test_false_alarms_are_held_to_two_in_a_hundred_and_fifty():
    nulls = [answer("none", case=f"{k}") for k in range(150)]
    for alarms, met in ((2, True), (3, False)):
        outcomes = [
            said("named" if k < alarms else "none", *["weak-cell"][: k < alarms], case=f"{k}") for k in range(150)
        ]
        assert row(score("concealed", nulls, outcomes), "false alarms on nulls").met is met


def test_an_ambiguous_set_must_hold_what_was_put_in_and_its_size_counts():
    hidden = answer("unseen-load", "current-offset", ambiguous=True)
    good = judge(hidden, said("ambiguous", "current-offset", alternatives=[["unseen-load"], ["current-offset"]]))
    assert (good.set_holds_truth, good.set_size) == (True, 2)
    assert judge(hidden, said("named", "current-offset")).set_holds_truth is False


def test_parameters_are_compared_in_one_unit_or_not_at_all():
    hidden = answer(
        "capacity-fade", parameters={"capacity-fade": {"fade": Quantity(0.10, "-"), "k": Quantity(1.0, "1/d")}}
    )
    effect = {"id": "capacity-fade", "parameters": {"fade": {"value": 0.11, "sd": 0.01, "unit": "-"},
                                                    "k": {"value": 1.0, "sd": 0.1, "unit": "1/s"}}}  # fmt: skip
    judged = judge(hidden, said("named", effect))
    (p,) = judged.parameters
    assert (p.relative_error, p.z) == (pytest.approx(0.1), pytest.approx(1.0))
    assert any("capacity-fade.k: in 1/s, the answer is in 1/d" in m for m in judged.missing)


def test_what_cannot_be_computed_is_said_and_meets_nothing():
    found = score("concealed", [answer("capacity-fade")], [said("named", "capacity-fade", fit={})])
    ratio = row(found, "held-out RMSE after over before, median")
    assert math.isnan(ratio.value)
    assert "no held-out errors" in ratio.note
    assert row(found, "RFT error after over before, median").met is None
    assert found.open > 0


def test_the_share_of_what_an_oracle_gains_is_of_its_improvement():
    judged = judge(answer("capacity-fade"), said("named", "capacity-fade", oracle=0.08))
    assert judged.measures["share_of_oracle"] == pytest.approx((0.2 - 0.1) / (0.2 - 0.08))


def test_flying_time_is_told_as_a_ratio_of_each_case_and_as_the_errors_themselves():
    """Where an effect hardly changes the flying time the ratio is of two noises: the seconds say what it is worth."""
    times = {"a": (100.0, 10.0), "b": (12.0, 15.0), "c": (200.0, 20.0)}
    answers = [answer("capacity-fade", case=case) for case in times]
    outcomes = [replace(said("named", "capacity-fade", case=case), rft_error_s=t) for case, t in times.items()]
    found = score("concealed", answers, outcomes)
    assert row(found, "RFT error after over before, median").value == pytest.approx(0.1)
    assert row(found, "RFT error before, median [s]").value == pytest.approx(100.0)
    assert row(found, "RFT error after, median [s]").value == pytest.approx(15.0)


def test_change_points_are_found_within_ten_seconds_in_either_clock():
    points = (Moment("01.tlog", 260.0), Moment("01.tlog", 430.0), Moment("03.tlog", 500.0))
    hidden = answer("unknown", change_points=points, starts_s={"01.tlog": 1.7e9, "03.tlog": 1.8e9})
    given = [
        {"flight": "01", "time_s": 269.0},
        {"flight": "01.tlog", "time_s": 1.7e9 + 441.0},
        {"flight": "flights/03.tlog", "time_s": 1.8e9 + 495.0},
    ]
    assert judge(hidden, said("unknown", change_points=given)).measures["change_points_found"] == pytest.approx(2 / 3)


def test_localisation_is_the_overlap_of_the_samples_pointed_at_and_affected():
    soc = [0.9, 0.7, 0.5, 0.3, 0.1]
    samples = {f: {"soc": tuple(soc), "affected": (0.0, 0.0, 0.0, 1.0, 1.0)} for f in ("00.tlog", "01.tlog")}
    region = {"where": {"soc": [0.0, 0.6]}, "flights": ["00"], "share_of_misfit": 0.5, "sign": -1}
    judged = judge(answer("weak-cell", samples=samples), said("named", "weak-cell", localisation=[region]))
    assert judged.measures["iou"] == pytest.approx(2 / 5)  # in 00 two of three, in 01 none of two
    elsewhere = {**region, "where": {"moon_phase": [0.0, 0.5]}}
    judged = judge(answer("weak-cell", samples=samples), said("named", "weak-cell", localisation=[elsewhere]))
    assert "iou" not in judged.measures
    assert any("moon_phase" in m for m in judged.missing)


def test_a_withheld_temperature_is_compared_with_what_was_inferred():
    t = np.arange(0.0, 600.0, 10.0)
    truth = 280.0 + 10.0 * t / 600.0
    warmer = truth + 3.0 + np.where(t > 0.0, 2.0, 0.0)
    hidden = answer(
        "self-heating",
        hidden={"00.tlog": {"time_s": tuple(t), "temperature_K": tuple(truth)}},
        starts_s={"00.tlog": 1.7e9},
        criteria=(
            Criterion("hidden.temperature_K.change_rmse", at_most=2.0),
            Criterion("hidden.temperature_K.r", at_least=0.9),
        ),
    )
    found = {"00": {"time_s": tuple(1.7e9 + t), "temperature_K": tuple(warmer)}}
    judged = judge(hidden, said("named", "self-heating", inferred=found))
    measures = {k.removeprefix("hidden.temperature_K."): v for k, v in judged.measures.items() if "hidden" in k}
    after = (t.size - 1) / t.size  # of the samples, all but the first
    expected = {
        "rmse": np.sqrt(9.0 + 16.0 * after),
        "bias": 3.0 + 2.0 * after,
        "r": np.corrcoef(truth, warmer)[0, 1],
        "change_rmse": 2.0 * np.sqrt(after),
        "rise_error": 2.0,
    }
    assert measures == pytest.approx(expected)
    assert [met for *_, met in judged.criteria] == [True, True]
    silent = judge(hidden, said("named", "self-heating"))
    assert [(value, met) for _, _, value, met in silent.criteria] == [(None, False), (None, False)]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"verdict": "probably"}, "probably"),
        ({"effects": [{"name": "x"}]}, "KeyError"),
        ({"alternatives": None}, "TypeError"),
    ],
)
def test_findings_that_are_not_what_the_interface_says_are_a_failure_with_its_reason(change, words):
    with pytest.raises(UnreadableError, match=words):
        findings_from_json(raw("none") | change)
    outcome = outcome_from_json({"case": "c", "findings": raw("none") | change})
    judged = judge(answer("none"), outcome)
    assert not judged.accepted
    assert words in judged.failure


def test_a_key_that_is_missing_is_named():
    given = raw("none")
    del given["localisation"]
    with pytest.raises(UnreadableError, match="lacks localisation"):
        findings_from_json(given)


def test_a_case_that_nobody_answered_is_a_failure_and_no_credit():
    found = score("concealed", [answer("none"), answer("capacity-fade", case="d", snr=20.0)], [])
    assert row(found, "no answer at all").value == 1.0
    assert row(found, "found at SNR over 15").met is False
    assert row(found, "cases answered right").value == 0.0


def test_an_answer_survives_being_written():
    hidden = answer(
        "capacity-fade+weak-cell", "self-heating", snr=4.0, group="g", note="n",
        parameters={"capacity-fade": {"fade": Quantity(0.1, "-")}},
        change_points=(Moment("a", 1.0),), starts_s={"a": 5.0},
        samples={"a": {"soc": (1.0,), "affected": (1.0,)}}, hidden={"a": {"time_s": (0.0,), "x_K": (1.0,)}},
        criteria=(Criterion("heldout_ratio", at_most=0.5),),
    )  # fmt: skip
    assert answer_from_json(answer_to_json(hidden)) == hidden


def test_coverage_counts_every_interval_that_was_given_and_needs_twenty():
    hidden = {"capacity-fade": {"fade": Quantity(0.10, "1")}}
    answers = [answer("capacity-fade", case=f"{k}", parameters=hidden) for k in range(40)]

    def found(k, sd):
        fade = {"value": 0.115 if k % 2 else 0.09, "sd": sd, "unit": "1"}
        return said("named", {"id": "capacity-fade", "parameters": {"fade": fade}}, case=f"{k}")

    wide = score("exam", answers, [found(k, 0.01 if k < 36 else 0.001) for k in range(40)])
    assert row(wide, "coverage of 90 % intervals").value == pytest.approx(36 / 40)
    assert row(wide, "coverage of 90 % intervals").met is True
    assert (
        row(score("exam", answers[:19], [found(k, 0.01) for k in range(19)]), "coverage of 90 % intervals").met is None
    )
    narrow = score("exam", answers, [found(k, 0.001) for k in range(40)])
    assert row(narrow, "coverage of 90 % intervals").met is False


def test_permitted_names_count_neither_way():
    hidden = answer("capacity-fade", permitted=frozenset({"climb-power"}))
    assert judge(hidden, said("named", "climb-power", "capacity-fade")).first_right
    assert judge(hidden, said("named", "climb-power", "capacity-fade")).extra is False
    null = answer("none", permitted=frozenset({"climb-power"}))
    assert not judge(null, said("named", "climb-power")).claims
    assert judge(null, said("named", "climb-power", "weak-cell")).claims
