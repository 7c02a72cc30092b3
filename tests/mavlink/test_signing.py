"""Signing against pymavlink's own, in both directions, and over a real socket."""

from __future__ import annotations

import hashlib
import time

import pytest
from mavlink.frames import Sender, battery_status, heartbeat, mav
from mavlink.wire import Autopilot, UdpEnd, count, poll_until

from bhm_service.errors import BadInputError
from bhm_service.mavlink.encode import FrameEncoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.mavlink.links import Links
from bhm_service.mavlink.signing import Refusal, Signer, read_key
from bhm_service.messages import BatteryStatus, Event, NamedValue

KEY, OTHER = hashlib.sha256(b"ours").digest(), hashlib.sha256(b"theirs").digest()
NOW = 1_790_000_000.0


def signing(sender, key=KEY, unix_s=NOW, link=0):
    """pymavlink's own signing, on a sender."""
    sign = sender.mav.signing
    sign.secret_key, sign.link_id, sign.sign_outgoing = key, link, True
    sign.timestamp = int((unix_s - 1_420_070_400) * 1e5)
    return sender


def split(data):
    (frame,) = FrameSplitter().feed(data)
    return frame


def check(signer, data, unix_s=NOW):
    frame = split(data)
    return signer.check(frame.raw, frame.message_id, unix_s)


def test_what_we_sign_pymavlink_believes():
    reader = signing(Sender()).mav
    encoder, signer = FrameEncoder(1), Signer(KEY)
    for k in range(5):
        value = NamedValue(time_s=0.0, boot_ms=k, name="BHM_RFT", value=300.0 + k)
        for frame in (encoder.companion_heartbeat(), encoder.named_value(value)):
            signed = signer.sign(frame, 3, NOW)
            message = reader.parse_char(signed)
            assert message.get_signed()
            assert message.get_link_id() == 3
    assert message.value == 304.0


def test_what_pymavlink_signs_we_believe_once():
    send, signer = signing(Sender()), Signer(KEY)
    frames = [send(heartbeat()) for _ in range(5)]
    assert [check(signer, frame) for frame in frames] == [None] * 5
    assert [check(signer, frame) for frame in frames] == [Refusal.REPLAYED] * 5


def test_a_forged_frame_from_the_future_does_not_shut_out_the_real_stream():
    signer, forger, real = Signer(KEY), signing(Sender(), OTHER, NOW + 1e6), signing(Sender())
    assert check(signer, forger(heartbeat())) is Refusal.FORGED
    assert check(signer, real(heartbeat())) is None
    assert check(signer, forger(heartbeat())) is Refusal.FORGED
    assert check(signer, real(heartbeat())) is None


def test_every_flipped_bit_of_a_signed_frame_is_refused():
    frame, signer = signing(Sender())(battery_status()), Signer(KEY)
    for at in range(len(frame) * 8):
        forged = bytearray(frame)
        forged[at // 8] ^= 1 << at % 8
        found = FrameSplitter().feed(bytes(forged) + bytes(300))
        assert all(signer.check(f.raw, f.message_id, NOW) is not None for f in found)
    assert check(signer, frame) is None


def test_an_old_recording_is_refused_even_after_a_restart_of_ours():
    assert check(Signer(KEY), signing(Sender(), unix_s=NOW - 61.0)(heartbeat())) is Refusal.REPLAYED
    assert check(Signer(KEY), signing(Sender(), unix_s=NOW - 59.0)(heartbeat())) is None


def test_our_signatures_grow_even_when_our_clock_is_set_back():
    signer, reader = Signer(KEY), signing(Sender()).mav
    frame = FrameEncoder(1).companion_heartbeat()
    for unix_s in (NOW, NOW, NOW - 3600.0, NOW - 3600.0):
        assert reader.parse_char(signer.sign(frame, 0, unix_s)) is not None


def test_only_a_radio_may_go_unsigned():
    radio = mav.MAVLink_radio_status_message(100, 100, 50, 10, 10, 0, 0)
    assert check(Signer(KEY), Sender()(radio)) is None
    assert check(Signer(KEY), Sender()(heartbeat())) is Refusal.UNSIGNED
    assert check(Signer(KEY), Sender(v1=True)(heartbeat())) is Refusal.UNSIGNED


@pytest.fixture
def key_file(tmp_path):
    path = tmp_path / "mavlink.key"
    path.write_text(KEY.hex() + "\n")
    path.chmod(0o600)
    return path


def test_a_key_file_is_32_bytes_or_their_hexadecimal_digits(key_file):
    assert read_key(key_file) == KEY
    key_file.write_bytes(KEY)
    assert read_key(key_file) == KEY


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o622, 0o755])
def test_a_key_that_others_may_use_is_refused_with_the_remedy(key_file, mode):
    key_file.chmod(mode)
    with pytest.raises(BadInputError, match=f"mode {mode:04o}\\)\n  chmod 600"):
        read_key(key_file)


def test_a_key_that_systemd_hands_over_is_guarded_by_systemd(key_file, monkeypatch):
    key_file.chmod(0o440)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(key_file.parent))
    assert read_key(key_file) == KEY


@pytest.mark.parametrize("content", [b"", b"secret", KEY[:31], KEY.hex()[:-1].encode(), b"\xff" * 64])
def test_what_is_no_key_is_refused_with_the_remedy(key_file, content):
    key_file.write_bytes(content)
    with pytest.raises(BadInputError, match=r"64 hexadecimal digits.*\n.*openssl rand"):
        read_key(key_file)


def test_a_missing_key_is_named(tmp_path):
    with pytest.raises(BadInputError, match=r"nowhere.key: no such file"):
        read_key(tmp_path / "nowhere.key")


@pytest.fixture
def end():
    made = UdpEnd("udpout")
    made.up()
    yield made
    made.down()


def test_over_a_link_only_the_signed_autopilot_is_heard_and_all_we_say_is_signed(end):
    links = Links([end.url], key=KEY)
    now = time.time()
    forger, unsigned, real = (Autopilot(end, system) for system in (7, 8, 9))
    forger.send, real.send = signing(forger.send, OTHER, now + 1e6), signing(real.send, KEY, now)
    try:
        said = poll_until(links, lambda said: sum(isinstance(m, Event) for m in said) >= 1, forger, unsigned)
        assert links.vehicle is None
        assert not any(isinstance(m, BatteryStatus) for m in said)
        poll_until(links, count(BatteryStatus), forger, unsigned, real)
        assert links.vehicle == (9, 1)
        (report,) = links.reports
    finally:
        links.close()
    assert report.forged > 0
    assert report.unsigned > 0
    assert report.replayed == 0
    heard = forger.heard + unsigned.heard + real.heard
    reader = signing(Sender()).mav
    assert len(heard) > 5
    assert all(reader.parse_char(frame.raw).get_signed() for frame in sorted(heard, key=lambda f: f.raw[-12:-6][::-1]))


@pytest.mark.parametrize("unset", [0.0, 1_420_070_400.0 + 60.0])
def test_nothing_is_signed_or_believed_while_the_clock_is_unset_and_it_says_so(end, unset):
    wall = [unset]
    links = Links([end.url], key=KEY, wall=lambda: wall[0])
    real = Autopilot(end)
    real.send = signing(real.send, KEY, NOW)
    try:
        said = poll_until(links, lambda said: any(isinstance(m, Event) for m in said), real)
        (event,) = [m for m in said if isinstance(m, Event)]
        assert "the clock is not set" in event.text
        assert not real.heard
        assert links.vehicle is None
        wall[0] = NOW
        poll_until(links, count(BatteryStatus), real)
    finally:
        links.close()
