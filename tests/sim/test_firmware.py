"""The simulated autopilots behave as the real ones were observed to (../shared/design/mavlink.md)."""

from __future__ import annotations

import itertools

import pytest

from bhm_service.mavlink.dialect import mavlink, unpack
from bhm_service.mavlink.encode import FrameEncoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.messages import NamedValue
from sim.ardupilot import ArduPilot
from sim.battery import SimulatedPack
from sim.multirotor import Multirotor, Sensors, Wind, hover_plan
from sim.px4 import Px4

M = mavlink
FIRMWARES = pytest.mark.parametrize("kind", [ArduPilot, Px4])


class Bench:
    """An autopilot on one link without a socket, in simulated time."""

    def __init__(self, kind, batteries=1, **flight):
        other = SimulatedPack(series=4, capacity_ah=5.0, left=0.6) if batteries == 2 else None
        pack = SimulatedPack(series=4, capacity_ah=5.0, left=0.9)
        self.vehicle = Multirotor(pack, hover_plan(240.0, 600.0), 1, other=other, **flight)
        self.firmware = kind(self.vehicle.plan, 4, 5.0)
        self.link = self.firmware.channel()
        self.companion = FrameEncoder(1)

    def say(self, *frames):
        for frame in FrameSplitter().feed(b"".join(frames)):
            self.firmware.take(self.link, frame, self.vehicle.time_s)

    def say_message(self, message):
        self.say(bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=191))))

    def run(self, seconds):
        """(message id, fields) of what is said in that time."""
        said = []
        for _ in range(round(seconds * 10)):
            assert self.vehicle.step()
            frames = self.firmware.send_due(self.link, self.vehicle.seen())
            said += [(f.message_id, unpack(f.message_id, f.payload)) for f in FrameSplitter().feed(b"".join(frames))]
        return said

    def ask(self, message_id, hertz=1.0):
        self.say(self.companion.request_interval(1, 1, message_id, hertz))


def only(said, message_id):
    return [fields for found, fields in said if found == message_id]


def test_a_fresh_ardupilot_link_carries_heartbeats_only():
    assert {found for found, _ in Bench(ArduPilot).run(5.0)} == {M.MAVLINK_MSG_ID_HEARTBEAT}


def test_px4_streams_unasked_and_battery_status_every_two_seconds():
    said = Bench(Px4).run(10.0)
    assert len(only(said, M.MAVLINK_MSG_ID_BATTERY_STATUS)) == 5
    assert len(only(said, M.MAVLINK_MSG_ID_SYS_STATUS)) == 10


@FIRMWARES
def test_what_is_asked_for_comes_at_the_rate_that_was_asked(kind):
    bench = Bench(kind)
    bench.ask(M.MAVLINK_MSG_ID_BATTERY_STATUS, 4.0)
    said = bench.run(10.0)
    assert 39 <= len(only(said, M.MAVLINK_MSG_ID_BATTERY_STATUS)) <= 41
    (ack,) = only(said, M.MAVLINK_MSG_ID_COMMAND_ACK)
    assert ack["result"] == M.MAV_RESULT_ACCEPTED


def test_each_firmware_refuses_the_other_ones_wind():
    for kind, wind in ((ArduPilot, M.MAVLINK_MSG_ID_WIND_COV), (Px4, M.MAVLINK_MSG_ID_WIND)):
        bench = Bench(kind)
        bench.ask(wind)
        said = bench.run(3.0)
        assert not only(said, wind)
        assert only(said, M.MAVLINK_MSG_ID_COMMAND_ACK)[0]["result"] != M.MAV_RESULT_ACCEPTED


def test_ardupilots_two_batteries_take_turns_in_one_slot():
    bench = Bench(ArduPilot, batteries=2)
    bench.ask(M.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0)
    ids = [b["id"] for b in only(bench.run(10.0), M.MAVLINK_MSG_ID_BATTERY_STATUS)]
    assert len(ids) == 10
    assert all(a != b for a, b in itertools.pairwise(ids))


def test_px4_tells_of_the_lower_battery_in_sys_status_and_shares_voltage_out_over_cells():
    said = Bench(Px4, batteries=2).run(60.0)
    batteries = only(said, M.MAVLINK_MSG_ID_BATTERY_STATUS)
    assert {b["id"] for b in batteries} == {0, 1}
    assert len(set(batteries[-1]["voltages"][:4])) == 1
    assert batteries[-1]["voltages"][4:] == (65535,) * 6
    other = [b for b in batteries if b["id"] == 1][-1]
    percents = {b["battery_remaining"] for b in batteries[-2:]}
    assert only(said, M.MAVLINK_MSG_ID_SYS_STATUS)[-1]["battery_remaining"] <= min(percents)
    assert other["voltages"][0] < 3900


def test_another_programs_stream_request_overwrites_our_interval():
    bench = Bench(ArduPilot)
    bench.ask(M.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0)
    assert only(bench.run(5.0), M.MAVLINK_MSG_ID_BATTERY_STATUS)
    bench.say(FrameEncoder(255, 190).request_stream(1, 1, M.MAV_DATA_STREAM_ALL, 0))
    bench.run(1.0)
    assert not only(bench.run(5.0), M.MAVLINK_MSG_ID_BATTERY_STATUS)


def test_px4_echoes_our_value_as_its_own_without_the_tenth_character_and_by_its_own_clock():
    bench = Bench(Px4)
    bench.run(5.0)
    bench.say(bench.companion.named_value(NamedValue(time_s=0.0, boot_ms=99_000_000, name="BHM_RFTLO", value=3.0)))
    (echo,) = only(bench.run(1.0), M.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT)
    assert echo["name"].split(b"\0")[0] == b"BHM_RFTLO"
    assert echo["time_boot_ms"] < 10_000


