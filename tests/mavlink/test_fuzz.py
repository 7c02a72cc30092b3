"""A short run of the fuzzing; the long one is tests/proofs/test_fuzz.py."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mavlink import fuzzing

PROGRAMS = st.binary(min_size=fuzzing.PROGRAM, max_size=fuzzing.PROGRAM)
SHORT = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@given(PROGRAMS)
@SHORT
def test_a_stream_of_mutated_frames_gives_only_sound_ones(program):
    fuzzing.stream_gives_only_sound_frames(program)


@given(PROGRAMS)
@SHORT
def test_nonsense_with_a_right_checksum_gives_finite_messages(program):
    fuzzing.nonsense_that_looks_sound_gives_finite_messages(program)


@given(PROGRAMS)
@SHORT
def test_pieces_of_a_mutated_log_give_only_sound_frames(program):
    fuzzing.pieces_of_a_log_give_only_sound_frames(program)


@pytest.fixture(scope="module")
def links():
    made = fuzzing.SignedLinks()
    yield made
    made.close()


@given(program=PROGRAMS)
@SHORT
def test_forged_replayed_and_unsigned_frames_change_nothing(links, program):
    links.forged_frames_change_nothing(program)


def test_the_originals_are_sound_and_the_mutations_mostly_not():
    """The fuzzing itself: it would prove nothing with frames that were broken from the start."""
    frames = fuzzing.originals()
    assert len(frames) > 40
    assert all(fuzzing.sound(frame) for frame in frames)
    assert fuzzing.mutated(bytes(fuzzing.STEP), frames) == frames[0]
    steps = [bytes([k % 256, 1 + k % 7, 0, k % 200, k % 251, k % 13, 0, 0]) for k in range(2000)]
    broken = sum(not fuzzing.sound(fuzzing.mutated(step, frames)) for step in steps)
    assert broken > 1500
