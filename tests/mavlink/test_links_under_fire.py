"""The whole byte path in simulated time over a real socket, while everything goes wrong that can."""

from __future__ import annotations

import itertools
import math
import socket
from dataclasses import fields

import pytest
from mavlink.wire import free_port, statuses
from mavlink.world import World

from bhm_service.mavlink.dialect import mavlink
from bhm_service.mavlink.encode import FrameEncoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.mavlink.links import Links
from bhm_service.mavlink.signing import read_key
from bhm_service.mavlink.transport import LinkUrl
from bhm_service.mavlink.transports import transport_of
from bhm_service.mavlink.udp import UdpTransport
from bhm_service.messages import (
    AutopilotClock,
    BatteryStatus,
    Heartbeat,
    LinkState,
    LinkStatus,
    NamedValue,
    ParameterValue,
)
from sim.ardupilot import ArduPilot
from sim.command import Options, vehicle_of

BATTERY = mavlink.MAVLINK_MSG_ID_BATTERY_STATUS


@pytest.fixture
def world():
    made = []

    def make(**options):
        made.append(World(**options))
        return made[-1]

    yield make
    for one in made:
        one.close()
        for message in one.said:
            for field in fields(message):
                value = getattr(message, field.name)
                assert not (isinstance(value, float) and not math.isfinite(value)), message


def of(said, kind, **wanted):
    return [m for m in said if isinstance(m, kind) and all(getattr(m, k) == v for k, v in wanted.items())]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_everything_that_was_asked_for_comes_once_a_second(world, autopilot):
    one = world(autopilot=autopilot)
    one.run(5.0)
    said = one.run(20.0)
    assert 19 <= len(of(said, BatteryStatus)) <= 21
    assert 19 <= len(of(said, Heartbeat)) <= 21
    (report,) = one.links.reports
    assert report.bad_checksums == report.stray_bytes == report.duplicates == 0
    wanted, refused = 8, 0
    assert report.requests == wanted + refused


def test_two_batteries_are_told_apart_although_they_share_a_slot(world):
    one = world(batteries=2)
    one.run(5.0)
    said = one.run(20.0)
    assert [len(of(said, BatteryStatus, battery_id=n)) for n in (0, 1)] == [10, 10]


def test_rates_that_another_program_took_away_are_asked_for_again(world):
    one = world()
    one.run(10.0)
    ground = FrameEncoder(255, 190)
    one.vehicle.firmware.take(
        one.vehicle.firmware.channels[0], *frames(ground.request_stream(1, 1, mavlink.MAV_DATA_STREAM_ALL, 0)), 10.0
    )
    assert not of(one.run(3.0)[10:], BatteryStatus)
    one.run(10.0)
    assert len(of(one.run(10.0), BatteryStatus)) == 10


def frames(data):
    return FrameSplitter().feed(data)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_after_a_reboot_rates_are_asked_for_again_and_its_clock_starts_anew(world, autopilot):
    one = world(reboot=(30.0,), autopilot=autopilot)
    before = one.run(29.5)
    after = one.run(5.0)
    if autopilot == "px4":  # whose clock comes unasked
        assert one.links.reports[0].requests == 16
    after += one.run(3.0)
    assert max(m.boot_s for m in of(before, AutopilotClock)) > 25.0
    assert min(m.boot_s for m in of(after, AutopilotClock)) < 5.0
    assert len(of(one.run(10.0), BatteryStatus)) >= 9
    assert one.links.vehicle == (1, 1)


def test_a_message_that_never_comes_is_asked_for_ever_more_rarely(world):
    one = world()
    one.vehicle.firmware.wind_id = -1  # knows no wind
    one.run(300.0)
    (report,) = one.links.reports
    assert 8 <= report.requests - 7 <= 12


def test_a_flood_is_read_as_it_comes(world):
    one = world()
    one.run(5.0)
    one.vehicle.firmware.hurry = 50.0
    said = one.run(20.0)
    assert 990 <= len(of(said, BatteryStatus)) <= 1010
    (report,) = one.links.reports
    assert report.requests == 8


def test_a_third_of_the_frames_lost_is_no_reason_to_ask_again_and_again(world):
    one = world(loss=0.3)
    one.run(10.0)
    said = one.run(200.0)
    assert 110 <= len(of(said, BatteryStatus)) <= 170
    assert not statuses(said, LinkStatus.DOWN)
    (report,) = one.links.reports
    assert report.requests < 30


def test_doubled_and_overtaking_frames_change_nothing_but_a_count(world):
    one = world(double=0.5, overtake=0.2)
    one.run(10.0)
    said = one.run(60.0)
    assert 57 <= len(of(said, BatteryStatus)) <= 62
    (report,) = one.links.reports
    assert report.duplicates > 50
    clocks = [m.boot_s for m in of(said, AutopilotClock)]
    assert max(abs(b - a) for a, b in itertools.pairwise(clocks)) < 3.0
    assert report.requests == 8


