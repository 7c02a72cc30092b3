import random

from hypothesis import given, settings
from hypothesis import strategies as st
from mavlink.frames import Sender, battery_status, heartbeat, sys_status
from mavlink.fuzzing import checksummed

from bhm_service.mavlink.frames import FrameSplitter


def stream(count=30):
    send = Sender()
    return [send((heartbeat(), battery_status(), sys_status())[k % 3]) for k in range(count)]


@given(st.lists(st.integers(1, 90), min_size=1, max_size=60))
@settings(max_examples=60, deadline=None)
def test_pieces_of_any_size_give_the_same_frames(sizes):
    frames = stream()
    data, splitter, found = b"".join(frames), FrameSplitter(), []
    at = 0
    while at < len(data):
        size = sizes[len(found) % len(sizes)]
        found += splitter.feed(data[at : at + size])
        at += size
    assert [f.raw for f in found] == frames
    assert splitter.stray_bytes == 0


def test_garbage_is_counted_and_costs_no_frame():
    frames = stream(6)
    splitter = FrameSplitter()
    found = splitter.feed(b"\x00\x11\xfd\x22" + frames[0] + b"noise" + b"".join(frames[1:]))
    found += splitter.feed(b"\x00" * 300)
    assert [f.raw for f in found] == frames
    assert splitter.stray_bytes + splitter.bad_checksums > 5


def test_messages_of_a_maker_s_own_cost_no_frame_and_are_not_called_damaged():
    own = bytes([0xFD, 5, 0, 0, 7, 1, 1, 0x10, 0xEE, 0x0A]) + b"12345" + b"\x5a\xa5"  # kind 716304, which nobody knows
    frames = stream(30)
    splitter = FrameSplitter()
    found = splitter.feed(b"".join(frame + own for frame in frames)) + splitter.feed(b"\x00" * 300)
    assert [f.raw for f in found] == frames
    assert splitter.bad_checksums == 0


def test_a_flipped_bit_costs_one_frame():
    frames = stream(30)
    rng = random.Random(15)
    for victim in range(2, 28):
        data = bytearray(b"".join(frames))
        start = sum(map(len, frames[:victim]))
        data[start + rng.randrange(10, len(frames[victim]))] ^= 1 << rng.randrange(8)
        splitter = FrameSplitter()
        found = splitter.feed(bytes(data)) + splitter.feed(b"\x00" * 600)
        assert [f.raw for f in found] == frames[:victim] + frames[victim + 1 :]


@given(st.binary(max_size=2000))
@settings(max_examples=200, deadline=None)
def test_noise_raises_nothing_and_is_not_kept(noise):
    splitter = FrameSplitter()
    splitter.feed(noise)
    assert len(splitter._left) <= 280


def test_a_frame_with_a_flag_that_is_not_known_is_not_read():
    """The protocol says so: such a frame may be laid out in another way."""
    frame = bytearray(stream(1)[0])
    frame[2] = 0x02
    frame = checksummed(bytes(frame))
    assert FrameSplitter().feed(checksummed(stream(1)[0])) != []
    assert FrameSplitter().feed(frame + bytes(300)) == []
