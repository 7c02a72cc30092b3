"""New physics in the shadow of the old: when it takes over, and when it has to go back."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from executive.flight import Notebook, play, quad, seconds

from bhm_service.apps.duel import Score
from bhm_service.assembly import assemble
from bhm_service.codec import packed
from bhm_service.config import Service
from bhm_service.executive import restore, states
from bhm_service.messages import (
    Event,
    EventCode,
    Housekeeping,
    Model,
    NamedValue,
    RemainingTime,
    Standing,
    StateEstimate,
    Tick,
)
from bhm_service.standing import StandingFile

FLIGHT_S = 72.0  # a minute of it has to count
SERVICE = Service.model_validate({"estimators": [{"model": "circ"}], "prediction": {"samples": 10}})


def with_resistance(equipment, factor):
    """The same battery file with another ohmic resistance, which it is sure of."""
    battery = equipment.battery
    circ = replace(battery.circ, r_s=battery.circ.r_s * factor)
    sure = replace(battery.uncertainty, resistance=0.02, polarisation=0.02, voltage_error_v=0.004)
    return replace(equipment, battery=replace(battery, circ=circ, uncertainty=sure))


OURS, OFF = 1.0, 8.0  # times the resistance that ships
RIGHT, WRONG = with_resistance(quad(), OURS), with_resistance(quad(), OFF)


def duel(old, new, standing=None):
    sink = Notebook(NamedValue, Event, Standing, RemainingTime, StateEstimate, Housekeeping)
    bus = assemble(replace(old, shadow=new), SERVICE, [sink], standing=standing)
    return bus, sink


@cache
def flight(number):
    return list(seconds(flight_s=FLIGHT_S, left=0.95, begin_s=1000.0 + 400.0 * number))


def fly(bus, count=1, begin=0):
    for k in range(begin, begin + count):
        play(bus, flight(k))


def told(sink, kind):
    return [m for m in sink.heard if type(m) is kind]


def codes(sink):
    return [e.code for e in told(sink, Event) if e.code.name.startswith("SHADOW")]


@cache
def said_by(factor, flights):
    """Named values of physics that flies alone."""
    sink = Notebook(NamedValue)
    bus = assemble(with_resistance(quad(), factor), SERVICE, [sink])
    fly(bus, flights)
    return sink.heard


def test_better_physics_speaks_after_two_flights_and_only_then():
    bus, sink = duel(WRONG, RIGHT)
    fly(bus)
    assert told(sink, NamedValue) == said_by(OFF, 1)
    assert codes(sink) == []
    fly(bus, begin=1)
    assert codes(sink) == [EventCode.SHADOW_IN_CHARGE]
    standing = told(sink, Standing)[-1]
    assert standing.shadow_in_charge
    assert standing.new_score > standing.old_score
    sink.heard.clear()
    fly(bus, begin=2)
    assert told(sink, NamedValue) != []
    assert told(sink, NamedValue) == said_by(OURS, 3)[-len(told(sink, NamedValue)) :]


@pytest.mark.parametrize("new", [WRONG, RIGHT], ids=["worse", "the same"])
def test_physics_that_is_no_better_never_speaks(new):
    bus, sink = duel(RIGHT, new)
    fly(bus, 3)
    assert codes(sink) == []
    assert told(sink, NamedValue) == said_by(OURS, 3)
    assert [s.flights for s in told(sink, Standing)] == [1, 2, 3]


def test_physics_in_charge_that_becomes_worse_is_sent_back_in_flight():
    bus, sink = duel(RIGHT, WRONG, Standing(time_s=0.0, flights=2, shadow_in_charge=True))
    fly(bus)
    assert codes(sink) == [EventCode.SHADOW_ROLLED_BACK]
    (event,) = [e for e in told(sink, Event) if e.code is EventCode.SHADOW_ROLLED_BACK]
    assert "worse than the old physics" in event.text
    after = [v for v in told(sink, NamedValue) if v.time_s > event.time_s]
    assert after == [v for v in said_by(OURS, 1) if v.time_s > event.time_s]
    assert not told(sink, Standing)[-1].shadow_in_charge
    assert told(sink, Standing)[-1].flights == 1


def test_physics_in_charge_that_knows_nothing_is_sent_back():
    bus, sink = duel(RIGHT, RIGHT, Standing(time_s=0.0, flights=2, shadow_in_charge=True))
    new = next(a for a in bus.apps if a.name == "duel")._app._new.bus
    next(c for n, c in new.counters.items() if n == "estimator-circ").down = True
    fly(bus)
    assert codes(sink) == [EventCode.SHADOW_ROLLED_BACK]
    assert "knows nothing" in next(e.text for e in told(sink, Event) if e.code is EventCode.SHADOW_ROLLED_BACK)
    assert told(sink, RemainingTime)[-1].soc is not None


def test_a_duel_goes_on_from_what_it_remembers_and_counts_both_sides_apps():
    (first, one), (second, other) = duel(WRONG, RIGHT), duel(WRONG, RIGHT)
    play(first, flight(0)[:60])
    restore(second.apps, states(first.apps))
    one.heard.clear()
    play(first, flight(0)[60:])
    play(second, flight(0)[60:])
    assert told(other, NamedValue) == told(one, NamedValue)
    assert packed(told(other, Standing)) == packed(told(one, Standing))
    assert {"old reader", "new reader", "duel"} <= {h.app for h in told(one, Housekeeping)}


def test_a_score_is_the_mean_log_density_and_faulty_readings_do_not_decide():
    estimate = StateEstimate(
        time_s=0.0, model=Model.CIRC, valid=True, soc=0.5, soc_sd=0.1, soc_low=0.4, soc_high=0.6, soe=0.5,
        voltage_expected_v=15.0, voltage_expected_sd_v=0.1, voltage_measured_v=15.1, nis=1.0, rejected=None,
        mean=(), covariance=(),
    )  # fmt: skip
    score = Score().add(estimate).add(replace(estimate, nis=3.0))
    assert score.mean == pytest.approx(-1.0 + 2.302585)
    assert Score().add(replace(estimate, nis=1e9)).mean > -11.0
    assert Score().add(replace(estimate, nis=None)) == Score()
    assert Score().add(replace(estimate, voltage_expected_sd_v=0.0)) == Score()


def test_a_standing_is_kept_for_its_pair_of_files_only(tmp_path):
    file = StandingFile(tmp_path / "state" / "standing.json", "these")
    assert file.read() is None
    standing = Standing(time_s=5.0, flights=2, shadow_in_charge=True, old_score=1.0, new_score=2.0)
    file.on_message(standing)
    assert file.read() == standing
    assert StandingFile(tmp_path / "state" / "standing.json", "others").read() is None
    (tmp_path / "state" / "standing.json").write_text("{")
    assert file.read() is None


def test_ticks_alone_decide_nothing():
    bus, sink = duel(RIGHT, WRONG, Standing(time_s=0.0, flights=2, shadow_in_charge=True))
    for k in range(30):
        bus.publish(Tick(time_s=float(k)))
    assert codes(sink) == []
