"""The service is killed fifty times in one flight, beside one that is not (`make proofs`)."""

from __future__ import annotations

import random
import signal
import time
from itertools import pairwise

from executive.live import as_the_unit_does, config, end, flying, free_port, start

KILLS = 50
VALID_AGAIN_S = 3.0
APART = 0.05


def test_after_each_of_fifty_kills_it_is_back_in_three_seconds_with_the_same_flying_time(tmp_path, capsys):
    moments = random.Random(20261121)
    port, other = free_port(), free_port()
    for name in ("killed", "spared"):
        (tmp_path / name).mkdir()
    path, spared_path = config(tmp_path / "killed", port), config(tmp_path / "spared", other)
    back_s, gaps = [], []
    # Both are there before the take-off: what is compared is one start from a rested pack.
    with flying(port, flight_s=900.0, left=1.0, ground_s=20.0, beside=other) as vehicle:
        nice = as_the_unit_does()
        spared, service = start(spared_path, nice), start(path, nice)
        time.sleep(45.0)
        for k in range(KILLS):
            time.sleep(moments.uniform(0.1, 8.0))
            killed = time.monotonic()
            end(service, signal.SIGKILL)
            started = time.monotonic()
            service = start(path, nice)
            when, _ = vehicle.wait_for("BHM_RFT", killed, 30.0)
            back_s.append(when - started)
            with capsys.disabled():
                print(f"\r  kill {k + 1}: back after {back_s[-1]:.2f} s, at worst {max(back_s):.2f} s  ", end="")
        time.sleep(3.0)
        printed = end(service)
        end(spared)
        airborne_s = vehicle.flown_s
    expected = {ms // 1000: fields["value"] for _, fields in vehicle.named("BHM_RFT", beside=True)
                for ms in [fields["time_boot_ms"]]}  # fmt: skip
    for _, fields in vehicle.named("BHM_RFT"):
        second = fields["time_boot_ms"] // 1000
        if second in expected and expected[second] > 60.0 and second > 45:
            gaps.append(abs(fields["value"] / expected[second] - 1.0))
    silent = max(b - a for a, b in pairwise(when for when, _ in vehicle.values("BHM_RFT")))
    with capsys.disabled():
        print(
            f"\n  {KILLS} kills in {airborne_s:.0f} s of flight: valid again after {max(back_s):.2f} s at worst, "
            f"{sorted(back_s)[KILLS // 2]:.2f} s in the median; {len(gaps)} values compared, at most "
            f"{100 * max(gaps):.1f} % apart; longest silence {silent:.1f} s"
        )
    assert "went on from what was believed" in printed
    assert max(back_s) <= VALID_AGAIN_S
    assert len(gaps) > 100
    assert max(gaps) <= APART
