"""What a porous-electrode cell that is solved once a second does in between, and beside what it is solved for."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sim.concealed.porous import between, turned

_DT = 0.1  # [s]
_OHM, _SLOW_OHM, _SLOW_S = 0.05, 0.02, 30.0


def _pack_v(current_a: np.ndarray) -> np.ndarray:
    """Closed form: a resistance that follows at once, one that follows within half a minute, and a falling rest."""
    keep = np.exp(-_DT / _SLOW_S)
    late = lfilter([1.0 - keep], [1.0, -keep], current_a)
    return 24.0 - _OHM * current_a - _SLOW_OHM * late - 1e-4 * np.arange(current_a.size) * _DT


@pytest.fixture
def gusts() -> np.ndarray:
    rng = np.random.default_rng(1)
    keep = np.exp(-_DT / 3.0)
    return 30.0 + 3.0 * lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(6000))


def test_the_voltage_follows_gusts_within_a_second(gusts):
    seconds = np.arange(0, gusts.size, 10)
    truth = _pack_v(gusts)
    found = between(gusts, seconds, truth[seconds])
    straight = np.interp(np.arange(gusts.size), seconds, truth[seconds])
    assert np.std(found - truth) < 0.05 * np.std(straight - truth)
    assert found[seconds] == pytest.approx(truth[seconds])


def test_under_a_steady_current_it_is_straight(gusts):
    seconds = np.arange(0, gusts.size, 10)
    steady = np.full(gusts.size, 20.0)
    truth = _pack_v(steady)
    assert between(steady, seconds, truth[seconds]) == pytest.approx(truth, abs=1e-4)


def test_hysteresis_turns_with_the_charge_that_is_given_and_not_at_rest():
    """Closed form: 1 - exp(-q / width) of the charge given so far."""
    c_rate = np.concatenate([np.zeros(60), np.full(900, 2.0), np.zeros(300)])
    given = np.concatenate([np.zeros(61), np.arange(1, 900) * 2.0 / 3600.0, np.full(300, 0.5)])
    assert turned(c_rate, 0.05) == pytest.approx(1.0 - np.exp(-given / 0.05))
