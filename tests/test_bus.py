from dataclasses import dataclass, field

import pytest

from bhm_service.apps.housekeeping import HousekeepingApp
from bhm_service.bus import Bus, Counters
from bhm_service.messages import BatterySample, Event, EventCode, Housekeeping, Severity, Tick, Wind


def tick(t=0.0):
    return Tick(time_s=t)


def wind(t=0.0, speed=1.0):
    return Wind(time_s=t, speed_mps=speed, direction_deg=0.0)


@dataclass
class Echo:
    """Answers what it hears with what it was given."""

    name: str
    hears: tuple
    says: tuple = ()
    answer: object = None
    heard: list = field(default_factory=list)

    def on_message(self, message):
        self.heard.append(message)
        return [] if self.answer is None else self.answer(message)


def test_an_app_hears_only_what_it_asked_for():
    ticks, winds = Echo("ticks", (Tick,)), Echo("winds", (Wind,))
    bus = Bus([ticks, winds])
    bus.publish(tick())
    bus.publish(wind())
    assert [type(m) for m in ticks.heard] == [Tick]
    assert [type(m) for m in winds.heard] == [Wind]


def test_answers_are_delivered_in_the_order_of_the_wiring_every_time():
    order = []

    def note(name):
        return lambda message: order.append(name) or []

    first = Echo("first", (Tick,), (Wind,), lambda m: [wind(1), wind(2)])
    apps = [first, Echo("b", (Wind,), (), note("b")), Echo("a", (Wind, Tick), (), note("a"))]
    Bus(apps).publish(tick())
    assert order == ["b", "b", "a", "a", "a"]
    assert [type(m) for m in apps[2].heard] == [Tick, Wind, Wind]


def test_a_full_pipe_drops_the_oldest_and_counts_it():
    chatty = Echo("chatty", (Tick,), (Wind,), lambda m: [wind(speed=float(k)) for k in range(10)])
    slow = Echo("slow", (Wind,))
    bus = Bus([chatty, slow], depth=4)
    bus.publish(tick())
    assert [m.speed_mps for m in slow.heard] == [6.0, 7.0, 8.0, 9.0]
    assert bus.counters["slow"].dropped == 6
    assert bus.counters["slow"].heard == 4
    assert bus.counters["chatty"].said == 10


def test_an_app_may_only_say_what_it_declares():
    liar = Echo("liar", (Tick,), (), lambda m: [wind()])
    with pytest.raises(TypeError, match="'liar' said a Wind"):
        Bus([liar]).publish(tick())


def test_two_apps_of_one_name_are_refused():
    with pytest.raises(ValueError, match="same name"):
        Bus([Echo("x", ()), Echo("x", ())])


def test_housekeeping_tells_every_apps_counters_once_a_second():
    counters = {}
    restart = Event(
        time_s=0.0, app="b", code=EventCode.FILTER_RESTARTED, severity=Severity.WARNING, text="started over"
    )
    filter_app = Echo("b", (BatterySample,), (Event,), lambda m: [restart])
    sink = Echo("sink", (Housekeeping,))
    clock = iter(range(100))
    bus = Bus([filter_app, HousekeepingApp(counters), sink], counters, stopwatch=lambda: 0.25 * next(clock))
    sample = BatterySample(time_s=0.0, battery_id=0, voltage_v=1.0, current_a=1.0, temperature_k=None)
    bus.publish(sample)
    bus.publish(sample)
    for t in (0.0, 0.5, 1.0, 1.9, 2.0):
        bus.publish(tick(t))
    told = [m for m in sink.heard if m.app == "b"]
    assert [m.time_s for m in told] == [0.0, 1.0, 2.0]
    assert (told[-1].heard, told[-1].said, told[-1].resets, told[-1].dropped) == (2, 2, 2, 0)
    assert told[-1].worst_step_s == 0.25


def test_a_replay_has_no_stopwatch():
    counters: dict[str, Counters] = {}
    Bus([Echo("x", (Tick,))], counters).publish(tick())
    assert counters["x"].worst_step_s is None
