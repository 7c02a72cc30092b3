"""How often noise alone would do as well."""

from __future__ import annotations

import numpy as np
import pytest
from discrepancy.flown import four, searching

from bhm_service.discrepancy.significance import NULLS, familywise

NAMES = {"capacity-fade", "resistance-growth", "unseen-load", "contact-resistance", "voltage-offset", "hysteresis"}
FADE = frozenset({"capacity-fade"})


def test_a_true_effect_is_beyond_all_of_the_nulls():
    p = familywise(searching(four("capacity-fade"), NAMES), FADE, np.random.default_rng(0))
    assert p == {"capacity-fade": pytest.approx(1.0 / (1.0 + NULLS))}


def test_an_effect_that_is_not_there_is_within_them():
    found = searching(four(), NAMES)
    for name in sorted(NAMES):
        assert familywise(found, frozenset({name}), np.random.default_rng(0))[name] > 0.02


def test_nothing_has_no_significance():
    assert familywise(searching(four(), FADE), frozenset(), np.random.default_rng(0)) == {}
