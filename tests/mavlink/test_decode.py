"""Each trap of reading a battery that was seen on a real autopilot, and what is made of it."""

import math

import pytest
from mavlink.frames import UNKNOWN, battery_status, heartbeat, mav, sys_status

from bhm_service.mavlink.decode import VehicleDecoder, current_a, pack_voltage, temperature_k
from bhm_service.mavlink.dialect import mavlink
from bhm_service.messages import (
    Air,
    AutopilotClock,
    AutopilotKind,
    BatteryStatus,
    Heartbeat,
    Landed,
    LandedState,
    MissionItem,
    Motion,
    ParameterValue,
    SystemStatus,
)

ARDUPILOT, PX4, OTHER = AutopilotKind.ARDUPILOT, AutopilotKind.PX4, AutopilotKind.OTHER


def decode(*messages, autopilot=mav.MAV_AUTOPILOT_ARDUPILOTMEGA):
    decoder = VehicleDecoder()
    link = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    found = []
    for message in (heartbeat(autopilot), *messages):
        frame = message.pack(link)
        found = decoder.decode(message.get_msgId(), frame[10:-2], (1, 1), 5.0)
    return found


@pytest.mark.parametrize(
    ("centiamperes", "kind", "amperes"),
    [
        (1234, ARDUPILOT, 12.34),
        (0, ARDUPILOT, 0.0),
        (-1, ARDUPILOT, None),  # unknown
        (-1, PX4, None),
        (-100, PX4, None),  # PX4 without a sensor
        (-100, ARDUPILOT, -1.0),
        (32767, ARDUPILOT, None),  # clipped at 327.67 A: saturated
        (-32768, ARDUPILOT, None),
    ],
)
def test_current(centiamperes, kind, amperes):
    assert current_a(centiamperes, kind) == amperes


@pytest.mark.parametrize(
    ("slots", "ext", "volts", "cells"),
    [
        ([16000] + [UNKNOWN] * 9, [0] * 4, 16.0, None),  # a pack voltage without cells
        ([65534, 4466] + [UNKNOWN] * 8, [0] * 4, 70.0, None),  # spills into the next slot
        ([UNKNOWN] * 10, [0] * 4, None, None),  # ArduCopter 3.5, Betaflight without a meter
        ([0] * 10, [0] * 4, None, None),
        ([3900, 3910, 3890, 3905] + [UNKNOWN] * 6, [0] * 4, 15.605, (3.9, 3.91, 3.89, 3.905)),
        ([4250] * 6 + [UNKNOWN] * 4, [0] * 4, 25.5, None),  # PX4 deals an average out: no proof of balance
        ([4000] * 9 + [4010], [4000, 4000, 0, 0], 48.01, (4.0,) * 9 + (4.01, 4.0, 4.0)),  # 12 cells, 0 is absent
        ([4000] * 9 + [4010], [UNKNOWN] * 4, 40.01, (4.0,) * 9 + (4.01,)),  # PX4 1.13 writes 65535 there
        ([1000, 800] * 5, [1000, 800, 1000, 800], 12.6, (1.0, 0.8) * 7),  # ArduPilot's simulated smart battery
        ([3900, 3910] + [UNKNOWN] * 8, [3900, 0, 0, 0], 7.81, (3.9, 3.91)),  # an extension needs ten cells before it
    ],
)
def test_voltage(slots, ext, volts, cells):
    total, one_by_one = pack_voltage(tuple(slots), tuple(ext))
    assert total == (None if volts is None else pytest.approx(volts))
    assert one_by_one == (None if cells is None else pytest.approx(cells))


@pytest.mark.parametrize(("raw", "kelvin"), [(32767, None), (2500, 298.15), (-1000, 263.15), (30000, None)])
def test_temperature(raw, kelvin):
    assert temperature_k(raw) == (None if kelvin is None else pytest.approx(kelvin))


def test_zero_volts_in_sys_status_is_not_measured():
    (status,) = decode(sys_status(millivolts=0, current=-1))
    assert status == SystemStatus(time_s=5.0, voltage_v=None, current_a=None, remaining=None)


def test_battery_status_in_si_units():
    (status,) = decode(battery_status((22200,), 1550, 3150, 2, consumed=1000, remaining=44))
    assert status == BatteryStatus(
        time_s=5.0, battery_id=2, voltage_v=22.2, cells_v=None, current_a=15.5, temperature_k=pytest.approx(304.65),
        consumed_c=pytest.approx(3600.0), remaining=0.44,
    )  # fmt: skip


def test_short_payload_of_an_old_sender_is_filled_up():
    message = battery_status((16000,))
    link = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    payload = bytes(message.pack(link))[10:-2][:36]
    decoder = VehicleDecoder()
    decoder.decode(0, bytes(heartbeat().pack(link))[10:-2], (1, 1), 0.0)
    assert decoder.decode(147, payload, (1, 1), 0.0)[0].voltage_v == 16.0


def test_the_second_battery_of_old_ardupilot_is_battery_one():
    (status,) = decode(mav.MAVLink_battery2_message(15100, 320))
    assert (status.battery_id, status.voltage_v, status.current_a) == (1, 15.1, 3.2)


