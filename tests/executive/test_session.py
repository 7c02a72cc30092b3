"""A service that ends in the middle of a flight, and the one that is started after it."""

from __future__ import annotations

import dataclasses
import json
import zlib
from itertools import islice, pairwise

import pytest
from executive.flight import Notebook, quad, seconds

from bhm_service.assembly import assemble
from bhm_service.checkpoint import CheckpointFile
from bhm_service.config import Service
from bhm_service.messages import (
    AutopilotClock,
    BatteryStatus,
    Event,
    EventCode,
    Heartbeat,
    RemainingTime,
    SystemStatus,
    Tick,
)
from bhm_service.resumption import Run
from bhm_service.session import Memory, Session

RUN = Run(version="1", belongs_to="this pack", host_boot="boot 1", battery_id=0, max_age_s=120.0)


class Onboard:
    """A session whose clock is that of the flight, with what it told."""

    def __init__(self, path, run=RUN, now_s=1000.0):
        self.sink = Notebook(RemainingTime, Event)
        bus = assemble(quad(), Service(), [self.sink])
        self.session = Session(bus, Memory(run, CheckpointFile(path)), None, now_s)

    def fly(self, flight):
        for messages in flight:
            for message in messages:
                if isinstance(message, Tick):
                    self.session.tick(message.time_s)
                else:
                    self.session.take(message)
        return self

    @property
    def remaining(self):
        return [m for m in self.sink.heard if isinstance(m, RemainingTime)]

    def events(self, *codes):
        return [m for m in self.sink.heard if isinstance(m, Event) and m.code in codes]


@pytest.fixture(scope="module")
def flight():
    return list(islice(seconds(), 130))


@pytest.fixture(scope="module")
def flown(flight, tmp_path_factory):
    """A checkpoint after a minute and a half of flight, and what the service would have gone on to say."""
    path = tmp_path_factory.mktemp("flown") / "checkpoint"
    service = Onboard(path).fly(flight[:100])
    data = path.read_bytes()
    return data, service.fly(flight[100:])


@pytest.fixture
def path(flown, tmp_path):
    (tmp_path / "checkpoint").write_bytes(flown[0])
    return tmp_path / "checkpoint"


def test_a_restart_in_flight_goes_on_with_the_first_report(flight, flown, path):
    after = Onboard(path, now_s=1102.0).fly(flight[102:])
    resumed = after.events(EventCode.RESUMED, EventCode.CHECKPOINT_REFUSED)
    assert [e.code for e in resumed] == [EventCode.RESUMED]
    assert "went on from what was believed 2.5 s ago" in resumed[0].text
    assert after.remaining[0].median_s is not None
    undisturbed = {r.time_s: r for r in flown[1].remaining}
    for now in after.remaining:
        assert now.median_s == pytest.approx(undisturbed[now.time_s].median_s, rel=0.05)
    assert after.remaining[-1].soc == pytest.approx(flown[1].remaining[-1].soc, abs=0.005)


def on_another_boot(messages, by_s):
    """The same flight on a computer that was switched on later: its clock counts from another moment."""
    return [[dataclasses.replace(m, time_s=m.time_s - by_s) for m in second] for second in messages]


def with_date(flight):
    """The same flight, its autopilot knowing the date."""

    def dated(m):
        return dataclasses.replace(m, unix_s=1.7e9 + m.boot_s) if isinstance(m, AutopilotClock) else m

    return [[dated(m) for m in second] for second in flight]


def test_a_computer_that_was_restarted_in_flight_goes_on_when_the_autopilots_date_tells_it_was_not(flight, tmp_path):
    path, dated = tmp_path / "checkpoint", with_date(flight)
    Onboard(path).fly(dated[:100])
    other = dataclasses.replace(RUN, host_boot="boot 2")
    after = Onboard(path, other, now_s=12.0).fly(on_another_boot(dated[120:], 1108.0))
    assert [e.text for e in after.events(EventCode.RESUMED)] == ["went on from what was believed 20.5 s ago"]
    times = [r.time_s for r in after.remaining if r.median_s is not None]
    assert times[0] == pytest.approx(1121.5, abs=0.01)
    assert [b - a for a, b in pairwise(times)] == pytest.approx([1.0] * (len(times) - 1))


def edited(flight, kind, **changes):
    return [[dataclasses.replace(m, **changes) if isinstance(m, kind) else m for m in s] for s in flight]


def shifted(flight, kind, name, by):
    return [
        [dataclasses.replace(m, **{name: getattr(m, name) + by}) if isinstance(m, kind) else m for m in s]
        for s in flight
    ]


def later(flight):
    return on_another_boot(flight, -297.5)


