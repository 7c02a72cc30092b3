from itertools import pairwise

import pytest

from bhm_service.mavlink.clock import SteadyClock
from bhm_service.messages import AutopilotClock, SystemStatus


def recording(jumps, seconds=60, boot0=100.0):
    """A clock message and a sample each second; ``jumps`` maps a second to what the wall clock was moved by there."""
    shift, out = 0.0, []
    for k in range(seconds):
        shift += jumps.get(k, 0.0)
        stamp = 1000.0 + k + shift
        out.append(("s", SystemStatus(time_s=stamp, voltage_v=16.0, current_a=10.0, remaining=None)))
        out.append(("c", AutopilotClock(time_s=stamp + 0.01, boot_s=boot0 + k + 0.01)))
    return out


def steps(messages):
    times = [m.time_s for tag, m in messages if tag == "s"]
    return [b - a for a, b in pairwise(times)]


@pytest.mark.parametrize("by", [-3600.0, -10.0, 40.0, 86400.0])
def test_a_clock_that_is_set_while_recording_does_not_move_the_samples(by):
    clock = SteadyClock()
    steady = list(clock.steady(recording({30: by})))
    assert steps(steady) == pytest.approx([1.0] * 59, abs=0.02)
    assert len(clock.jumps) == 1
    assert clock.jumps[0][1] == pytest.approx(by, abs=0.05)


def test_a_pause_of_the_recording_stays_a_pause():
    whole = recording({})
    clock = SteadyClock()
    steady = list(clock.steady([m for m in whole if not 1020 < m[1].time_s < 1045]))
    assert max(steps(steady)) == pytest.approx(25.0, abs=1.1)
    assert clock.jumps == []


def test_an_autopilot_that_reboots_is_no_jump():
    before, after = recording({}, 20), recording({}, 20, boot0=3.0)
    from dataclasses import replace

    moved = [(tag, replace(m, time_s=m.time_s + 40.0)) for tag, m in after]
    clock = SteadyClock()
    steady = list(clock.steady(before + moved))
    assert clock.jumps == []
    assert max(steps(steady)) == pytest.approx(21.0)


def test_small_disorder_is_left_alone():
    messages = recording({})
    messages[20], messages[22] = messages[22], messages[20]
    clock = SteadyClock()
    assert [m.time_s for _, m in clock.steady(messages)] == [m.time_s for _, m in messages]
    assert clock.jumps == []


def test_without_the_autopilots_clock_a_jump_back_goes_on_from_where_it_was():
    only = [m for m in recording({30: -500.0}) if m[0] == "s" or m[1].time_s < 1005]
    steady = list(SteadyClock().steady(only))
    assert min(steps(steady)) >= -0.5


def test_every_message_comes_out():
    messages = recording({10: 50.0, 25: -200.0, 40: 5.0})
    assert len(list(SteadyClock().steady(messages))) == len(messages)
