from itertools import pairwise

import pytest

from bhm_service.messages import (
    AutopilotClock,
    AutopilotKind,
    BatterySample,
    BatteryStatus,
    Heartbeat,
    Landed,
    LandedState,
    SystemStatus,
)
from bhm_service.telemetry import PackWatch, PhaseDetector, SampleMerger


def status(time_s, volts=16.0, amps=10.0, battery_id=0, kelvin=None, consumed=None):
    return BatteryStatus(
        time_s=time_s, battery_id=battery_id, voltage_v=volts, cells_v=None, current_a=amps, temperature_k=kelvin,
        consumed_c=consumed, remaining=None,
    )  # fmt: skip


def system(time_s, volts=16.0, amps=10.0):
    return SystemStatus(time_s=time_s, voltage_v=volts, current_a=amps, remaining=None)


def beat(time_s, armed=True, kind=AutopilotKind.ARDUPILOT):
    return Heartbeat(time_s=time_s, system=1, component=1, kind=kind, armed=armed)


def sample(time_s, volts=16.0, amps=10.0):
    return BatterySample(time_s=time_s, battery_id=0, voltage_v=volts, current_a=amps, temperature_k=None)


def merged(messages, battery_id=0):
    merger = SampleMerger(battery_id)
    return [s for s in map(merger.add, messages) if s is not None]


def test_fast_reports_are_averaged_to_one_a_second():
    found = merged([status(0.1 * k, volts=16.0 + 0.01 * (k % 2), amps=float(k)) for k in range(50)])
    assert 4 <= len(found) <= 7
    assert all(b.time_s - a.time_s >= 0.9 for a, b in pairwise(found))
    assert found[1].current_a == pytest.approx(sum(range(1, 10)) / 9)


def test_slow_reports_pass_as_they_come():
    assert [s.time_s for s in merged([status(12.0 * k) for k in range(5)])] == [0.0, 12.0, 24.0, 36.0, 48.0]


def test_sys_status_speaks_where_battery_status_has_no_voltage():
    """ArduCopter 3.5: BATTERY_STATUS with all cells 65535."""
    messages = [m for k in range(5) for m in (status(k, volts=None), system(k + 0.1, volts=15.0))]
    found = merged(messages)
    assert len(found) == 5
    assert all(s.voltage_v == 15.0 for s in found)


def test_sys_status_is_silent_where_battery_status_speaks():
    messages = [m for k in range(9) for m in (status(k), system(k + 0.3, volts=12.0))]
    assert all(s.voltage_v == 16.0 for s in merged(messages))


def test_sys_status_fills_in_between_rare_battery_status_of_the_only_battery():
    messages = [status(0.0), system(2.0, volts=15.9), system(4.0, volts=15.8), status(6.0)]
    assert [s.voltage_v for s in merged(messages)] == [16.0, 15.9, 15.8, 16.0]


def test_two_batteries_in_one_slot_are_not_mixed():
    messages = [m for k in range(6) for m in (status(2 * k, 16.0), status(2 * k + 1, 22.0, battery_id=1))]
    messages += [system(12.5, volts=16.0)]
    assert {s.voltage_v for s in merged(messages, 1)} == {22.0}
    assert {s.voltage_v for s in merged(messages, 0)} == {16.0}


def test_sys_status_means_battery_zero_on_ardupilot_and_the_lowest_on_px4():
    assert merged([beat(0.0), system(1.0)], battery_id=1) == []
    px4 = [beat(0.0, kind=AutopilotKind.PX4), status(0.5, volts=None, battery_id=1), system(1.0)]
    assert len(merged(px4, battery_id=1)) == 1


def currents(amps, every_s=1.0, armed=True):
    messages = [beat(0.0, armed=armed), *(status(every_s * (k + 1), amps=a) for k, a in enumerate(amps))]
    return [s.current_a for s in merged(messages)]


def test_current_that_flows_back_in_the_air_is_measured():
    assert currents([20.0, 20.0, -3.0, 15.0, -0.02]) == [20.0, 20.0, -3.0, 15.0, -0.02]


def test_a_negative_current_before_any_load_is_no_measurement():
    assert currents([-3.0, -3.0]) == [None, None]
    assert currents([-0.4], armed=False) == [-0.4]


def test_a_sensor_wired_backwards_measures_nothing():
    assert currents([0.02, 0.02, *[-20.0] * 50, 0.03, -20.0])[2:] == [*[None] * 50, 0.03, None]


@pytest.mark.parametrize("every_s", [1.0, 10.0])
def test_a_sensor_that_dies_in_flight_is_believed_for_a_minute(every_s):
    lasting = currents([20.0] * 600 + [-0.3] * 600, every_s)[600:]
    believed = lasting.index(None)
    assert believed * every_s == pytest.approx(60.0, abs=every_s)
    assert set(lasting[believed:]) == {None}
    assert currents([20.0] * 10 + [-0.3] * 90 + [20.0, -0.3])[-1] == -0.3