def test_px4_misses_a_companion_that_fell_silent():
    bench = Bench(Px4)
    bench.say(bench.companion.companion_heartbeat())
    (text,) = only(bench.run(10.0), M.MAVLINK_MSG_ID_STATUSTEXT)
    assert b"mission computer lost" in text["text"]


def test_ardupilot_drops_frames_that_claim_to_be_itself():
    bench = Bench(ArduPilot)
    bench.say(FrameEncoder(1, 1).request_interval(1, 1, M.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0))
    assert not only(bench.run(3.0), M.MAVLINK_MSG_ID_BATTERY_STATUS)


@FIRMWARES
def test_a_reboot_starts_clock_charge_and_rates_anew_after_a_silence(kind):
    bench = Bench(kind)
    bench.ask(M.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0)
    bench.ask(M.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 1.0)
    before = only(bench.run(60.0), M.MAVLINK_MSG_ID_BATTERY_STATUS)[-1]
    bench.firmware.reboot(bench.vehicle.seen())
    assert not bench.run(2.5)
    bench.run(2.0)
    bench.ask(M.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0)
    bench.ask(M.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 1.0)
    said = bench.run(2.0)
    assert only(said, M.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)[0]["time_boot_ms"] < 5_000
    after = only(said, M.MAVLINK_MSG_ID_BATTERY_STATUS)[0]
    assert after["current_consumed"] < 30 < 100 < before["current_consumed"]


@FIRMWARES
def test_the_mission_is_given_item_by_item(kind):
    bench = Bench(kind)
    bench.say_message(M.MAVLink_mission_request_list_message(1, 1, 0))
    (count,) = only(bench.run(0.5), M.MAVLINK_MSG_ID_MISSION_COUNT)
    assert (count["target_system"], count["target_component"]) == (1, 191)
    for at in range(count["count"]):
        bench.say_message(M.MAVLink_mission_request_int_message(1, 1, at, 0))
    items = only(bench.run(0.5), M.MAVLINK_MSG_ID_MISSION_ITEM_INT)
    assert [item["seq"] for item in items] == list(range(count["count"]))
    commands = [item["command"] for item in items]
    assert M.MAV_CMD_NAV_TAKEOFF in commands[:2]
    assert commands[-1] == M.MAV_CMD_NAV_LAND
    bench.say_message(M.MAVLink_mission_request_int_message(1, 1, 99, 0))
    (refused,) = only(bench.run(0.5), M.MAVLINK_MSG_ID_MISSION_ACK)
    assert refused["type"] == M.MAV_MISSION_INVALID_SEQUENCE


@FIRMWARES
def test_a_parameter_is_answered_where_it_exists(kind):
    bench = Bench(kind)
    name = next(name for name in bench.firmware.parameters if "CAPACITY" in name)
    bench.say_message(M.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    bench.say_message(M.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    (value,) = only(bench.run(0.5), M.MAVLINK_MSG_ID_PARAM_VALUE)
    assert value["param_value"] == 5000.0


@FIRMWARES
def test_landed_state_follows_the_flight(kind):
    bench = Bench(kind)
    bench.ask(M.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 2.0)
    states = [s["landed_state"] for s in only(bench.run(620.0), M.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)]
    changes = [state for state, last in zip(states, [None, *states], strict=False) if state != last]
    assert changes == [
        M.MAV_LANDED_STATE_ON_GROUND,
        M.MAV_LANDED_STATE_TAKEOFF,
        M.MAV_LANDED_STATE_IN_AIR,
        M.MAV_LANDED_STATE_LANDING,
        M.MAV_LANDED_STATE_ON_GROUND,
    ]


def test_wind_costs_power_gusts_come_and_go_and_still_air_changes_nothing():
    def flown(**flight):
        vehicle = Multirotor(SimulatedPack(series=4, capacity_ah=5.0), hover_plan(240.0, 200.0), 3, **flight)
        states = [vehicle.second() for _ in range(200)]
        return states[-1].consumed_ah, [state.wind_mps for state in states[20:]]

    still, windy, gusty = flown(), flown(wind=Wind(12.0)), flown(wind=Wind(12.0, gust_mps=3.0))
    assert flown(wind=Wind(0.0)) == still
    assert windy[0] > 1.02 * still[0]
    assert set(windy[1]) == {12.0}
    assert max(gusty[1]) > 15.0 > 9.0 > min(gusty[1])


def test_a_converter_sees_steps():
    sensors = Sensors(voltage_step=0.008, current_step=0.014)
    vehicle = Multirotor(SimulatedPack(series=4, capacity_ah=5.0), hover_plan(240.0, 200.0), 3, sensors=sensors)
    for _ in range(100):
        volts = vehicle.second().voltage_v
        assert volts / 0.008 == pytest.approx(round(volts / 0.008), abs=1e-6)


def test_the_same_seed_is_the_same_flight():
    def flown(seed):
        bench = Bench(Px4, wind=Wind(5.0, gust_mps=2.0))
        bench.vehicle = Multirotor(
            SimulatedPack(series=4, capacity_ah=5.0), bench.vehicle.plan, seed, wind=Wind(5.0, gust_mps=2.0)
        )
        return bench.run(60.0)

    assert str(flown(4)) == str(flown(4)) != str(flown(5))
