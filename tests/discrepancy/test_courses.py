"""The courses of an explanation: what was inferred where no sensor told it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.made import NOISE, flight, flown, lab

from bhm_service.discrepancy.candidate import candidates
from bhm_service.discrepancy.courses import courses_of
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.quantities import parameters


def test_an_inferred_temperature_begins_where_the_numbers_say_and_rises_under_load():
    flights = tuple(replace(flown(flight(k)), temperature_k=None) for k in (1, 2))
    member = next(c for c in candidates(flights, "circ", 100.0)[0] if c.id == "resistance-temperature")
    joint = Joint(lab(), flights, (member,))
    x = joint.unknowns.start.copy()
    x[joint.unknowns.slice_of("self-heating.ambient")] = [278.0, 291.0]
    x[joint.unknowns.slice_of("self-heating.start_above")] = [4.0, 0.0]
    fitted = Fitted(
        joint=joint, noise=NOISE, x=x, cost=0.0, rows=[], curvature=1e6 * np.eye(x.size), gradient=np.zeros(x.size)
    )
    cold, mild = courses_of(Joint(lab(), flights), fitted)
    assert cold.hidden["temperature"][0][0] == pytest.approx(282.0)
    assert mild.hidden["temperature"][0][0] == pytest.approx(291.0)
    assert mild.hidden["temperature"][0][-1] > 291.5
    assert np.all(mild.hidden["temperature"][1] > 0.0)


def test_how_warm_all_flights_were_is_not_told_by_a_pack_that_nobody_identified():
    """Its resistance is not known either: what is inferred is told as closely as days and places are known."""
    flights = tuple(replace(flown(flight(k)), temperature_k=None) for k in (1, 2))

    def told(identified):
        found, _ = candidates(flights, "circ", 100.0, identified=identified)
        joint = Joint(lab(), flights, (next(c for c in found if c.id == "resistance-temperature"),))
        start = joint.unknowns.start
        at = Fitted(
            joint=joint, noise=NOISE, x=start, cost=0.0, rows=[np.ones(1)], curvature=1e6 * np.eye(start.size),
            gradient=np.zeros(start.size),
        )  # fmt: skip
        ambient = parameters([at], "resistance-temperature")[f"self-heating.ambient[{flights[0].label}]"]
        return courses_of(Joint(lab(), flights), at)[0].hidden["temperature"][1], ambient.sd

    for sd in told(identified=True):
        assert np.all(sd < 1.0)
    for sd in told(identified=False):
        assert np.all(sd > 9.9)
