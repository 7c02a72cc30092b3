"""Links, apps and wire in simulated time, over real sockets, while everything goes wrong: what the ground is told."""

from __future__ import annotations

import math
import socket

import pytest
from mavlink.wire import free_port

from bhm_service.assembly import assemble
from bhm_service.config import Prediction, Service, shipped
from bhm_service.equipment import equipment_of
from bhm_service.mavlink.dialect import mavlink, unpack
from bhm_service.mavlink.encode import FrameEncoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.mavlink.links import Links
from bhm_service.mavlink.transport import LinkUrl
from bhm_service.mavlink.transports import transport_of
from bhm_service.service import Wire
from bhm_service.session import Session
from sim.battery import SimulatedPack
from sim.command import Options, vehicle_of
from sim.multirotor import Phase

SECONDS = 75
FEW = Service(prediction=Prediction(samples=30))
VALUE = mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT
TROUBLES = {
    "calm": {},
    "px4": {"autopilot": "px4"},
    "two batteries": {"batteries": 2, "capacity": 2.5},
    "a third lost": {"loss": 0.3},
    "garbage": {"garbage": 0.3},
    "doubled and overtaking": {"double": 0.5, "overtake": 0.2},
    "reboot": {"reboot": (35.0,)},
    "silence": {"silence": ("35:20",)},
    "wind": {"wind": 8.0, "gusts": 3.0},
    "flood": {},
}


def hurry(vehicle):
    vehicle.firmware.hurry = 50.0


def stay(vehicle):
    vehicle.multirotor.plan += (Phase(60.0, 0.0),)


def swap(vehicle):
    vehicle.multirotor.pack = SimulatedPack(4, 5.0, left=0.5)
    vehicle.reboot()


def flown(trouble, flight=600.0, happens=None):
    """(second, name, value) of all that reaches the ground, and the charge that is really left.

    ``happens`` to the vehicle at tenths of a second.
    """
    ours, ground = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
    urls = [f"udpout:127.0.0.1:{port}" for port in (ours, ground)]
    options = Options(charge=0.9, flight=flight, **TROUBLES[trouble])
    vehicle = vehicle_of(options, [transport_of(LinkUrl.parse(url)) for url in urls])
    links = Links([f"udpin:127.0.0.1:{ours}"], clock=lambda: vehicle.time_s)
    equipment = equipment_of(shipped("vehicles", "quad-4s.toml"), None)
    bus = assemble(equipment, FEW, [Wire(links, lambda kind, data: None)])
    session = Session(bus, None, None, 0.0)
    happens = happens or ({200: hurry} if trouble == "flood" else {})
    station, splitter, told, peer = FrameEncoder(255, 190), FrameSplitter(), [], None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as screen:
        screen.bind(("127.0.0.1", ground))
        screen.setblocking(False)
        for tenth in range(SECONDS * 10):
            if tenth in happens:
                happens[tenth](vehicle)
            assert vehicle.step()
            while found := links.poll(0.0):
                for _, message in found:
                    session.take(message)
            if tenth % 10 == 9:
                session.tick(vehicle.time_s)
            if tenth % 10 == 0 and peer is not None:
                screen.sendto(station.companion_heartbeat(), peer)  # who does not speak is told nothing
            try:
                while True:
                    data, peer = screen.recvfrom(65535)
                    told += [(vehicle.time_s, frame) for frame in splitter.feed(data)]
            except BlockingIOError:
                pass
    links.close()
    vehicle.close()
    assert {frame.source for _, frame in told} <= {(1, 1), (1, 191)}
    values = []
    for second, frame in told:
        if frame.message_id == VALUE and frame.source == (1, 191):
            fields = unpack(VALUE, frame.payload)
            values.append((second, fields["name"].split(b"\0")[0].decode(), fields["value"]))
    return values, vehicle.multirotor.pack.left


@pytest.fixture(scope="module")
def calm():
    return flown("calm")


@pytest.mark.parametrize("trouble", [name for name in TROUBLES if name != "calm"])
def test_what_the_ground_is_told_stays_finite_steady_and_true(trouble, calm):
    values, left = flown(trouble)
    assert all(math.isfinite(value) for _, _, value in values)
    last = {name: value for _, name, value in values}
    expected = {name: value for _, name, value in calm[0]}
    assert last.keys() == expected.keys()
    assert last["BHM_SOC"] == pytest.approx(left, abs=0.10)
    assert last["BHM_RFTLO"] < last["BHM_RFT"] < last["BHM_RFTHI"]
    if trouble != "two batteries":
        wanted = pytest.approx(expected["BHM_RFT"], rel=0.25)
        assert last["BHM_RFT"] == wanted
    told = [second for second, name, _ in values if name == "BHM_RFT" and second > 10.0]
    lost_on_the_way = 0.45 if trouble in ("a third lost", "garbage") else 0.05
    silent = {"reboot": 9.0, "silence": 22.0}.get(trouble, 0.0)
    assert len(told) >= (1.0 - lost_on_the_way) * (SECONDS - 12 - silent)


def test_a_calm_flight_is_told_every_second_with_every_name(calm):
    values, left = calm
    seconds = [round(second) for second, name, _ in values if name == "BHM_RFT" and second > 10.0]
    assert len(seconds) >= SECONDS - 13
    assert {value for second, name, value in values if name == "BHM_HLTH" and second > 30.0} == {0.0}
    assert {name for _, name, _ in values} >= {"BHM_RFT", "BHM_SOC", "BHM_SOE", "RFT_CIRC", "RFT_CHEM"}
    assert {name: value for _, name, value in values}["BHM_SOC"] == pytest.approx(left, abs=0.08)


def test_another_pack_that_is_put_in_on_the_ground_is_known_by_its_own_charge():
    values, left = flown("calm", flight=35.0, happens={10: stay, 500: swap})
    assert all(math.isfinite(value) for _, _, value in values)
    soc = {round(second): value for second, name, value in values if name == "BHM_SOC"}
    assert soc[48] > 0.8
    assert left == pytest.approx(0.5, abs=0.01)
    assert [soc[second] for second in range(60, SECONDS)] == pytest.approx([left] * (SECONDS - 60), abs=0.10)
