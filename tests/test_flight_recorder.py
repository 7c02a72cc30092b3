"""The flight recorder's files: whole, rotating, damaged, on a full disk."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from dataclasses import replace
from itertools import islice

import pytest
from executive.flight import Notebook, play, quad, seconds

from bhm_service.apps.recorder import RecorderApp
from bhm_service.assembly import assemble
from bhm_service.codec import packed
from bhm_service.config import Service
from bhm_service.equipment import recorded_equipment
from bhm_service.flight_recorder import FILE_HEAD, SegmentReader, Segments, segments_of
from bhm_service.mavlink.log import read_log
from bhm_service.messages import Event, EventCode, Input, Message, NamedValue, RemainingTime, Standing, StatusText, Tick
from bhm_service.replay import replay, reproduced
from bhm_service.session import Recording, Session

HEAD = {
    "vehicle": quad().vehicle.model_dump(mode="json"),
    "battery": quad().battery_text,
    "service": Service().model_dump(mode="json"),
}


def recorded(folder, flight, limit=10_000_000, equipment=None, head=HEAD):
    """Record a flight; what was said of it and how it ended."""
    segments = Segments(folder, limit)
    sink = Notebook(NamedValue, StatusText, Event, RemainingTime)
    bus = assemble(equipment or quad(), Service(), [sink, RecorderApp(segments.add)])
    session = Session(bus, None, Recording(segments, head), 1000.0)
    for messages in flight:
        for message in messages:
            if isinstance(message, Tick):
                session.tick(message.time_s)
            else:
                session.take(message)
    session.close(messages[-1].time_s + 1.0)
    return sink.heard


@pytest.fixture(scope="module")
def flight():
    return list(islice(seconds(flight_s=100.0), 150))


@pytest.fixture(scope="module")
def recording(flight, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    return folder, recorded(folder, flight)


def said(heard):
    return [m for m in heard if isinstance(m, NamedValue | StatusText)]


def test_a_replay_of_a_recording_says_exactly_what_was_said(recording):
    folder, heard = recording
    (segment,) = segments_of(folder)
    log = read_log(segment)
    pages = replay(log, quad(), Service(), as_recorded=True)
    assert [m for _, m in pages.outgoing] == said(heard)
    assert len(said(heard)) > 1000
    assert "exactly" in reproduced(log, pages)
    assert not log.skipped


def test_a_flight_with_new_physics_in_the_shadow_of_the_old_is_replayed_too(flight, tmp_path):
    equipment = replace(quad(), shadow=quad())
    heard = recorded(tmp_path, flight[:40], equipment=equipment, head={**HEAD, "shadow": HEAD["battery"]})
    log = read_log(segments_of(tmp_path)[0])
    again, service = recorded_equipment(log.recorded, "recording")
    assert again.shadow.battery == equipment.shadow.battery
    pages = replay(log, again, service, as_recorded=True)
    assert [m for _, m in pages.outgoing] == said(heard)


def test_every_message_of_the_bus_is_in_the_recording(flight, tmp_path):
    segments = Segments(tmp_path, 10_000_000)
    everything = Notebook(*RecorderApp.hears)
    bus = assemble(quad(), Service(), [everything, RecorderApp(segments.add)])
    segments.begin({})
    play(bus, flight[:30])
    segments.close()
    rows = list(SegmentReader(segments_of(tmp_path)[0].read_bytes()))
    assert rows[1:] == json.loads(json.dumps([[type(m).__name__, packed(m, bulk=False)] for m in everything.heard]))
    assert len({kind for kind, _ in rows}) >= 14


def test_an_hour_of_flight_takes_about_two_megabytes(recording):
    (segment,) = segments_of(recording[0])
    assert segment.stat().st_size * 3600.0 / 150.0 < 3_000_000


def test_a_segment_in_the_middle_of_a_flight_is_replayed_by_itself(flight, tmp_path):
    heard = recorded(tmp_path, flight, limit=300_000)
    parts = segments_of(tmp_path)
    assert len(parts) >= 2
    words = []
    for part in parts:
        log = read_log(part)
        pages = replay(log, quad(), Service(), as_recorded=True)
        assert "exactly" in reproduced(log, pages)
        words += [m for _, m in pages.outgoing]
    assert words == said(heard)


def test_all_segments_together_stay_below_the_limit_and_the_oldest_go(tmp_path):
    limit, noise = 100_000, random.Random(1)
    segments = Segments(tmp_path, limit)
    for k in range(3000):
        if segments.fullness >= 1.0:
            segments.begin({"number": k})
        segments.add("noise", noise.randbytes(30).hex())
        segments.flush()
        assert sum(p.stat().st_size for p in tmp_path.iterdir()) <= limit + 500
    segments.close()
    numbers = [int(p.stem) for p in segments_of(tmp_path)]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert len(numbers) in (7, 8)
    assert numbers[0] > 1


def test_a_recording_that_was_cut_off_is_read_to_its_last_whole_second(recording, tmp_path):
    (segment,) = segments_of(recording[0])
    (tmp_path / "cut").write_bytes(segment.read_bytes()[:-37])
    log = read_log(tmp_path / "cut")
    assert log.skipped.truncated
    whole = read_log(segment)
    assert 0 < len(whole.messages) - len(log.messages) < 30
    assert log.messages == whole.messages[: len(log.messages)]


def test_damage_in_the_middle_costs_at_most_half_a_minute_and_is_counted(recording, tmp_path):
    (segment,) = segments_of(recording[0])
    data = segment.read_bytes()
    whole = read_log(segment)
    noise = random.Random(2)
    for _ in range(20):
        at = noise.randrange(2000, len(data) - 2000)
        damaged = data[:at] + noise.randbytes(40) + data[at + 40 :]
        (tmp_path / "damaged").write_bytes(damaged)
        log = read_log(tmp_path / "damaged")
        assert log.skipped.bytes > 0
        lost = {m.time_s for _, m in whole.messages} - {m.time_s for _, m in log.messages}
        assert max(lost) - min(lost) <= 31.0
        assert {m for _, m in log.messages} <= {m for _, m in whole.messages}


def test_nothing_that_a_file_may_hold_is_more_than_unreadable():
    noise = random.Random(3)
    for length in (0, 1, 10, 100, 5000):
        rows = list(SegmentReader(FILE_HEAD + noise.randbytes(length)))
        assert rows == []


def test_inputs_and_what_the_apps_say_are_two_kinds_of_message():
    from typing import get_args

    bus = assemble(quad(), Service())
    says = {kind for app in bus.apps for kind in app.says}
    assert says | set(get_args(Input)) == set(get_args(Message)) - {Standing}  # said where two chains fly
    assert not says & set(get_args(Input))


FULL = """
import resource, sys
sys.path[:0] = ["tests", "."]
from pathlib import Path
from test_flight_recorder import recorded
from executive.flight import seconds
from bhm_service.messages import Event, RemainingTime

resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
flight = [s for k, s in enumerate(seconds()) if k < 150]
heard = recorded(Path(sys.argv[1]), flight)
print(*(m.text for m in heard if isinstance(m, Event) and m.code.name == "RECORDING_STOPPED"), sep="\\n")
print(len([m for m in heard if isinstance(m, RemainingTime)]))
"""


def test_a_full_disk_stops_the_recording_and_not_the_service(tmp_path):
    run = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, timeout=120, check=True
    )
    *events, count = run.stdout.splitlines()
    assert count == "151"
    assert events
    assert events[0].startswith("the flight recorder stopped: ")
    assert events[0].endswith("; tried again every minute")
    for segment in segments_of(tmp_path):
        reader = SegmentReader(segment.read_bytes())
        assert [kind for kind, _ in reader][:2] == ["head", "states"]
        assert reader.lost.bytes == 0  # what was begun was cut off where it was whole


def test_a_folder_that_cannot_be_is_told_and_costs_nothing(flight, tmp_path):
    (tmp_path / "file").write_text("")
    heard = recorded(tmp_path / "file" / "recordings", flight[:70])
    events = [m for m in heard if isinstance(m, Event) and m.code is EventCode.RECORDING_STOPPED]
    assert len(events) == 1
    assert heard[-1].time_s > 1070.0
