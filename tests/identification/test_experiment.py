"""What thinning must not lose."""

from __future__ import annotations

import numpy as np
import pytest
from battery.cells import circ
from identification.known import one_c, slow, variable

from bhm_service.battery.pack import PackModel
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.identify import Request, identify


def recording(seconds=20_000, seed=1, noise_v=0.001):
    """A slow discharge with two pulses in it, at one hertz."""
    rng = np.random.default_rng(seed)
    t = np.arange(float(seconds))
    current = np.full(t.size, 0.5) + 0.002 * rng.standard_normal(t.size)
    current[5000:5010] = 10.0
    current[12_000:12_300] = 4.0
    volts = 4.2 - 0.8 * np.cumsum(current) / current.sum() - 0.02 * current + noise_v * rng.standard_normal(t.size)
    return Experiment(label="slow", kind=Kind.SLOW, time_s=t, current_a=current, voltage_v=volts)


def carried(experiment):
    return float(np.sum(0.5 * (experiment.current_a[1:] + experiment.current_a[:-1]) * np.diff(experiment.time_s)))


def test_thinning_keeps_the_charge_and_the_span():
    whole = recording()
    thin = whole.thinned(300)
    assert thin.time_s.size < 0.2 * whole.time_s.size
    assert carried(thin) == pytest.approx(carried(whole), rel=1e-4)
    assert (thin.time_s[0], thin.time_s[-1]) == (whole.time_s[0], whole.time_s[-1])
    assert np.all(np.diff(thin.time_s) > 0.0)


def test_charge_is_kept_all_along_and_not_only_at_the_end():
    whole, thin = recording(), recording().thinned(300)
    at = np.interp(thin.time_s, whole.time_s, whole.charge_c)
    assert np.max(np.abs(thin.charge_c - at)) < 1e-3 * carried(whole)


def test_thinning_keeps_steps_where_they_are_and_as_large():
    whole, thin = recording(), recording().thinned(300)
    for e in (whole, thin):
        jumps = np.flatnonzero(np.abs(np.diff(e.current_a)) > 2.0)
        assert np.allclose(e.time_s[jumps + 1], [5000.0, 5010.0, 12_000.0, 12_300.0])
        assert np.all(np.diff(e.time_s)[jumps] == 1.0)
    assert thin.current_a.max() == pytest.approx(10.0)


def test_thinning_averages_noise_and_moves_no_voltage():
    whole, clean = recording(noise_v=0.001), recording(noise_v=0.0)
    thin = whole.thinned(300)
    off = thin.voltage_v - np.interp(thin.time_s, clean.time_s, clean.voltage_v)
    slow = np.abs(thin.current_a - 0.5) < 0.1
    assert abs(float(np.mean(off[slow]))) < 2e-4
    assert float(np.std(off[slow])) < 0.001


def test_noise_is_no_step_of_the_voltage():
    """Fifty hours at one hertz of a voltage that jumps by millivolts from sample to sample say the same thing."""
    noisy = recording(noise_v=0.003)
    thin = noisy.thinned(300)
    assert thin.time_s.size < 1.3 * recording(noise_v=0.0).thinned(300).time_s.size
    at_step = np.abs(thin.time_s - 12_000.0) < 2.0
    assert np.ptp(thin.voltage_v[at_step]) > 0.04  # 3.5 A more through 20 mOhm


def test_a_short_recording_stays_as_it_is():
    short = recording(seconds=1000)
    assert short.thinned(1500) is short


def test_voltages_that_are_missing_stay_missing():
    whole = recording()
    whole.voltage_v[8000:8100] = np.nan
    thin = whole.thinned(300)
    inside = (thin.time_s >= 8000) & (thin.time_s < 8100)
    assert inside.any()
    assert not np.isfinite(thin.voltage_v[inside]).any()
    assert np.isfinite(thin.voltage_v[~inside]).all()
    assert carried(thin) == pytest.approx(carried(whole), rel=1e-4)


def test_the_first_voltage_of_a_load_that_nobody_saw_begin_is_unknown():
    begun = recording(seconds=1000)
    hidden = begun.without_onset()
    assert not hidden.measured[0]
    assert hidden.measured[1:].all()
    assert np.isfinite(begun.voltage_v).all()
    assert carried(hidden) == carried(begun)
    begun.current_a[:10] = 0.0
    assert begun.without_onset() is begun


def test_identification_looks_away_from_a_load_that_nobody_saw_begin():
    rng = np.random.default_rng(2)
    pack = PackModel(circ(), 1)
    late, held_out = one_c(pack, rng).part(slice(13, None)), variable(pack, rng).part(slice(40, None))
    request = Request(
        experiments=(slow(pack, rng), late), held_out=(held_out,), series=1, models=("circ",), ocv="spline"
    )
    (result,) = identify(request).results
    for assessment in result.assessments:
        assert not assessment.experiment.measured[0]
        assert assessment.experiment.measured[1:].all()
