"""Effects that somebody tells: they are measured and repaired as they are told, and nothing else is looked for."""

from __future__ import annotations

import pytest
from discrepancy.flown import BATTERY, four

from bhm_service.discrepancy.explain import Request, explain
from bhm_service.errors import BadInputError


def test_what_is_told_is_measured_though_the_flights_show_another_cause():
    found = explain(
        Request(battery=BATTERY, flights=four("resistance-growth", seed=2), told=frozenset({"unseen-load"}))
    )
    assert [e.id for e in found.findings.effects] == ["unseen-load"]
    assert found.sentence.startswith("Measured as told, not found: ")


def test_the_true_effect_that_is_told_has_its_size_and_its_repair():
    told = frozenset({"resistance-growth"})
    found = explain(Request(battery=BATTERY, flights=four("resistance-growth", seed=2), told=told))
    (effect,) = found.findings.effects
    (number,) = effect.parameters.values()
    assert abs(number.value - 0.5) < 3.0 * number.sd
    assert found.repaired is not None
    assert found.findings.fit.heldout_after_V < 0.3 * found.findings.fit.heldout_before_V


def test_what_is_told_and_not_to_be_measured_is_refused():
    with pytest.raises(BadInputError, match="self-discharge can be measured\n  self-discharge: needs storage"):
        explain(Request(battery=BATTERY, flights=four(seed=2), told=frozenset({"self-discharge"})))
