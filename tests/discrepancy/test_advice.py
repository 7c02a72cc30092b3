"""What to fly next: what is advised settles what it is said to settle, when it is flown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import base, catalogue, flown, searching

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.advice import advice
from bhm_service.discrepancy.decoys import contests
from bhm_service.discrepancy.first_order import expected_snr
from bhm_service.discrepancy.manoeuvres import MENU
from bhm_service.discrepancy.odds import LEAST_SNR
from bhm_service.discrepancy.search import Search, search
from bhm_service.discrepancy.selection import NOTHING, Selection

WARMTH = frozenset({"resistance-temperature"})
COLD, DEEP = "Start with the pack soaked at 5 degC", "Hover down to 15 % of charge"


def warm(number, kelvin=288.0):
    return flown([EFFECTS["resistance-temperature"](activation_energy=22e3)], seed=3, number=number, kelvin=kelvin)


def contested(flights):
    found = searching(flights, WARMTH)
    return found, contests(found, WARMTH, np.random.default_rng(1))


@pytest.fixture(scope="module")
def alike():
    """Flights as warm as each other: any of them has the temperature of any other."""
    return tuple(warm(k) for k in range(4))


def test_a_driver_that_no_flight_told_from_others_is_told_by_what_is_advised(alike):
    found, rivals = contested(alike)
    shuffled = [c for c in rivals if "other flights" in c.decoy]
    assert not any(c.beaten for c in shuffled)
    said = advice(found, Selection(WARMTH, (), {}, {}), "ambiguous", (), rivals)
    (line,) = [line for line in said if "other flights" in line]
    assert line.startswith(COLD)
    _, after = contested((*alike, warm(4, 278.0 - 8.0)))
    assert all(c.beaten for c in after if "other flights" in c.decoy)


def test_each_phantom_that_is_not_beaten_is_in_one_line_and_those_that_are_in_none(alike):
    found, rivals = contested(alike)
    said = " ".join(advice(found, Selection(WARMTH, (), {}, {}), "ambiguous", (), rivals))
    assert {c.decoy: said.count(c.decoy) for c in rivals} == {c.decoy: int(not c.beaten) for c in rivals}
    assert any(c.beaten for c in rivals)


FADE, WEAK = frozenset({"capacity-fade"}), frozenset({"weak-cell"})


@pytest.mark.parametrize(("names", "rival"), [(FADE, WEAK), (WEAK, FADE)])
def test_single_cells_tell_a_weak_one_from_its_rivals_on_any_flight(names, rival):
    """But for where they have been recorded already, or both explanations have it."""
    found = searching([flown((), seed=4, number=k) for k in range(3)], names | rival)
    (line,) = [s for s in advice(found, Selection(names, (rival,), {}, {}), "ambiguous") if "single cells" in s]
    assert line.endswith(f"they tell it from {next(iter(rival))}.")
    both = Selection(WEAK, (names | rival,), {}, {})
    assert not [s for s in advice(found, both, "ambiguous") if "single cells" in s]
    found.candidates = tuple(replace(c, credit=9.0) if c.id == "weak-cell" else c for c in found.candidates)
    assert not [s for s in advice(found, Selection(names, (rival,), {}, {}), "ambiguous") if "single cells" in s]


@pytest.fixture(scope="module")
def short():
    """Three minutes each: nothing deep shows."""
    flights = [flown((), seed=4, number=k, samples=60) for k in range(3)]
    tried = catalogue(flights)
    return search(base(flights), tried), tried


def test_what_flights_could_not_show_they_show_with_the_cheapest_manoeuvre_that_is_advised(short):
    found, tried = short
    said = advice(found, NOTHING, "not-excited", tried)
    (line,) = [line for line in said if "weak-cell" in line]
    assert line.startswith(DEEP)
    assert found.snr["weak-cell"] < LEAST_SNR
    (deep,) = [m for m in MENU if DEEP.lower() in m.words.lower()]
    flights = [*found.base.flights, replace(deep.flown(found.base.flights[0], found.base.lab.capacity_c), label="deep")]
    deeper = Search(base(flights), tuple(tried), found.noise)
    (weak,) = [c for c in tried if c.id == "weak-cell"]
    shown = expected_snr(deeper.fitted(frozenset()), deeper.joint(frozenset({"weak-cell"})), weak)
    assert shown > LEAST_SNR


def test_what_flights_show_already_needs_no_manoeuvre(short):
    found, tried = short
    said = " ".join(advice(found, NOTHING, "not-excited", tried))
    assert not [name for name, snr in found.snr.items() if snr >= LEAST_SNR and name in said]


@pytest.mark.parametrize("step_s", [0.5, 1.0, 2.5])
def test_throttle_steps_last_five_seconds_at_any_rate(step_s):
    flight = replace(flown((), seed=4, samples=int(400.0 / step_s), step_s=step_s), shifts_a=None)
    level = replace(flight, current_a=np.where(flight.airborne, 12.0, 0.3))
    (steps,) = [m for m in MENU if "throttle" in m.words]
    full = steps.flown(level, 1.0).current_a > 18.0
    assert np.sum(np.diff(full.astype(int)) == 1) == 3
    assert step_s * np.sum(full) == pytest.approx(3 * 5.0)
    assert flight.time_s[np.argmax(full)] - flight.time_s[np.argmax(flight.airborne)] == pytest.approx(30.0)


@pytest.mark.parametrize("verdict", ["none", "named", "unknown", "parameter", "sensor-suspect"])
def test_what_is_settled_needs_no_flight(alike, verdict):
    found, rivals = contested(alike)
    assert advice(found, Selection(WARMTH, (), {}, {}), verdict, (), rivals) == []
