"""The noise model: what it whitens is white, and it is found again from what it made."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from bhm_service.discrepancy.noise import Noise, estimated

KINDS = [(0.95, 0.75, 0.004), (0.8, 0.0, 0.01), (0.985, 0.95, 0.02), (0.3, 0.1, 0.001)]


def made(phi, theta, sigma_v, rng, shape):
    """A stationary ARMA(1,1) by its definition, after a warm-up that outlasts its memory; (runs, samples)."""
    e = sigma_v * rng.standard_normal((shape[0], shape[1] + 700))
    return lfilter([1.0, -theta], [1.0, -phi], e, axis=-1)[:, 700:]


@pytest.mark.parametrize("kind", KINDS)
def test_whitened_innovations_have_unit_variance_and_no_colour(kind):
    white = Noise(*kind).whitened(made(*kind, np.random.default_rng(1), (40, 1000)))
    assert np.var(white) == pytest.approx(1.0, abs=0.03)
    for lag in (1, 2, 10):
        assert np.mean(white[:, lag:] * white[:, :-lag]) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_the_first_sample_of_a_recording_counts_as_much_as_the_later(kind):
    white = Noise(*kind).whitened(made(*kind, np.random.default_rng(2), (4000, 20)))
    assert white[:, 0].var() == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(white[:, 6:].var(axis=0), 1.0, atol=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_the_size_of_the_process_is_what_its_numbers_say(kind):
    process = made(*kind, np.random.default_rng(3), (40, 4000))
    assert Noise(*kind).total_v == pytest.approx(np.std(process), rel=0.05)


@pytest.mark.parametrize(
    "kind",
    [(0.95, 0.75, 0.004), (0.9, 0.4, 0.002), (0.985, 0.95, 0.02)],
)
def test_its_numbers_are_found_again(kind):
    found = estimated(list(made(*kind, np.random.default_rng(4), (6, 800))), floor_v=1e-6)
    assert found.phi == pytest.approx(kind[0], abs=0.05)
    assert found.theta == pytest.approx(kind[1], abs=0.08)
    assert found.sigma_v == pytest.approx(kind[2], rel=0.05)


def test_one_reading_in_a_hundred_that_is_no_measurement_changes_little():
    kind = (0.9, 0.6, 0.004)
    rng = np.random.default_rng(5)
    clean = made(*kind, rng, (6, 800))
    spoilt = clean + np.where(rng.random(clean.shape) < 0.01, 0.3 * rng.choice([-1.0, 1.0], clean.shape), 0.0)
    found = estimated(list(spoilt), floor_v=1e-6)
    assert found.sigma_v == pytest.approx(kind[2], rel=0.25)
    assert found.total_v == pytest.approx(Noise(*kind).total_v, rel=0.3)


def test_no_noise_is_smaller_than_the_floor():
    assert estimated([1e-9 * np.random.default_rng(6).standard_normal(500)], floor_v=0.003).sigma_v == 0.003


def test_a_mean_over_samples_is_as_noisy_as_a_simulated_one():
    noise = Noise(0.95, 0.7, 0.01)
    shocks = 0.01 * np.random.default_rng(0).standard_normal(400_000)
    series = lfilter([1.0, -0.7], [1.0, -0.95], shocks)
    assert noise.averaged_v(1) == pytest.approx(series.std(), rel=0.02)
    assert noise.averaged_v(8) == pytest.approx(series.reshape(-1, 8).mean(axis=1).std(), rel=0.02)


@pytest.mark.parametrize(("phi", "theta"), [(0.97, 0.8), (0.9, 0.2), (0.3, 0.25)])
@pytest.mark.parametrize("runs", [1, 8])
def test_the_worst_of_some_runs_exceeds_what_is_said_once_in_a_hundred_times(phi, theta, runs):
    noise, width, size = Noise(phi, theta, 0.01), 8, 700
    shocks = 0.01 * np.random.default_rng(1).standard_normal((2400 * runs, size + 300))
    series = lfilter([1.0, -theta], [1.0, -phi], shocks, axis=1)[:, 300:]
    summed = np.cumsum(series, axis=1)
    means = (summed[:, width:] - summed[:, :-width]) / width
    worst = np.sqrt(np.mean(means**2, axis=1)).reshape(-1, runs).max(axis=1)
    beyond = np.mean(worst > noise.worst_averaged_v(width, [size] * runs))
    assert 0.003 < beyond < 0.025
