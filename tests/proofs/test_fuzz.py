"""The byte path under a million mutated frames and pieces of logs (`make proofs`)."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mavlink import fuzzing

PROGRAMS = st.binary(min_size=fuzzing.PROGRAM, max_size=fuzzing.PROGRAM)
QUARTER = 250_000 // fuzzing.FRAMES
LONG = settings(
    max_examples=QUARTER, deadline=None, database=None, print_blob=True, suppress_health_check=list(HealthCheck)
)


@given(PROGRAMS)
@LONG
def test_a_quarter_of_a_million_in_streams(program):
    fuzzing.stream_gives_only_sound_frames(program)


@given(PROGRAMS)
@LONG
def test_a_quarter_of_a_million_of_nonsense_with_a_right_checksum(program):
    fuzzing.nonsense_that_looks_sound_gives_finite_messages(program)


@given(PROGRAMS)
@LONG
def test_a_quarter_of_a_million_in_pieces_of_logs(program):
    fuzzing.pieces_of_a_log_give_only_sound_frames(program)


@pytest.fixture(scope="module")
def links():
    made = fuzzing.SignedLinks()
    yield made
    made.close()


@given(program=PROGRAMS)
@LONG
def test_a_quarter_of_a_million_forged_over_a_socket(links, program):
    links.forged_frames_change_nothing(program)
