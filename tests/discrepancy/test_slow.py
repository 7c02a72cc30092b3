"""What single readings that are off do to a misfit: nothing."""

import numpy as np

from bhm_service.discrepancy.slow import without_strays


def test_a_stray_reading_and_its_echo_vanish():
    misfit = 0.01 * np.sin(np.arange(200) / 9.0)
    strayed = misfit.copy()
    strayed[70:72] -= 1.25
    strayed[120] += 0.9
    assert np.abs(without_strays(strayed) - misfit).max() < 0.005


def test_what_lasts_stays_and_what_is_not_known_stays_so():
    misfit = np.zeros(100)
    misfit[40:48] = -0.3
    misfit[60:65] = np.nan
    found = without_strays(misfit)
    assert (found[40:48] == -0.3).all()
    assert np.isnan(found[60:65]).all() and np.isfinite(np.delete(found, range(60, 65))).all()
