"""One flight of the soak, so that it stays fit for the day of them that `make proofs` flies."""

from __future__ import annotations

from executive.soak import soak

SEED = 16103  # a short flight with an outage, a reboot and an app that raises


def test_a_flight_with_an_outage_a_reboot_and_a_fault_misses_no_second_beside_them(tmp_path):
    result = soak(tmp_path, hours=0.01, seed=SEED)
    assert (result.flights, result.faults) == (1, 1)
    assert result.missed_health == []
    assert result.missed_rft == []
    assert 0 < result.excused < 0.3 * result.flying
    assert result.events["APP_RESTARTED"] == 1
