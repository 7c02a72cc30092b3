import re
from dataclasses import replace

import numpy as np
import pytest
from battery.effects.plausible import sizes
from discrepancy.made import NOISE, SERIES, course, flight, flown, lab, si

from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.pack import PackModel
from bhm_service.discrepancy.as_flown import moved_of
from bhm_service.discrepancy.candidate import candidates
from bhm_service.discrepancy.findings import EffectFound, Findings, Fit, Region
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.labels import flights_in_words
from bhm_service.discrepancy.sidecar import Notes
from bhm_service.discrepancy.steps import Episode, contact_candidate
from bhm_service.discrepancy.toll import tolls
from bhm_service.discrepancy.words import effect_in_words, region_in_words, sentence, values_of

COLD_AND_MILD = [flown(flight(1, 5.0)), flown(flight(2, 24.0)), flown(flight(3, 25.0))]


def said(effect_id, values, flights=None):
    flights = COLD_AND_MILD if flights is None else flights
    return effect_in_words(effect_id, values, lab(), flights, [course(f) for f in flights])


def findings(verdict="named", ids=("resistance-temperature",), decoys=1.0, **changes):
    effects = [
        EffectFound(
            id=name, parameters={}, evidence_nats=50.0, p_familywise=0.005, share_of_misfit=0.9, decoys_beaten=decoys
        )
        for name in ids
    ]
    held = Fit(rmse_before_V=0.2, rmse_after_V=0.02, heldout_before_V=0.174, heldout_after_V=0.088, noise_floor_V=0.012)
    given = {
        "alternatives": [], "unexplained_rest": 0.0, "localisation": [], "change_points": [], "inferred": [],
        "fit": held, "advice": [], "battery_file": None,
    }  # fmt: skip
    return Findings(verdict=verdict, effects=effects, **(given | changes))


# ---- sizes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("effect_id", EFFECTS)
def test_every_effect_of_the_catalogue_says_its_size_in_a_sentence(effect_id):
    kind = EFFECTS[effect_id]
    told = {p.name: p.scale for p in kind.parameters()}
    values = {name: value / told[name] for name, value in sizes(kind).items()}
    text = said(effect_id, values)
    assert re.fullmatch(r"[A-Z0-9].*\d.*\.", text)
    assert "nan" not in text


def test_a_cold_packs_resistance_is_told_at_the_coldest_take_off():
    # exp(22 kJ/mol / R (1/278.15 K - 1/298.15 K)) = 1.89
    text = said("resistance-temperature", {"activation_energy": 22.0})
    assert re.fullmatch(
        r"At 5 degC the pack has 1\.9 times the resistance that it has at 25 degC; this cost 0\.\d to 0\.\d V from "
        r"take-off to landing on flight 01\.", text,
    )  # fmt: skip


def test_slower_charge_transfer_is_told_by_what_the_drop_of_both_electrodes_is_larger_by():
    sizes_ = {"speed": 0.4, "bend": 2.5, "straight": 1.0, "other": 0.7}
    text = said("charge-transfer", sizes_)
    amps, told = (float(v) for v in re.search(r"at (\d+) A the drop is (\d+) mV larger", text).groups())
    time_s, current_a = np.arange(3.0), np.full(3, amps)
    plain, slower = (
        PackModel(lab().cell, lab().series, lab().parallel, effects).simulate(time_s, current_a, 0.8).voltage
        for effects in ((), (EFFECTS["charge-transfer"](**sizes_),))
    )
    assert 1e-3 * told == pytest.approx(float(np.ravel(plain - slower)[-1]), rel=0.03)


def test_a_pack_that_starts_at_the_labs_temperature_is_told_of_where_it_has_warmed_up():
    mild = [flown(flight(k, c)) for k, c in ((1, 24.0), (2, 25.0))]
    warming = [replace(f, temperature_k=f.temperature_k + np.linspace(0.0, 16.0, f.time_s.size)) for f in mild]
    # exp(22 kJ/mol / R (1/314.15 K - 1/298.15 K)) = 0.64
    text = said("resistance-temperature", {"activation_energy": 22.0}, warming)
    assert text.startswith("At 41 degC the pack has 0.64 times the resistance that it has at 25 degC; ")


