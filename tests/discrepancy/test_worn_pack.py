"""Real flights of a racing quadrotor: two new packs tell the battery file, the worn one its growth of resistance."""

from __future__ import annotations

import json

import pytest
from commanded import bhm

NEW, WORN = ("flight_29.csv", "flight_32.csv"), "flight_31.csv"
# Made up: the recordings say which pack is worn, not how many cycles it had.
CYCLES = {NEW[0]: 2, WORN: 200, NEW[1]: 3}


@pytest.fixture(scope="module")
def explained(data, tmp_path_factory):
    """What is found of all three flights with the file of the new packs, and the page about it."""
    folder, out = data / "flights" / "karl_fpv", tmp_path_factory.mktemp("worn")
    battery, sidecar = out / "new.toml", out / "flights.csv"
    flights = [word for name in NEW for word in ("--flights", folder / name)]
    bhm("identify", *flights, "--series", 4, "--capacity-ah", 1.5, "-o", battery)
    sidecar.write_text("file,cycles\n" + "".join(f"{name},{count}\n" for name, count in CYCLES.items()))
    bhm("explain", *(folder / name for name in CYCLES), "--battery", battery, "--sidecar", sidecar, "-o", out / "found")
    page = (out / "found" / "report.html").read_text()
    return json.loads((out / "found" / "findings.json").read_text()), page


def test_the_growth_of_the_worn_packs_resistance_is_named(explained):
    """By throttle steps 39-53 mOhm where the new ones have 14-32 mOhm: 1.4 times as much again, or more."""
    findings, _ = explained
    assert findings["verdict"] == "named"
    (effect,) = findings["effects"]
    assert effect["id"] == "resistance-growth"
    growth = effect["parameters"]["growth"]
    assert growth["value"] - 1.64 * growth["sd"] < 1.4 < growth["value"] + 1.64 * growth["sd"]


def test_flights_that_no_fit_saw_are_foretold_better(explained):
    fit = explained[0]["fit"]
    assert fit["heldout_after_V"] < 0.75 * fit["heldout_before_V"]


def test_the_page_says_what_was_left_out_and_lists_nothing_as_unseen_that_was_found(explained):
    """At its usual size the growth is within what a file from flights leaves open; this one is five times that."""
    _, page = explained
    unseen = page.split("What these recordings cannot show")[1].split("Recordings that were left out")[0]
    assert "The pack has lost capacity" in unseen
    assert "resistance has grown" not in unseen
    assert "at rest and below what it reads under load later" in page
