"""Every transport over a real socket or a pseudo terminal: an autopilot comes, goes and comes back."""

from __future__ import annotations

import time

import pytest
from mavlink.wire import Autopilot, SerialEnd, TcpEnd, UdpEnd, count, poll_until, statuses

from bhm_service.errors import BadInputError
from bhm_service.mavlink.dialect import mavlink
from bhm_service.mavlink.links import Links
from bhm_service.messages import BatteryStatus, LinkStatus

BATTERY = count(BatteryStatus)


@pytest.fixture(params=["udpin", "udpout", "tcp", "tcpin", "serial"])
def end(request, tmp_path):
    kind = request.param
    made = SerialEnd(tmp_path) if kind == "serial" else TcpEnd(kind) if kind.startswith("tcp") else UdpEnd(kind)
    yield made
    made.down()


def ids(frames):
    return [frame.message_id for frame in frames]


def test_an_autopilot_that_comes_goes_and_comes_back_is_heard_again(end):
    links = Links([end.url])
    try:
        assert not statuses([m for _, m in links.poll(0.3)], LinkStatus.ALIVE)
        end.up()
        first = Autopilot(end)
        poll_until(links, BATTERY, first)
        assert links.vehicle == (1, 1)
        end.down()
        poll_until(links, lambda said: any(m.status is not LinkStatus.ALIVE for m in statuses_all(said)))
        end.up()
        again = Autopilot(end, boot_ms=0)
        said = poll_until(links, lambda said: BATTERY(said) and asked(again), again)
        assert statuses(said, LinkStatus.ALIVE)
    finally:
        links.close()
    for heard in (first.heard, again.heard):
        assert {frame.source for frame in heard} == {(1, 191)}
        assert mavlink.MAVLINK_MSG_ID_HEARTBEAT in ids(heard)


def statuses_all(said):
    return [m for status in LinkStatus for m in statuses(said, status)]


def asked(autopilot):
    return ids(autopilot.heard).count(mavlink.MAVLINK_MSG_ID_COMMAND_LONG) >= 8


def test_we_speak_before_we_are_spoken_to(end):
    """Routers and autopilots forward only to where somebody has transmitted."""
    if end.url.startswith(("udpin", "tcpin")):
        pytest.skip("there is nobody yet to speak to")
    end.up()
    silent = Autopilot(end)
    silent.messages = list
    links = Links([end.url])
    try:
        poll_until(links, lambda said: silent.heard, silent)
    finally:
        links.close()
    assert ids(silent.heard)[0] == mavlink.MAVLINK_MSG_ID_HEARTBEAT


def test_a_link_that_is_down_is_waited_for_without_a_busy_loop(end):
    rounds = 0

    def clock():
        nonlocal rounds
        rounds += 1
        return time.monotonic()

    links = Links([end.url], clock=clock)
    try:
        until = time.monotonic() + 1.5
        while time.monotonic() < until:
            links.poll(0.5)
    finally:
        links.close()
    assert rounds < 100


@pytest.mark.parametrize(
    "url", ["serial:/dev/ttyS0", "serial:/dev/ttyS0:fast", "udpin:14550", "udp:127.0.0.1:14550", "tcp::5760", ""]
)
def test_a_url_that_cannot_be_says_what_can(url):
    with pytest.raises(BadInputError, match="serial:DEVICE:BAUD"):
        Links([url])


def test_a_host_that_is_not_known_is_told_and_tried_again():
    links = Links(["tcp:no-such-host.invalid:5760"])
    try:
        said = poll_until(links, lambda said: any("is not known" in m.because for m in statuses_all(said)))
        assert {m.status for m in statuses_all(said)} == {LinkStatus.DOWN}
    finally:
        links.close()


def test_a_name_leads_to_the_same_place_as_its_number():
    end = TcpEnd("tcp")
    end.up()
    links = Links([end.url.replace("127.0.0.1", "localhost")])
    try:
        poll_until(links, BATTERY, Autopilot(end))
    finally:
        links.close()
        end.down()