def test_temperature_that_no_sensor_told_is_taken_from_what_was_inferred_and_said_with_its_band():
    bare = [flown(flight(k, c)) for k, c in ((1, 5.0), (2, 24.0))]
    told = [course(f) for f in bare]
    hidden = [
        type(c)(type(f)(**{n: getattr(f, n) for n in f.__dataclass_fields__} | {"temperature_k": None}),
                c.before_v, c.after_v, c.soc, {"temperature": (f.temperature_k, np.full(f.time_s.size, 3.0))})
        for c, f in zip(told, bare, strict=True)
    ]  # fmt: skip
    text = effect_in_words("resistance-temperature", {"activation_energy": 22.0}, lab(), bare, hidden)
    recorded = effect_in_words("resistance-temperature", {"activation_energy": 22.0}, lab(), bare, told)
    assert text == recorded.replace("5 degC the pack", "5 degC (inferred, ± 3 K) the pack", 1)


def test_what_comes_with_age_is_told_as_it_is_at_the_oldest_flight():
    aged = [replace(f, notes=Notes(cycles=c)) for f, c in zip(COLD_AND_MILD, (20, 286, 143), strict=True)]
    assert said("capacity-fade", {"fade": 0.09, "settled": 0.2}, aged).startswith("The pack holds 91 % of the charge")
    assert "1.5 times the resistance" in said("resistance-growth", {"growth": 0.5, "settled": 0.0}, aged)


@pytest.mark.parametrize(
    ("tilt", "told"),
    [
        (0.5, "rises by 0.9 mV when full and falls by 1.5 mV at 20 % of charge"),
        (0.2, "stays when full and falls by 1.0 mV at 20 % of charge"),
        (0.0, "falls by 0.6 mV"),
    ],
)
def test_what_differs_with_charge_is_told_of_a_full_pack_and_a_low_one(tilt, told):
    text = said("entropic-voltage", {"slope": -0.1, "tilt": tilt})
    assert text.startswith(f"With every kelvin that it is warmer the resting voltage of the pack {told}")


def test_a_contacts_cost_is_its_resistance_times_the_current():
    paid = tolls("contact-resistance", {"resistance": 9.0}, lab(), COLD_AND_MILD, [course(f) for f in COLD_AND_MILD])
    for toll, data in zip(paid, COLD_AND_MILD, strict=True):
        first = (data.time_s >= 30.0) & (data.time_s <= 90.0)
        assert toll.takeoff_v == pytest.approx(9e-3 * data.current_a[first].mean(), rel=1e-9)


def test_a_start_with_less_charge_is_charged_with_the_open_circuit_curve():
    data = flight(1)
    started = course(data, [si("partial-charge", {"deficit": 0.1})])
    (toll,) = tolls("partial-charge", {"deficit": np.array([0.1])}, lab(), [data], [started])
    # At full charge the curve falls by 0.1 V a cell over a tenth or so; the first minute is all flown up there.
    curve = lab().cell.open_circuit
    first = (data.time_s >= 30.0) & (data.time_s <= 90.0)
    expected = SERIES * np.mean(curve(started.soc[first] + 0.1) - curve(started.soc[first]))
    assert toll.takeoff_v == pytest.approx(expected, rel=0.05)


def test_numbers_of_single_flights_are_told_of_their_flight():
    flights = [flown(flight(1)), flown(flight(2))]
    courses = [course(f, soc=start) for f, start in zip(flights, (0.98, 0.85), strict=True)]
    text = effect_in_words("partial-charge", {"deficit": np.array([0.02, 0.15])}, lab(), flights, courses)
    assert text.startswith("Flight 02 started with 15 % less charge than assumed; all flights started between 85 and")


def test_a_capacity_is_told_in_ampere_hours():
    assert "91 % of the charge that it held in the lab: 4.55 Ah in place of 5 Ah" in said(
        "capacity-fade", {"fade": 0.09}
    )
    with_area = said("capacity-fade", {"fade": 0.2, "area": 0.5})
    assert "80 % of the charge" in with_area and "and has 11 % more resistance" in with_area


def test_a_sensor_is_told_by_what_flows_when_it_reads_a_hover():
    assert "reads 4.8 % too low: where it says 22.1 A, 23.2 A flow" in said("current-gain", {"gain": 0.05})


@pytest.mark.parametrize(
    ("idle_a", "told"), [(-1.7, "2.0 A too low at all times: -1.7 A before the load"), (0.3, "times;")]
)
def test_a_zero_that_is_off_is_shown_where_a_sensor_reads_less_than_nothing(idle_a, told):
    """What drops then is told after it, as of all effects."""
    idle = [replace(f, current_a=np.where(f.time_s < 30.0, idle_a, 22.0)) for f in COLD_AND_MILD]
    assert told in said("current-offset", {"offset": 2.0}, idle)


