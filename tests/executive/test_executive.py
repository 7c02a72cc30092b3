"""Faults of apps: caught, told, counted, and no other app's business."""

from __future__ import annotations

import pytest
from executive.flight import Notebook, flying_bus, play, seconds

from bhm_service.bus import Bus, Counters
from bhm_service.codec import NotThisKindError
from bhm_service.executive import Supervised, restore, states
from bhm_service.messages import (
    Event,
    EventCode,
    Housekeeping,
    Model,
    NamedValue,
    RemainingTime,
    Severity,
    StateEstimate,
    StatusText,
    Tick,
)


def app(bus, name):
    return next(a for a in bus.apps if a.name == name)


def break_once(bus, name, error=ZeroDivisionError):
    """The app as it stands raises on the next message that is not a Tick."""
    broken = app(bus, name)._app

    def on_message(message):
        del broken.on_message
        raise error("of nothing")

    broken.on_message = on_message


def told(sink, kind):
    return [m for m in sink.heard if type(m) is kind]


def flight_with_faults(at, name, total=60):
    """A flight in which an app raises at some seconds; what the sink heard."""
    sink = Notebook(StateEstimate, RemainingTime, NamedValue, Event, StatusText, Housekeeping)
    bus = flying_bus([], sinks=[sink])
    flight = [messages for k, messages in enumerate(seconds()) if k < total]
    play(bus, flight, lambda k: break_once(bus, name) if k in at else None)
    return sink


@pytest.fixture(scope="module")
def undisturbed():
    return flight_with_faults((), "reader")


def test_an_estimator_that_raises_goes_on_from_its_checkpoint(undisturbed):
    sink = flight_with_faults((30,), "estimator-circ")
    events = [e for e in told(sink, Event) if e.code is EventCode.APP_RESTARTED]
    assert [e.app for e in events] == ["estimator-circ"]
    assert "ZeroDivisionError: of nothing" in events[0].text
    assert "BatterySample" in events[0].text
    circ = [e for e in told(sink, StateEstimate) if e.model is Model.CIRC]
    before = [e for e in told(undisturbed, StateEstimate) if e.model is Model.CIRC]
    assert len(circ) == len(before) - 1  # the sample on which it raised is lost
    assert circ[-1].soc == pytest.approx(before[-1].soc, abs=0.005)
    assert circ[-1].soc_sd == pytest.approx(before[-1].soc_sd, rel=0.1)


def test_one_estimators_fault_does_not_touch_the_other(undisturbed):
    sink = flight_with_faults((30, 40), "estimator-circ")
    chem, before = (
        [(e.time_s, e.soc, e.soc_sd) for e in told(s, StateEstimate) if e.model is Model.CHEM]
        for s in (sink, undisturbed)
    )
    assert chem == before


def test_a_second_fault_within_a_minute_keeps_it_down_and_says_so():
    sink = flight_with_faults((20, 30), "estimator-circ", total=70)
    down = [e for e in told(sink, Event) if e.code is EventCode.APP_DOWN]
    assert [(e.app, e.severity) for e in down] == [("estimator-circ", Severity.CRITICAL)]
    texts = [t.text for t in told(sink, StatusText)]
    assert texts == ["Battery service: estimator-circ is down"]
    assert len(texts[0]) <= 50
    last = [h for h in told(sink, Housekeeping) if h.app == "estimator-circ"][-1]
    assert (last.crashes, last.down) == (2, True)
    after = [e for e in told(sink, StateEstimate) if e.model is Model.CIRC and e.time_s > down[0].time_s]
    assert after == []
    fused = told(sink, RemainingTime)[-1]
    assert fused.median_s is not None
    assert fused.health == 1
    assert "one model has no valid estimate" in fused.because


def test_a_second_fault_after_a_minute_is_a_first_one_again():
    sink = flight_with_faults((10, 75), "estimator-chem", total=90)
    assert [e.code for e in told(sink, Event) if e.app == "estimator-chem"] == [EventCode.APP_RESTARTED] * 2


def test_without_a_predictor_the_ground_is_told_that_there_is_no_estimate():
    sink = flight_with_faults((20, 25), "predictor", total=40)
    last = told(sink, NamedValue)[-1]
    assert (last.name, last.value) == ("BHM_HLTH", 2.0)
    assert last.time_s == pytest.approx(1040.5)


@pytest.mark.parametrize(
    "name",
    ["reader", "estimator-circ", "estimator-chem", "predictor", "publisher", "limits", "housekeeping", "notebook"],
)
def test_whichever_app_raises_the_others_are_served(name):
    sink = Notebook(Event, RemainingTime)
    bus = flying_bus(seconds=20, sinks=[sink])
    break_once(bus, name, MemoryError)
    play(bus, [messages for k, messages in enumerate(seconds()) if 20 <= k < 25])
    assert bus.counters[name].crashes == 1
    assert bus.counters["publisher"].heard > 100
    assert told(sink, RemainingTime)


def test_what_is_remembered_makes_another_bus_go_on_as_the_first_would_have():
    first_sink, second_sink = Notebook(NamedValue), Notebook(NamedValue)
    flight = [messages for k, messages in enumerate(seconds()) if k < 60]
    first = flying_bus(flight[:40], sinks=[first_sink])
    second = flying_bus([], sinks=[second_sink])
    restore(second.apps, states(first.apps))
    first_sink.heard.clear()
    play(first, flight[40:])
    play(second, flight[40:])
    assert second_sink.heard == first_sink.heard
    assert len(first_sink.heard) == 200


def test_what_was_not_remembered_by_such_an_app_is_refused():
    bus = flying_bus([])
    with pytest.raises(NotThisKindError, match="predictor"):
        restore(bus.apps, {"predictor": {"recent": 3}})


def test_an_app_whose_making_anew_fails_is_down_and_not_the_service():
    class Fragile:
        name, hears, says = "fragile", (Tick,), ()
        made = 0

        def __init__(self):
            Fragile.made += 1
            if Fragile.made > 1:
                raise OSError("no more of them")

        def on_message(self, message):
            raise ValueError("never right")

    counters = Counters()
    sink = Notebook(Event)
    bus = Bus([Supervised(Fragile, counters), sink], {"fragile": counters})
    for k in range(3):
        bus.publish(Tick(time_s=float(k)))
    assert [e.code for e in told(sink, Event)] == [EventCode.APP_DOWN]
    assert counters.down
