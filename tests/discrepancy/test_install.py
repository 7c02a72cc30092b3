"""`bhm explain --install`: the repaired battery flies in the shadow of the one that was given."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discrepancy.flown import BATTERY

from bhm_service.battery.battery_file import Joined, read_battery, write_battery
from bhm_service.battery.effects import CapacityFade
from bhm_service.commands.explain import Task, install

REPAIRED = replace(BATTERY, joined=(Joined(effect=CapacityFade(fade=0.1), model="circ", sd={"fade": 0.01}),))


@pytest.fixture
def task(tmp_path):
    write_battery(tmp_path / "pack.toml", BATTERY)
    (tmp_path / "0.csv").write_text("a flight")
    return Task(logs=(tmp_path / "0.csv",), battery=tmp_path / "pack.toml", output=tmp_path / "out", install=True)


def test_the_old_file_names_the_new_one_as_its_shadow_and_is_else_what_it_was(task):
    before = task.battery.read_text()
    beside = install(task, REPAIRED)
    given = read_battery(task.battery)
    assert given.shadow == beside.name
    assert given.joined == ()
    assert task.battery.read_text().startswith(before.rstrip())
    assert [j.effect.id for j in read_battery(beside).joined] == ["capacity-fade"]


def test_its_name_is_that_of_the_data_and_the_model(task):
    first = install(task, REPAIRED)
    assert install(task, REPAIRED) == first
    task.logs[0].write_text("another flight")
    assert install(task, REPAIRED) != first