def test_every_episode_of_a_contact_is_told_with_its_times():
    values = {
        "resistance": np.array([10.0, 5.0]),
        "begin": np.array([[0.0, 60.0, 0.0], [120.0, 0.0, 0.0]]),
        "end": np.array([[0.0, 100.0, 0.0], [1e6, 0.0, 0.0]]),
    }
    text = said("intermittent-contact", values)
    assert "10.0 mohm more from 1:00 to 1:40 of flight 02" in text
    assert "5.0 mohm more from 2:00 to the end of flight 01" in text


def test_an_effect_too_small_to_matter_costs_nothing_in_words():
    assert "cost" not in said("contact-resistance", {"resistance": 0.1})


def test_values_of_a_fit_are_in_declared_units_and_one_a_flight_where_flights_differ():
    flights = (flight(1), flight(2))
    members = tuple(c for c in candidates(flights, "circ", 100.0)[0] if c.id in ("hysteresis", "partial-charge"))
    joint = Joint(lab(), flights, members)
    x = joint.unknowns.start.copy()
    for name, numbers in {
        "hysteresis.amplitude": 21.0, "hysteresis.reach": np.log(0.07), "partial-charge.deficit": [0.12, 0.05],
        "lab_resistance": np.log(1.18),
    }.items():  # fmt: skip
        x[joint.unknowns.slice_of(name)] = numbers
    fitted = Fitted(
        joint=joint, noise=NOISE, x=x, cost=0.0, rows=[], curvature=np.eye(x.size), gradient=np.zeros(x.size)
    )
    assert values_of(fitted, "hysteresis") == pytest.approx({"amplitude": 21.0, "reach": 0.07, "begin": -0.5})
    assert values_of(fitted, "partial-charge")["deficit"] == pytest.approx([0.12, 0.05])
    assert moved_of(fitted) == pytest.approx({"resistance": 0.18, "capacity": 0.0})


def test_episodes_of_a_contact_keep_their_times_and_flights():
    flights = tuple(flown(flight(k)) for k in (1, 2))
    found = [Episode(0, 60.0, 100.0, 0.01, 3.0, open_end=False), Episode(1, 120.0, 200.0, 0.01, 3.0, open_end=True)]
    for count, words in ((1, "1:00 to 1:40 of flight 01"), (2, "2:00 to the end of flight 02")):
        joint = Joint(lab(), flights, (contact_candidate(found[:count], 2),))
        x = joint.unknowns.start
        fitted = Fitted(
            joint=joint, noise=NOISE, x=x, cost=0.0, rows=[], curvature=np.eye(x.size), gradient=np.zeros(x.size)
        )
        text = effect_in_words(
            "intermittent-contact", values_of(fitted, "intermittent-contact"), lab(), flights,
            [course(f) for f in flights],
        )  # fmt: skip
        assert words in text


# ---- sentences ------------------------------------------------------------------------------------------------------


def test_a_named_effect_is_said_with_what_it_does_on_flights_that_no_fit_saw():
    assert sentence(findings(), 6) == (
        "The battery file leaves out physics: resistance follows temperature; on flights that no fit saw the voltage "
        "error falls from 174 mV to 88 mV."
    )


def test_what_the_files_own_numbers_would_do_alone_is_not_laid_on_the_effect():
    assert "falls from 174 mV to 88 mV (120 mV with the file's own numbers adjusted and no effect)." in sentence(
        findings(), 6, tuned_v=0.12
    )
    assert "adjusted" not in sentence(findings(), 6, tuned_v=0.15)


def test_a_battery_that_needs_other_numbers_is_not_said_to_explain_the_flights_as_it_stands():
    text = sentence(findings("none", ids=()), 6, {"resistance": 0.002, "capacity": -0.041})
    assert text == (
        "Nothing is missing that these 6 flights could show: the battery file explains their voltage to 20 mV once its "
        "numbers are adjusted within what a lab leaves open (its capacity is 4 % lower); as it stands, to 200 mV."
    )
    close = Fit(rmse_before_V=0.02, rmse_after_V=0.015, heldout_before_V=0.02, heldout_after_V=0.02, noise_floor_V=0.01)
    assert sentence(findings("none", ids=(), fit=close), 6).endswith("explains their voltage to 15 mV.")


