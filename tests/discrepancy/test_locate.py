"""A box of misfit is found where it was put, and nowhere when there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import flown

from bhm_service.discrepancy.locate import locate, regime_maps, variables

NOISE_V = 0.01
FLIGHTS = [flown(number=k, kelvin=280.0 + 6.0 * k, samples=240) for k in range(4)]
SOC = [1.0 - f.charge_c / 18000.0 for f in FLIGHTS]


def misfits(inside=lambda flight, soc: np.zeros(soc.size, dtype=bool), size=-0.15):
    """Noise, and ``size`` [V] where asked."""
    rng = np.random.default_rng(3)
    return [
        NOISE_V * rng.standard_normal(s.size) + size * inside(f, s) for f, s in zip(FLIGHTS, SOC, strict=True)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "low", "high", "inside"),
    [
        ("soc", None, 0.55, lambda f, s: s < 0.55),
        ("since_takeoff_s", None, 120.0, lambda f, s: f.since_takeoff_s < 120.0),
        ("temperature_C", None, 13.0, lambda f, s: f.temperature_k < 286.15),
    ],
)
def test_a_planted_box_is_found_with_its_edge_share_and_sign(name, low, high, inside):
    found = locate(misfits(inside), FLIGHTS, SOC, NOISE_V)
    boxes = [r for r in found if name in r.where]
    assert boxes
    edges = variables(FLIGHTS, SOC)[name]
    width = float(np.ptp(edges)) / 8.0
    assert min(abs(r.where[name][1] - high) for r in boxes) < 1.5 * width
    assert all(r.sign == -1 for r in boxes)
    assert max(r.share_of_misfit for r in boxes) > 0.6


def test_flights_that_hold_the_misfit_are_named():
    found = locate(misfits(lambda f, s: np.full(s.size, f.label == "02.tlog"), 0.2), FLIGHTS, SOC, NOISE_V)
    assert found[0].flights == ("02.tlog",)
    assert found[0].sign == 1


def test_noise_once_a_second_has_no_place():
    flights = [flown(number=k, samples=400, step_s=1.0) for k in range(3)]
    rng = np.random.default_rng(4)
    noise = [NOISE_V * rng.standard_normal(400) for _ in flights]
    assert locate(noise, flights, [1.0 - f.charge_c / 18000.0 for f in flights], NOISE_V) == []


def test_a_map_shows_the_mean_misfit_in_every_range():
    laid = misfits(lambda f, s: s < 0.55)
    (soc,) = [m for m in regime_maps(np.concatenate(laid), variables(FLIGHTS, SOC)) if m.variable == "soc"]
    below, above = soc.edges[1:] < 0.55, soc.edges[:-1] > 0.55
    np.testing.assert_allclose(soc.mean_v[below], -0.15, atol=0.01)
    np.testing.assert_allclose(soc.mean_v[above], 0.0, atol=0.01)
    assert soc.share.sum() == pytest.approx(1.0)


def test_what_not_all_flights_have_is_no_variable():
    some = [FLIGHTS[0], *(replace(f, temperature_k=None) for f in FLIGHTS[1:])]
    assert "temperature_C" not in variables(some, SOC)
    assert "temperature_C" in variables(FLIGHTS, SOC)


def test_a_thermometer_that_only_flickers_is_no_variable():
    rng = np.random.default_rng(5)
    still = [replace(f, temperature_k=298.15 + 0.01 * rng.standard_normal(f.time_s.size)) for f in FLIGHTS]
    laid = misfits(lambda f, s: s < 0.55)
    assert all("temperature_C" not in region.where for region in locate(laid, still, SOC, NOISE_V))
    assert not [m for m in regime_maps(np.concatenate(laid), variables(still, SOC)) if m.variable == "temperature_C"]