def test_nothing_is_believed_before_the_autopilots_heartbeat():
    decoder = VehicleDecoder()
    payload = bytes(sys_status().pack(mav.MAVLink(None)))[10:-2]
    assert decoder.decode(1, payload, (1, 1), 0.0) == []


def say(decoder, message, source):
    frame = message.pack(mav.MAVLink(None, srcSystem=source[0], srcComponent=source[1]))
    return decoder.decode(message.get_msgId(), bytes(frame)[10:-2], source, 1.0)


def test_ground_stations_companions_and_other_vehicles_are_not_the_autopilot():
    decoder = VehicleDecoder()
    station = heartbeat(mav.MAV_AUTOPILOT_INVALID, kind=mav.MAV_TYPE_GCS)
    assert say(decoder, station, (255, 190)) == []
    assert say(decoder, heartbeat(), (7, 154)) == []  # a gimbal that claims an autopilot
    assert isinstance(say(decoder, heartbeat(), (3, 1))[0], Heartbeat)
    assert say(decoder, heartbeat(), (4, 1)) == []
    assert decoder.others == {4}
    assert say(decoder, sys_status(), (4, 1)) == []
    assert say(decoder, sys_status(), (3, 191)) == []  # ourselves, come back
    assert len(say(decoder, sys_status(), (3, 1))) == 1


def test_a_system_that_is_asked_for_is_waited_for():
    decoder = VehicleDecoder(system=9)
    assert say(decoder, heartbeat(), (1, 1)) == []
    assert len(say(decoder, heartbeat(), (9, 1))) == 1


def test_a_mission_uploaded_by_the_ground_station_is_read():
    item = mav.MAVLink_mission_item_int_message(1, 1, 3, 3, 16, 0, 1, 5.0, 0, 0, 0, 648577612, -1478542538, 30.0)
    decoder = VehicleDecoder()
    say(decoder, heartbeat(), (1, 1))
    (read,) = say(decoder, item, (255, 190))
    assert read == MissionItem(
        time_s=1.0, sequence=3, command=16, latitude_deg=pytest.approx(64.8577612),
        longitude_deg=pytest.approx(-147.8542538), altitude_m=30.0, hold_s=5.0,
    )  # fmt: skip


def test_not_a_number_from_the_wire_is_not_known():
    (motion,) = decode(mav.MAVLink_vfr_hud_message(math.nan, 3.5, 90, 55, math.inf, -0.2))
    assert motion == Motion(
        time_s=5.0, air_speed_mps=None, ground_speed_mps=pytest.approx(3.5), altitude_m=None,
        climb_mps=pytest.approx(-0.2), throttle=0.55,
    )  # fmt: skip


def test_position_gives_motion_and_the_autopilots_clock():
    message = mav.MAVLink_global_position_int_message(61500, 0, 0, 40000, 12000, 300, 400, -150, 9000)
    clock, motion = decode(message)
    assert clock == AutopilotClock(time_s=5.0, boot_s=61.5)
    assert (motion.relative_altitude_m, motion.ground_speed_mps, motion.climb_mps) == (12.0, 5.0, 1.5)
    assert motion.latitude_deg is None  # 0, 0 is no fix


def test_landed_state_pressure_and_clock():
    assert decode(mav.MAVLink_extended_sys_state_message(0, 2)) == [LandedState(time_s=5.0, state=Landed.IN_AIR)]
    assert decode(mav.MAVLink_extended_sys_state_message(0, 0)) == []
    (air,) = decode(mav.MAVLink_scaled_pressure_message(2500, 1013.25, 0.0, 4500))
    assert air == Air(
        time_s=5.0, pressure_pa=pytest.approx(101325.0), board_temperature_k=pytest.approx(318.15), boot_s=2.5
    )
    (clock,) = decode(mav.MAVLink_system_time_message(1_700_000_000_000_000, 2500))
    assert clock == AutopilotClock(time_s=5.0, boot_s=2.5, unix_s=1.7e9)
    assert decode(mav.MAVLink_system_time_message(0, 2500))[0].unix_s is None


def test_px4_sends_the_bits_of_an_integer_parameter_ardupilot_its_value():
    import struct

    bits = struct.unpack("<f", struct.pack("<i", 6))[0]
    px4 = mav.MAVLink_param_value_message(b"BAT1_N_CELLS", bits, mav.MAV_PARAM_TYPE_INT32, 900, 1)
    assert decode(px4, autopilot=mav.MAV_AUTOPILOT_PX4) == [
        ParameterValue(time_s=5.0, name="BAT1_N_CELLS", value=6.0)
    ]  # fmt: skip
    ardupilot = mav.MAVLink_param_value_message(b"BATT_CAPACITY", 4000.0, mav.MAV_PARAM_TYPE_INT32, 900, 1)
    assert decode(ardupilot) == [ParameterValue(time_s=5.0, name="BATT_CAPACITY", value=4000.0)]


def test_every_kind_that_is_wanted_is_in_the_dialect():
    from bhm_service.mavlink.decode import WANTED
    from bhm_service.mavlink.subscription import wanted_of

    assert all(message_id in mavlink.mavlink_map for message_id in WANTED)
    assert all(set(wanted_of(kind)) <= WANTED for kind in AutopilotKind)
