"""A flight is a test: what goes out for a recorded flight is what went out before."""

from __future__ import annotations

import csv
import io
import math
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from bhm_service.assembly import Equipment
from bhm_service.battery.battery_file import read_battery
from bhm_service.config import Service, read_vehicle, shipped
from bhm_service.mavlink.log import read_log
from bhm_service.messages import Model
from bhm_service.replay import Replay, replay
from bhm_service.reporting.played import outgoing_frames
from sim.flights import FLIGHTS

GOLDEN = Path(__file__).parent / "golden"
NAMES = (
    "BHM_RFT", "BHM_RFTLO", "BHM_RFTHI", "BHM_SOC", "BHM_SOE", "RFT_CIRC", "RFT_CHEM", "SOC_CIRC", "SOC_CHEM",
    "BHM_HLTH",
)  # fmt: skip
TOLERANCE = {"RFT": 0.5, "SOC": 1e-4, "SOE": 1e-4, "HLTH": 0.0}


def equipment() -> Equipment:
    """A vehicle of the simulated flights' size, with the battery that ships."""
    path = shipped("vehicles", "quad-4s.toml")
    vehicle = read_vehicle(path)
    battery = vehicle.battery.model_copy(update={"capacity_ah": 3.0})
    return Equipment(
        vehicle=vehicle.model_copy(update={"battery": battery}), battery=read_battery(path.parent / battery.file)
    )


def run(flight: Path) -> tuple[Replay, list[bytes]]:
    log = read_log(flight)
    pages = replay(log, equipment(), Service())
    return pages, outgoing_frames(log, pages)


@cache
def played(name: str) -> tuple[Replay, list[bytes]]:
    """A flight of the folder, replayed once for all who look at it."""
    return run(GOLDEN / f"{name}.tlog")


def table(pages: Replay) -> str:
    """What went out, a line a second."""
    lines: dict[float, dict[str, float]] = {}
    for _, value in pages.values:
        lines.setdefault(value.time_s, {})[value.name] = value.value
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time_s", *NAMES])
    for time_s, values in lines.items():
        writer.writerow([f"{time_s:.3f}", *(f"{values[n]:.6g}" if n in values else "" for n in NAMES)])
    return out.getvalue()


def differences(before: str, after: str) -> list[str]:
    """Where two tables differ by more than is allowed, in words."""
    old, new = (list(csv.DictReader(io.StringIO(text))) for text in (before, after))
    found = [] if len(old) == len(new) else [f"{len(old)} seconds before, {len(new)} now"]
    for was, now in zip(old, new, strict=False):
        for name in NAMES:
            kind = next(key for key in TOLERANCE if key in name)
            if was[name] == now[name]:
                continue
            known = was[name] and now[name]
            if not known or not math.isclose(float(was[name]), float(now[name]), rel_tol=0, abs_tol=TOLERANCE[kind]):
                found.append(f"{was['time_s']} {name}: {was[name] or 'nothing'} before, {now[name] or 'nothing'} now")
    return found


@pytest.mark.parametrize("name", FLIGHTS)
def test_replay_says_what_it_said_before(name, request):
    flight, golden = GOLDEN / f"{name}.tlog", GOLDEN / f"{name}.csv"
    if request.config.getoption("--update-golden"):
        flight.write_bytes(FLIGHTS[name]())
    said = table(played(name)[0])
    if request.config.getoption("--update-golden"):
        before = golden.read_text() if golden.exists() else "time_s\n"
        changed = differences(before, said) if golden.exists() else ["new"]
        print(f"{name}: {len(changed)} differences", *changed[:20], sep="\n  ")
        golden.write_text(said)
        return
    assert differences(golden.read_text(), said) == []


@pytest.mark.parametrize("name", FLIGHTS)
def test_replay_of_the_same_flight_twice_gives_the_same_bytes(name):
    first, again = played(name)[1], run(GOLDEN / f"{name}.tlog")[1]
    assert first == again
    assert len(first) > 200


def test_the_truth_is_inside_the_bands():
    """The simulated pack is another than the one in the file; the bands hold what it really lasts and holds."""
    pages, _ = played("hover")
    last = {model: estimates[-1] for model, estimates in pages.estimates.items()}
    used = sum(
        0.5 * ((a.current_a or 0.0) + (b.current_a or 0.0)) * (b.time_s - a.time_s) for a, b in pairwise(pages.samples)
    )
    truth = 0.97 - used / (3.0 * 3600.0)
    for model in (Model.CIRC, Model.CHEM):
        assert last[model].soc_low - 0.02 < truth < last[model].soc_high + 0.02


def test_current_lost_in_flight_ends_the_estimate_until_it_is_back():
    pages, _ = played("current_lost")
    start = pages.samples[0].time_s
    health = {round(r.time_s - start): r.health for r in pages.remaining}
    assert health[65] == 0
    assert health[108] == 2
    assert health[125] in (0, 1)


def test_spikes_are_rejected_and_move_nothing():
    pages, _ = played("voltage_spikes")
    for estimates in pages.estimates.values():
        assert sum(e.rejected is not None for e in estimates) == 2  # 18.25 V and 9.4 V; 0 V is no reading
        soc = [e.soc for e in estimates]
        assert max(abs(b - a) for a, b in pairwise(soc)) < 0.02


def test_a_clock_that_is_set_in_flight_is_not_seen_in_the_result():
    pages, _ = played("clock_set")
    times = [r.time_s for r in pages.remaining]
    assert max(b - a for a, b in pairwise(times)) < 1.5
    assert min(b - a for a, b in pairwise(times)) > 0.5


def test_a_swapped_pack_is_noticed_and_the_estimate_begins_anew():
    pages, _ = played("pack_swapped")
    assert len(pages.changes) == 1
    flights = [p.time_s for p in pages.phases if p.airborne]
    estimates = pages.estimates[Model.CIRC]
    at = [next(e for e in estimates if e.time_s >= t) for t in flights]
    assert at[0].soc == pytest.approx(0.70, abs=0.05)
    assert at[1].soc == pytest.approx(0.97, abs=0.04)


@pytest.mark.parametrize("name", FLIGHTS)
def test_the_simulated_simulated_flight_is_the_one_in_the_folder(name):
    assert FLIGHTS[name]() == (GOLDEN / f"{name}.tlog").read_bytes()
