import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mavlink.frames import EPOCH_US, Sender, battery_status, heartbeat, mav, stamped, sys_status, tlog
from pymavlink import mavutil

from bhm_service.mavlink.decode import WANTED
from bhm_service.mavlink.dialect import mavlink
from bhm_service.mavlink.tlog import TlogReader, looks_like_tlog

ALL = frozenset(mavlink.mavlink_map)


def log_of(count=40, sender=None):
    kinds = (heartbeat(), battery_status(), sys_status(), mav.MAVLink_attitude_message(0, 0.1, 0, 0, 0, 0, 0))
    return tlog([(0.25 * k, kinds[k % 4]) for k in range(count)], sender)


def frames_of(data, wanted=WANTED):
    reader = TlogReader(data, wanted)
    return list(reader), reader.skipped


def test_frames_come_with_stamp_source_and_payload():
    frames, skipped = frames_of(log_of(8), frozenset({0}))
    assert [f.stamp_us - EPOCH_US for f in frames] == [0, 1_000_000]
    assert all(f.source == (1, 1) for f in frames)
    assert not skipped


def test_link_numbers_in_the_stamps_are_no_time():
    data = stamped(Sender()(heartbeat()), 1.0, link=3)
    assert frames_of(data)[0][0].stamp_us == EPOCH_US + 1_000_000


def test_mavlink_one_and_signed_frames_are_read():
    link = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key = b"k" * 32
    link.signing.sign_outgoing = True
    signed = stamped(bytes(heartbeat().pack(link)), 2.0)
    old = stamped(Sender(v1=True)(sys_status()), 1.0)
    frames, skipped = frames_of(old + signed + old)
    assert [f.message_id for f in frames] == [1, 0, 1]
    assert not skipped


@pytest.mark.parametrize("name", ["acuasi_quad_flight1.tlog", "pterosoar_hexa_2022-06-02.tlog"])
def test_it_finds_what_pymavlink_finds_in_a_real_log(data, name):
    path = data / "flights" / "tlog" / name
    names = [mavlink.mavlink_map[i].msgname for i in WANTED]
    peer = mavutil.mavlogfile(str(path))
    theirs = []
    while (message := peer.recv_match(type=names)) is not None:
        theirs.append(bytes(message.get_msgbuf()))
    peer.close()
    reader = TlogReader.open(path, WANTED)
    ours = [reader.data[f.begin + 8 : f.end] for f in reader]
    assert ours == theirs


def test_damage_costs_only_the_frames_that_it_hit():
    whole = log_of(400)
    intact, _ = frames_of(whole)
    rng = random.Random(13)
    damaged = bytearray(whole)
    places = [rng.randrange(200, len(whole) - 300) for _ in range(5)]
    for at in places:
        damaged[at : at + 30] = bytes(rng.randrange(256) for _ in range(30))
    survivors = {f.begin: f for f in intact if not any(f.begin < p + 30 and p < f.end for p in places)}
    found, skipped = frames_of(bytes(damaged))
    kept = {f.begin: f for f in found}
    missing = [begin for begin in survivors if begin not in kept]
    assert missing == []
    assert all(kept[b].payload == survivors[b].payload for b in survivors)
    assert skipped
    assert skipped.bytes < 5 * 150


@pytest.mark.parametrize(("wanted", "liar"), [(ALL, 10), (WANTED, 11)], ids=["a wanted frame", "one passed over"])
def test_a_length_that_lies_does_not_swallow_the_frames_behind_it(wanted, liar):
    whole = bytearray(log_of(40))
    frames, _ = frames_of(bytes(whole), ALL)
    whole[frames[liar].begin + 9] = 255
    found, skipped = frames_of(bytes(whole), wanted)
    intact = [f for k, f in enumerate(frames) if f.message_id in wanted and k != liar]
    assert [f.begin for f in found] == [f.begin for f in intact]
    assert skipped.places == 1


def test_garbage_between_frames_is_skipped_and_counted():
    data = log_of(10) + b"\xfd\xfe garbage \xfd" * 9 + log_of(10)
    found, skipped = frames_of(data, ALL)
    assert len(found) == 20
    assert skipped.bytes == 9 * 12
    assert "108 bytes in 1 places" in str(skipped)


@pytest.mark.parametrize("cut", [1, 5, 9, 12, 25])
def test_a_log_that_was_cut_off_is_read_up_to_the_cut(cut):
    data = log_of(20)
    found, skipped = frames_of(data[:-cut], ALL)
    assert len(found) == 19
    assert skipped.truncated


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=400), st.integers(0, 60))
def test_no_bytes_whatever_make_it_raise(noise, at):
    data = log_of(6)
    found, _ = frames_of(data[:at] + noise + data[at:], ALL)
    assert all(f.end > f.begin for f in found)


def test_what_a_tlog_looks_like():
    assert looks_like_tlog(log_of(3))
    assert looks_like_tlog(b"noise" + log_of(3))
    assert not looks_like_tlog(b"this is a text, and no log at all" * 20)