def test_an_explanation_that_does_not_predict_better_says_so():
    same = Fit(rmse_before_V=0.02, rmse_after_V=0.01, heldout_before_V=0.02, heldout_after_V=0.021, noise_floor_V=0.01)
    assert "on flights that no fit saw the voltage error stays what it was, 21 mV" in sentence(findings(fit=same), 6)


@pytest.mark.parametrize("verdict", ["parameter", "unknown"])
def test_where_no_effect_is_found_what_the_files_own_numbers_do_is_told(verdict):
    same = Fit(rmse_before_V=0.1, rmse_after_V=0.1, heldout_before_V=0.109, heldout_after_V=0.109, noise_floor_V=0.01)
    found = findings(verdict, ids=(), fit=same)
    moved = "the voltage error falls from 109 mV to 14 mV with the file's own numbers adjusted and no effect"
    assert f"on flights that no fit saw {moved}" in sentence(found, 6, tuned_v=0.014)
    assert "stays what it was, 109 mV" in sentence(found, 6, tuned_v=0.1)
    assert "stays what it was, 109 mV" in sentence(found, 6)


def test_with_too_few_flights_the_sentence_does_not_speak_of_held_out_ones():
    few = Fit(rmse_before_V=0.2, rmse_after_V=0.02, heldout_before_V=None, heldout_after_V=None, noise_floor_V=0.01)
    text = sentence(findings(fit=few), 2)
    assert "no fit saw" not in text
    assert "on the flights themselves" in text


def test_what_cannot_be_told_apart_is_said_to_be_so():
    text = sentence(findings("ambiguous", alternatives=[["contact-resistance"], ["resistance-growth"]]), 6)
    assert "cannot tell which: resistance follows temperature, or more resistance in wires and connectors, or " in text


def test_a_name_that_phantoms_match_is_only_perhaps():
    assert "perhaps this: resistance follows temperature; but" in sentence(findings("ambiguous", decoys=0.5), 6)


def test_moved_numbers_of_the_pack_are_named_with_their_shift():
    text = sentence(findings("parameter", ids=()), 6, {"resistance": 0.18, "capacity": 0.001})
    assert "as the battery file says: its resistance is 18 % higher;" in text


@pytest.mark.parametrize(
    ("verdict", "ids", "words"),
    [
        ("none", (), "Nothing is missing that these 6 flights could show"),
        ("unknown", (), "no effect of the catalogue explains it"),
        ("not-excited", (), "too much alike to show it"),
        ("sensor-suspect", ("current-gain",), "Suspect a sensor before the battery: the current sensor's scale is off"),
    ],
)
def test_every_verdict_has_its_sentence(verdict, ids, words):
    assert words in sentence(findings(verdict, ids=ids), 6)


def test_what_stays_unexplained_is_said():
    assert sentence(findings(unexplained_rest=0.23), 6).endswith("; 23 % of the misfit stays unexplained.")


def test_what_is_left_is_the_reason_where_nothing_has_a_name_and_the_rest_where_something_has():
    left = "from 04.tlog on the voltage follows the load later than before"
    assert f"explains it: {left}; on flights" in sentence(findings("unknown", ids=()), 6, left=left)
    assert sentence(findings(), 6, left=left).endswith(f"; {left}.")


# ---- regions and flights --------------------------------------------------------------------------------------------


def test_a_region_is_told_with_units_flights_and_side():
    region = Region(
        where={"temperature_C": (1.0, 10.0), "since_takeoff_s": (0.0, 240.0)},
        flights=["00.tlog"], share_of_misfit=0.62, sign=-1,
    )  # fmt: skip
    assert region_in_words(region, ["00.tlog", "01.tlog"]) == (
        "62 % of the misfit lies at pack temperature 1 to 10 degC and time since take-off 0.0 to 4.0 min, on flight "
        "00, measured below modelled"
    )


@pytest.mark.parametrize(
    ("chosen", "words"),
    [
        ([0, 1, 2, 3, 4, 5], "every flight"),
        ([3], "flight 3"),
        ([1, 2, 3], "flights 1 to 3"),
        ([0, 2, 5], "flights 0, 2 and 5"),
        ([0, 1, 2, 3, 5], "5 of 6 flights"),
    ],
)
def test_flights_are_told_shortly(chosen, words):
    every = [f"{k}.tlog" for k in range(6)]
    assert flights_in_words([every[k] for k in chosen], every) == words
