"""Every real log through the whole replay: it finishes, finds the flights, and says nothing impossible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bhm_service.assembly import Equipment
from bhm_service.battery.battery_file import read_battery
from bhm_service.config import BatterySettings, Service, Vehicle, shipped
from bhm_service.guess import guess_vehicle
from bhm_service.identification.generic_lihv import charged_higher, laid, rests
from bhm_service.mavlink.log import read_log
from bhm_service.mavlink.recording import record
from bhm_service.messages import BatterySample, EventCode, Model
from bhm_service.replay import replay
from bhm_service.reporting.flights import summarise

BATTERY = str(shipped("batteries", "generic-lipo.toml"))


def run(path: Path):
    log = read_log(path)
    vehicle = guess_vehicle((m for _, m in log.messages), None, path.stem).vehicle
    pages = replay(log, Equipment(vehicle=vehicle, battery=read_battery(Path(BATTERY))), Service())
    return pages, summarise(pages)


@pytest.mark.parametrize(
    ("file", "flights"),
    [
        ("flights/tlog/pterosoar_hexa_2022-06-02.tlog", 3),
        ("flights/tlog/acuasi_quad_flight1.tlog", 1),
        ("flights/tlog/acuasi_quad_flight3.tlog", 1),
        ("flights/tlog/acuasi_quad_flight5.tlog", 1),
        ("flights/bin/joey_y6_2014-10-18.bin", 1),
        ("sitl/arducopter_two_batteries_failsafe.tlog", 1),
        ("sitl/arducopter_two_batteries_failsafe.bin", 1),
    ],
)
def test_a_real_log_is_replayed(data, file, flights):
    pages, summaries = run(data / file)
    assert len(summaries) == flights
    for estimates in pages.estimates.values():
        assert all(0.0 <= e.soc_low <= e.soc <= e.soc_high <= 1.0 for e in estimates)
    for r in pages.remaining:
        known = [r.low_s, r.median_s, r.high_s]
        assert known == [None] * 3 or 0.0 <= known[0] <= known[1] <= known[2]
    for flight in summaries:
        for row in flight.rows:
            assert row.soc_end[1] < row.soc_begin[1]
            assert row.nis < 2.0
            assert sum(row.rejected.values()) < 0.05 * (row.used + 1)
        if flight.span.end_s - flight.span.begin_s > 120.0:
            assert flight.fused_s[1] is not None


def test_without_a_current_sensor_there_is_nothing_to_estimate_from_and_it_says_why(data):
    pages, summaries = run(data / "sitl" / "px4_no_current_sensor.tlog")
    assert len(summaries) == 1
    assert pages.estimates == {}
    (event,) = [e for e in pages.events if e.code is EventCode.NOTHING_TO_ESTIMATE]
    assert "without a current sensor" in event.text
    assert all(r.health == 2 for r in pages.remaining)
    assert {value.name for _, value in pages.values} == {"BHM_HLTH"}


def test_a_part_used_pack_is_not_taken_for_a_full_one(data):
    """The autopilot of this flight says 99 % after its reboot; its pack rests at 3.88 V a cell."""
    pages, _ = run(data / "flights" / "tlog" / "acuasi_quad_flight1.tlog")
    told = max(s.remaining for s in pages.samples if s.remaining is not None)
    assert told > 0.95
    assert all(e.soc < 0.75 for e in pages.estimates[Model.CIRC])


def test_on_the_matrice_flights_the_charge_at_landing_is_near_what_the_packs_own_gauge_says(data, generic):
    """96 flights, one capacity for all packs, a LiHV cell made without the flights of the vehicle that is looked at.

    Where the gauge shows nothing about a twentieth is left.
    """
    paths = sorted((data / "flights" / "wadl_m100").glob("*.csv"))
    flights = {path.stem: record(read_log(path), 0, 6, 5.7 * 3600.0) for path in paths}
    settings = BatterySettings(file="lihv.toml", series=6, capacity_ah=5.7, capacity_sd=0.12)
    differences, sure = [], []
    for vehicle in ("waddle1", "waddle3", "msl"):
        others = [flight for name, flight in flights.items() if not name.startswith(vehicle)]
        lihv = laid(generic.circ.ocv, *rests(others, float(generic.circ.r_s)))
        battery = charged_higher(generic, lihv)
        equipment = Equipment(vehicle=Vehicle(name="M100", battery=settings), battery=battery)
        for name, recording in flights.items():
            short = recording.time_s[-1] - recording.time_s[0] < 400.0
            if not name.startswith(vehicle) or short or np.isnan(recording.remaining[-1]):
                continue
            left = lihv.reserve + (1.0 - lihv.reserve) * recording.remaining[-1]
            for model in Model:
                tracker, track = equipment.tracker(model), None
                for sample in samples(recording):
                    track, estimate = tracker.step(track, sample)
                differences.append(estimate.soc - left)
                sure.append(estimate.soc_sd)
    assert len(differences) > 120
    assert abs(np.median(differences)) < 0.02
    assert np.quantile(np.abs(differences), 0.8) < 0.08
    assert 0.01 < np.median(sure) < 0.08


def samples(recording):
    known = zip(recording.time_s, recording.voltage_v, recording.current_a, recording.temperature_k, strict=True)
    for t, volts, amps, kelvin in known:
        yield BatterySample(
            time_s=t, battery_id=0, voltage_v=volts, current_a=amps, temperature_k=None if np.isnan(kelvin) else kelvin
        )