def test_garbage_between_and_inside_frames_costs_those_frames_only(world):
    one = world(garbage=0.3)
    one.run(10.0)
    said = one.run(100.0)
    assert 75 <= len(of(said, BatteryStatus)) <= 100
    (report,) = one.links.reports
    assert report.stray_bytes > 200
    assert report.bad_checksums > 50
    for message in of(said, BatteryStatus):
        assert 12.0 < message.voltage_v < 17.0
        assert message.battery_id == 0


def test_a_silence_is_told_and_its_end_too(world):
    one = world(silence=("20:15",))
    said = one.run(60.0)
    assert [m.status for m in of(said, type(statuses(said, LinkStatus.OPEN)[0]))] == [
        LinkStatus.OPEN,
        LinkStatus.ALIVE,
        LinkStatus.OPEN,
        LinkStatus.ALIVE,
    ]
    assert 24.0 < statuses(said, LinkStatus.OPEN)[1].time_s < 27.0
    assert 34.9 < statuses(said, LinkStatus.ALIVE)[1].time_s < 37.0


def test_other_vehicles_our_own_echo_and_px4s_echo_change_nothing(world):
    one = world(autopilot="px4")
    one.run(5.0)
    ours, stranger = FrameEncoder(1), FrameEncoder(77, 1)
    value = NamedValue(time_s=0.0, boot_ms=1, name="BHM_RFT", value=1.0)

    def chatter():
        one.send(ours.companion_heartbeat() + ours.named_value(value))
        one.send(stranger.autopilot_heartbeat(Heartbeat(time_s=0, system=77, component=1, kind=None, armed=True)))
        empty = BatteryStatus(
            time_s=0.0, battery_id=0, voltage_v=9.9, cells_v=None, current_a=99.0,
            temperature_k=None, consumed_c=None, remaining=0.0,
        )  # fmt: skip
        one.send(stranger.battery_status(empty))
        one.links.send(one.links.encoder.named_value(value))

    said = one.run(20.0, others=[chatter])
    assert one.links.vehicle == (1, 1)
    assert {m.system for m in of(said, Heartbeat)} == {1}
    assert min(m.voltage_v for m in of(said, BatteryStatus)) > 12.0
    assert not [m for m in of(said, Heartbeat) if m.armed and m.time_s < 5.0]


@pytest.mark.parametrize("kind", ["udpout", "tcp", "tcpin", "serial"])
def test_everything_at_once_does_no_more_on_any_other_kind_of_link(world, kind, tmp_path):
    one = world(
        kind=kind, folder=tmp_path, batteries=2, loss=0.3, double=0.2, overtake=0.2, garbage=0.1,
        reboot=(40.0,), silence=("60:10",),
    )  # fmt: skip
    one.run(10.0)
    said = one.run(75.0)
    one.vehicle.firmware.hurry = 50.0
    flood = one.run(5.0)
    assert one.links.vehicle == (1, 1)
    for number in (0, 1):
        assert 12 <= len(of(said, BatteryStatus, battery_id=number)) <= 32
        assert 60 <= len(of(flood, BatteryStatus, battery_id=number)) <= 130
    assert all(12.0 < m.voltage_v < 17.0 for m in of(said + flood, BatteryStatus))
    assert (
        min(m.boot_s for m in of(said, AutopilotClock)) < 8.0 < 35.0 < max(m.boot_s for m in of(said, AutopilotClock))
    )
    assert [m.status for m in of(said, LinkState)] == [LinkStatus.OPEN, LinkStatus.ALIVE]
    (report,) = one.links.reports
    assert report.duplicates > 50
    assert report.stray_bytes > 100
    assert report.opened == 1


def test_the_vehicle_that_was_configured_is_followed_though_another_speaks_first():
    port = free_port(socket.SOCK_DGRAM)
    links = Links([f"udpin:127.0.0.1:{port}"], system=5)
    vehicles = [
        vehicle_of(Options(system=n), [transport_of(LinkUrl.parse(f"udpout:127.0.0.1:{port}"))]) for n in (4, 5)
    ]
    try:
        for vehicle in vehicles:
            for _ in range(20):
                vehicle.step()
                links.poll(0.0)
        assert links.vehicle == (5, 1)
        assert links.encoder.system == 5
    finally:
        links.close()
        for vehicle in vehicles:
            vehicle.close()