def test_temperature_is_kept_for_a_minute():
    found = merged([status(0.0, kelvin=300.0), status(30.0), status(120.0)])
    assert [s.temperature_k for s in found] == [300.0, 300.0, None]


def phases(messages, airborne_a=3.0):
    detector = PhaseDetector(airborne_a)
    return [(p.time_s, p.airborne, p.because) for m in messages if (p := detector.add(m)) is not None]


def test_the_autopilots_landed_state_is_believed():
    messages = [LandedState(time_s=1.0, state=Landed.ON_GROUND), LandedState(time_s=5.0, state=Landed.TAKEOFF)]
    messages += [sample(6.0, amps=0.0), sample(9.0, amps=0.0), LandedState(time_s=9.0, state=Landed.IN_AIR)]
    messages += [LandedState(time_s=70.0, state=Landed.ON_GROUND)]
    assert [p[:2] for p in phases(messages)] == [(5.0, True), (70.0, False)]


def test_without_it_armed_and_current_tell():
    messages = [beat(0.0, armed=True), *(sample(k, amps=0.5) for k in range(1, 5))]
    messages += [sample(k, amps=12.0) for k in range(5, 30)] + [sample(k, amps=0.4) for k in range(30, 40)]
    found = phases(messages)
    assert [(p[0], p[1]) for p in found] == [(5.0, True), (32.0, False)]


def test_a_burst_on_the_ground_or_a_lull_in_the_air_is_no_phase():
    messages = [sample(k, amps=12.0 if k == 4 else 0.2) for k in range(10)]
    assert phases(messages) == []
    flying = [sample(k, amps=0.5 if k == 15 else 12.0) for k in range(30)]
    assert len(phases(flying)) == 1


def test_disarmed_is_landed():
    messages = [beat(0.0), *(sample(k, amps=12.0) for k in range(1, 9)), beat(9.0, armed=False)]
    assert [p[1:] for p in phases(messages)] == [(True, "armed and current"), (False, "disarmed")]


def changes(messages, airborne=False):
    watch = PackWatch(series=4, rest_a=1.0)
    return [c.because for m in messages if (c := watch.add(m, airborne)) is not None]


def resting(volts, begin, count=5):
    return [sample(begin + k, volts=volts, amps=0.2) for k in range(count)]


def test_another_voltage_after_a_reboot_is_another_pack():
    messages = [AutopilotClock(time_s=0.0, boot_s=900.0), *resting(14.9, 0.0)]
    messages += [AutopilotClock(time_s=5.0, boot_s=2.0), *resting(16.6, 6.0)]
    (why,) = changes(messages)
    assert "rebooted" in why
    assert "up by 425 mV a cell" in why


def test_a_reboot_with_the_same_voltage_is_the_same_pack():
    messages = [AutopilotClock(time_s=0.0, boot_s=900.0), *resting(15.52, 0.0)]
    messages += [AutopilotClock(time_s=5.0, boot_s=2.0), *resting(15.51, 6.0)]
    assert changes(messages) == []


def test_a_hot_swap_is_noticed_by_the_voltage_alone():
    assert len(changes(resting(14.6, 0.0) + resting(16.7, 5.0))) == 1


def test_a_single_reading_that_jumps_is_no_other_pack():
    """Seen in logs: one sample at rest 1.2 V above its neighbours."""
    assert changes([*resting(14.6, 0.0), sample(5.0, volts=16.0, amps=0.2), *resting(14.6, 6.0)]) == []


def test_a_jump_is_believed_where_a_load_hides_whether_it_stays():
    loaded = [sample(6.0 + k, volts=14.5, amps=20.0) for k in range(5)]
    assert len(changes([*resting(14.6, 0.0), sample(5.0, volts=16.0, amps=0.2), *loaded])) == 1


def test_a_pack_that_recovers_after_landing_is_no_other():
    rising = [sample(10.0 + k, volts=14.0 + 0.05 * min(k, 10), amps=0.2) for k in range(40)]
    assert changes([sample(9.0, volts=13.2, amps=20.0), *rising]) == []


def test_nothing_is_another_pack_in_the_air():
    assert changes(resting(14.6, 0.0) + resting(16.7, 5.0), airborne=True) == []


def test_a_counter_that_goes_back_with_the_voltage_up_is_another_pack():
    messages = [status(0.0, consumed=9000.0), *resting(14.9, 0.0), status(6.0, consumed=0.0), *resting(16.6, 6.0)]
    (why,) = changes(messages)
    assert "consumed charge went back" in why