REFUSED = {
    "it is 300 s old, and 120 s is the most": lambda f, run: (shifted(later(f), AutopilotClock, "boot_s", 297.5), run),
    "the autopilot has booted since": lambda f, run: (shifted(f, AutopilotClock, "boot_s", -90.0), run),
    "consumed charge went back: another pack": lambda f, run: (shifted(f, BatteryStatus, "consumed_c", -900.0), run),
    "it is of another vehicle (system 1, now 7)": lambda f, run: (edited(f, Heartbeat, system=7), run),
    "the battery file or the settings are others now": lambda f, run: (f, dataclasses.replace(run, belongs_to="that")),
    "it is of version 1": lambda f, run: (f, dataclasses.replace(run, version="2")),
    "without a date nothing tells whether the autopilot was too": lambda f, run: (
        f, dataclasses.replace(run, host_boot="boot 2")
    ),
    "the autopilot did not tell the time since its boot within 5 s": lambda f, run: (
        [[m for m in s if not isinstance(m, AutopilotClock)] for s in f], run
    ),
    "the autopilot did not tell anything of the battery within 5 s": lambda f, run: (
        [[m for m in s if not isinstance(m, BatteryStatus | SystemStatus)] for s in f], run
    ),
}  # fmt: skip


@pytest.mark.parametrize("why", REFUSED)
def test_a_checkpoint_that_does_not_hold_is_refused_with_the_reason(why, flight, path):
    changed, run = REFUSED[why](flight[102:112], RUN)
    after = Onboard(path, run, now_s=changed[0][0].time_s).fly(changed)
    assert after.events(EventCode.RESUMED) == []
    (event,) = after.events(EventCode.CHECKPOINT_REFUSED)
    assert event.text.startswith("the checkpoint is not used: ")
    assert why in event.text
    assert not after.session.waiting


@pytest.mark.parametrize("by_v", [0.5, -0.5])
def test_another_pack_put_in_on_the_ground_while_the_service_was_away_is_noticed(by_v, tmp_path):
    ground = [s for s in seconds(flight_s=20.0) if not any(isinstance(m, Heartbeat) and m.armed for m in s)][:5]
    ground += [[dataclasses.replace(m, time_s=m.time_s + 5.0) for m in s] for s in ground]
    ground = [
        [dataclasses.replace(m, boot_s=m.time_s - 1000.0) if isinstance(m, AutopilotClock) else m for m in s]
        for s in ground
    ]
    path = tmp_path / "checkpoint"
    Onboard(path).fly(ground[:5])
    data = path.read_bytes()
    other = shifted(shifted(ground[5:], BatteryStatus, "voltage_v", by_v), SystemStatus, "voltage_v", by_v)
    (event,) = Onboard(path, now_s=1006.0).fly(other).events(EventCode.CHECKPOINT_REFUSED)
    assert "another pack: the service was away and the voltage went" in event.text
    path.write_bytes(data)
    assert len(Onboard(path, now_s=1006.0).fly(ground[5:]).events(EventCode.RESUMED)) == 1


@pytest.mark.parametrize(
    "damage",
    [
        lambda d: d[:-20],
        lambda d: d[:900] + bytes([d[900] ^ 1]) + d[901:],
        lambda d: b"",
        lambda d: b"\x00" * 300,
        lambda d: d[::-1],
    ],
    ids=["cut", "changed", "empty", "zeros", "reversed"],
)
def test_a_damaged_file_is_refused_and_replaced(damage, flight, path):
    path.write_bytes(damage(path.read_bytes()))
    after = Onboard(path, now_s=1102.0).fly(flight[102:106])
    (event,) = after.events(EventCode.CHECKPOINT_REFUSED)
    assert "damaged" in event.text
    assert CheckpointFile(path).read().time_s == pytest.approx(1106.5)


def test_states_that_do_not_fit_the_apps_are_refused_by_all_of_them(flight, path):
    _, _, body = path.read_bytes().partition(b"\n")
    kept = json.loads(body)
    kept["states"]["limits"] = {"airborne": "perhaps"}
    body = json.dumps(kept).encode()
    path.write_bytes(b"bhm checkpoint 1 %08x\n" % zlib.crc32(body) + body)
    after = Onboard(path, now_s=1102.0).fly(flight[102:110])
    (event,) = after.events(EventCode.CHECKPOINT_REFUSED)
    assert "limits" in event.text
    assert after.remaining[-1].soc is not None


def test_while_nothing_is_heard_the_service_ticks_and_the_checkpoint_stays(path):
    before = path.read_bytes()
    after = Onboard(path, now_s=1102.0).fly([[Tick(time_s=1102.0 + k)] for k in range(20)])
    assert [r.health for r in after.remaining] == [2] * 20
    assert after.session.waiting
    assert path.read_bytes() == before


def test_a_checkpoint_that_cannot_be_written_is_told_once_and_costs_nothing(flight, tmp_path):
    (tmp_path / "a file").write_text("")
    service = Onboard(tmp_path / "a file" / "checkpoint").fly(flight[:30])
    (event,) = service.events(EventCode.CHECKPOINT_NOT_WRITTEN)
    assert "the checkpoint cannot be written" in event.text
    assert service.remaining[-1].median_s is not None


def test_the_file_is_replaced_whole_and_nothing_else_is_left(flight, tmp_path):
    service = Onboard(tmp_path / "checkpoint").fly(flight[:20])
    service.session.close(1021.0)
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint"]
    assert (tmp_path / "checkpoint").stat().st_size < 40_000
