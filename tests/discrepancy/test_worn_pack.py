"""Real flights of a racing quadrotor: two new packs tell the battery file, the worn one its growth of resistance."""

from __future__ import annotations

import json

import pytest
from discrepancy.commanded import bhm

NEW, WORN = ("flight_29.csv", "flight_32.csv"), "flight_31.csv"
CYCLES = {NEW[0]: 2, WORN: 200, NEW[1]: 3}


@pytest.fixture(scope="module")
def explained(data, tmp_path_factory):
    """What is found of all three flights with the file of the new packs."""
    folder, out = data / "flights" / "karl_fpv", tmp_path_factory.mktemp("worn")
    battery, sidecar = out / "new.toml", out / "flights.csv"
    flights = [word for name in NEW for word in ("--flights", folder / name)]
    bhm("identify", *flights, "--series", 4, "--capacity-ah", 1.5, "-o", battery)
    sidecar.write_text("file,cycles\n" + "".join(f"{name},{count}\n" for name, count in CYCLES.items()))
    bhm("explain", *(folder / name for name in CYCLES), "--battery", battery, "--sidecar", sidecar, "-o", out / "found")
    return json.loads((out / "found" / "findings.json").read_text())


def test_the_growth_of_the_worn_packs_resistance_is_named(explained):
    """By throttle steps 39-53 mOhm where the new ones have 14-32 mOhm: 1.4 times as much again, or more."""
    assert explained["verdict"] == "named"
    (effect,) = explained["effects"]
    assert effect["id"] == "resistance-growth"
    growth = effect["parameters"]["growth"]
    assert growth["value"] - 1.64 * growth["sd"] < 1.4 < growth["value"] + 1.64 * growth["sd"]


def test_its_flight_is_foretold_better_from_its_first_quarter(explained):
    fit = explained["fit"]
    assert fit["heldout_after_V"] < 0.75 * fit["heldout_before_V"]
