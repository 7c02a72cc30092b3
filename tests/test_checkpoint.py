"""The checkpoint's file, and where it lies."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from bhm_service.checkpoint import Checkpoint, CheckpointFile, Witness, host_boot, state_folder


def kept(time_s=100.0):
    return Checkpoint(
        time_s=time_s, monotonic_s=time_s, host_boot="b", version="1", belongs_to="p",
        witness=Witness(system=1, boot_at_s=10.0), states={"estimator-circ": {"track": None}},
    )  # fmt: skip


@pytest.fixture
def synced(monkeypatch):
    """Every path that is brought to the card."""
    paths = []
    real = os.fsync

    def fsync(descriptor):
        paths.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    return paths


def test_what_is_written_is_what_is_read(tmp_path):
    file = CheckpointFile(tmp_path / "new" / "checkpoint")
    assert file.read() is None
    file.write(kept())
    assert file.read() == kept()
    file.write(kept(101.0))
    assert file.read().time_s == 101.0
    file.close()


def test_ten_minutes_of_seconds_reach_the_card_twenty_times_and_every_landing_does(tmp_path, synced):
    file = CheckpointFile(tmp_path / "checkpoint")
    for k in range(600):
        file.write(kept(float(k)))
        file.close()
    assert synced.count("checkpoint") == 20
    file.write(kept(600.5), landed=True)
    file.close()
    file.write(kept(601.5))
    file.close()
    assert synced.count("checkpoint") == 21
    assert synced.count(tmp_path.name) == 21  # the name is in the folder


def test_what_replaces_a_file_on_its_way_to_the_card_is_brought_there_too(tmp_path, monkeypatch):
    """The card has the new name by then: without the data it would be a damaged file after a loss of power."""
    file, real, on_card = CheckpointFile(tmp_path / "checkpoint"), os.fsync, []

    def slow(descriptor):
        real(descriptor)
        on_card.append(os.fstat(descriptor).st_ino)
        if len(on_card) == 1:
            file.write(kept(101.0))

    monkeypatch.setattr(os, "fsync", slow)
    file.write(kept(100.0))
    file.close()
    assert file.read() == kept(101.0)
    assert on_card[2:] == [file.path.stat().st_ino, tmp_path.stat().st_ino]


def test_a_boot_of_this_computer_has_a_name():
    assert host_boot() == host_boot() != ""


@pytest.mark.parametrize(
    ("environment", "folder"),
    [
        ({"STATE_DIRECTORY": "/var/lib/bhm", "HOME": "/root"}, "/var/lib/bhm"),
        ({"STATE_DIRECTORY": "/var/lib/bhm:/var/lib/other"}, "/var/lib/bhm"),
        ({"XDG_STATE_HOME": "/x", "HOME": "/home/pi"}, "/x/bhm"),
        ({"HOME": "/home/pi"}, "/home/pi/.local/state/bhm"),
    ],
)
def test_state_lies_where_systemd_or_the_user_wants_it(environment, folder):
    assert state_folder(environment) == Path(folder)