def test_with_two_links_each_message_counts_once_and_the_other_takes_over():
    ports = [free_port(socket.SOCK_DGRAM) for _ in range(2)]
    clock = [0.0]
    links = Links([f"udpin:127.0.0.1:{port}" for port in ports], clock=lambda: clock[0])
    transports = [transport_of(LinkUrl.parse(f"udpout:127.0.0.1:{port}")) for port in ports]
    vehicle = vehicle_of(Options(flight=300.0), transports)

    def run(seconds):
        said = []
        for _ in range(seconds * 10):
            vehicle.step()
            clock[0] = vehicle.time_s
            while found := links.poll(0.0):
                said += found
        return said

    try:
        run(5)
        both = run(20)
        assert 19 <= len([m for _, m in both if isinstance(m, BatteryStatus)]) <= 21
        bearer = {n for n, m in both if isinstance(m, BatteryStatus)}
        assert len(bearer) == 1
        vehicle.cut(*bearer)
        run(6)
        after = run(20)
        assert 19 <= len([m for _, m in after if isinstance(m, BatteryStatus)]) <= 21
        assert {n for n, m in after if isinstance(m, BatteryStatus)} == {0, 1} - bearer
    finally:
        links.close()
        vehicle.close()


def test_a_peer_that_fell_silent_is_told_nothing_more():
    """pymavlink's udpin goes on sending to every address that it ever heard."""
    clock, port = [0.0], free_port(socket.SOCK_DGRAM)
    transport = UdpTransport(LinkUrl.parse(f"udpin:127.0.0.1:{port}"), clock=lambda: clock[0])
    transport.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.settimeout(0.2)
        peer.connect(("127.0.0.1", port))
        peer.send(b"hello")
        assert [data for _, data in transport.receive()] == [b"hello"]
        transport.send(b"one")
        assert peer.recv(100) == b"one"
        clock[0] = 60.0
        transport.send(b"two")
        with pytest.raises(TimeoutError):
            peer.recv(100)
    transport.close()


def test_a_stream_that_nobody_reads_loses_whole_frames_and_says_how_many():
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    listener.bind(("127.0.0.1", 0))
    listener.listen()
    transport = transport_of(LinkUrl.parse(f"tcp:127.0.0.1:{listener.getsockname()[1]}"))
    frame, sent = FrameEncoder(1).companion_heartbeat(), 0
    try:
        transport.open()
        peer = listener.accept()[0]
        while not transport.ready:
            transport.receive()
        while transport.lost_frames < 100:
            transport.send(frame)
            sent += 1
        splitter, arrived = FrameSplitter(), 0
        while arrived < sent - transport.lost_frames:
            arrived += len(splitter.feed(peer.recv(1 << 20)))
            transport.receive()  # sends what waits
        assert splitter.stray_bytes == splitter.bad_checksums == 0
        peer.close()
    finally:
        transport.close()
        listener.close()


def test_a_setting_is_asked_for_until_it_is_told_and_one_that_does_not_exist_only_for_a_while(world):
    one = world(settings=("BATT_OPTIONS", "NO_SUCH"), loss=0.3)
    one.vehicle.firmware.parameters["BATT_OPTIONS"] = 64.0
    said = one.run(30.0)
    assert {(m.name, m.value) for m in of(said, ParameterValue)} == {("BATT_OPTIONS", 64.0)}
    assert one.links.reports[0].frames_out < 30 + 5 + 5 + one.links.reports[0].requests + 5


class OldArduPilot(ArduPilot):
    """Knows no message intervals, only streams."""

    def command(self, channel, asked, source):
        refused = mavlink.MAV_RESULT_UNSUPPORTED
        return [mavlink.MAVLink_command_ack_message(asked["command"], refused, 0, 0, *source)]


def test_an_autopilot_that_knows_no_message_intervals_is_asked_for_streams(world):
    one = world()
    one.vehicle.firmware.__class__ = OldArduPilot
    one.run(40.0)
    assert len(of(one.run(10.0), BatteryStatus)) == 10


def test_the_hosts_clock_may_be_set_in_flight_while_everything_is_signed(tmp_path):
    wall, port = [1_790_000_000.0], free_port(socket.SOCK_DGRAM)
    key = tmp_path / "key"
    key.write_text("5a" * 32)
    key.chmod(0o600)
    options = Options(flight=600.0, signing_key=key)
    vehicle = vehicle_of(options, [transport_of(LinkUrl.parse(f"udpout:127.0.0.1:{port}"))])
    vehicle.firmware.epoch_s = wall[0]
    links = Links([f"udpin:127.0.0.1:{port}"], key=read_key(key), clock=lambda: vehicle.time_s, wall=lambda: wall[0])
    try:
        for jump in (0.0, 3600.0, -7200.0, 86_400.0 * 400.0, -86_400.0 * 400.0):
            wall[0] += jump
            heard, asked = 0, links.reports[0].requests
            for _ in range(300):
                vehicle.step()
                wall[0] += 0.1
                while found := links.poll(0.0):
                    heard += sum(isinstance(m, BatteryStatus) for _, m in found)
            assert heard >= 28, jump
            assert links.reports[0].requests - asked <= 8, jump
        assert links.reports[0].replayed == links.reports[0].forged == 0
    finally:
        links.close()
        vehicle.close()
