"""A day beside autopilots that come and go, links that fail and apps that raise (`make proofs`)."""

from __future__ import annotations

from executive.soak import soak


def test_a_day_of_flights_grows_no_memory_and_misses_no_second(tmp_path, capsys):
    def tell(words):
        with capsys.disabled():
            print(f"\r  soak: {words}  ", end="", flush=True)

    result = soak(tmp_path, hours=24.0, seed=20261121, tell=tell)
    with capsys.disabled():
        print(
            f"\n  {result.seconds} s, {result.flights} flights, {result.flying} s in the air, of them "
            f"{result.excused} s of injected outages; {result.faults} faults of apps; missed "
            f"{len(result.missed_health)} s of health, {len(result.missed_rft)} s of flying time; memory "
            f"{result.memory_kb[0] / 1024:.1f} MB after an hour, {result.growth_kb / 1024:+.2f} MB at most since; "
            f"files {result.files_kb} kB; events {dict(result.events)}"
        )
    assert result.missed_health == []
    assert result.missed_rft == []
    assert result.growth_kb < 2048
    assert result.events["APP_RESTARTED"] == result.faults
    assert result.files_kb < 8_100
