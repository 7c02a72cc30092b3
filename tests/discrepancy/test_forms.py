"""What an effect of the catalogue may be off by, and what not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from discrepancy.flown import flown, searching

from bhm_service.discrepancy.odds import NATS

PARTIAL = frozenset({"partial-charge"})


def test_what_is_over_minutes_after_a_full_charge_is_no_charge_that_is_missing():
    """What a flight begins with follows no load: taken back by the start it would leave any course from there."""
    flights = []
    for k in range(5):
        bare = flown(seed=4, number=k)
        over_v = 0.3 * np.exp(-(bare.time_s - 30.0).clip(0.0) / 60.0)
        flights.append(replace(bare, voltage_v=bare.voltage_v + over_v))
    found = searching(flights, PARTIAL)
    for names in (frozenset(), PARTIAL):
        found.fitted(names)
    assert found.evidence(PARTIAL) < NATS
