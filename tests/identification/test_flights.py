"""From flights alone: what they tell is found, what they do not tell stays as wide as it was."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bhm_service.battery.battery_file import BatteryFile, read_battery, write_battery
from bhm_service.battery.circ import Circ
from bhm_service.battery.ocv import MonotoneSpline
from bhm_service.battery.pack import PackModel
from bhm_service.config import shipped
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.errors import BadInputError
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.flight_log import read_flights
from bhm_service.identification.flights import identify_flights
from bhm_service.identification.identify import Identified, Request
from bhm_service.mavlink.log import read_log
from bhm_service.units import SECONDS_PER_HOUR

LABEL_AH, LABEL_SD = 4.0, 0.2


def flown(known: Circ, capacity_ah: float, depth: float, generator: np.random.Generator) -> Experiment:
    """A flight on a cell of another make: capacity, resistances and curve are off as [uncertainty] says."""
    ratio = capacity_ah * SECONDS_PER_HOUR / float(np.asarray(known.c_max))
    polarisation = np.exp(generator.normal(0.0, 0.6)) / ratio
    assert isinstance(known.ocv, MonotoneSpline)
    soc = np.array(known.ocv.soc)
    moved = np.interp(soc, np.linspace(0.0, 1.0, 4), generator.normal(0.0, 0.015, 4))
    cell = replace(
        known,
        ocv=MonotoneSpline(known.ocv.soc, tuple(np.array(known.ocv.volts) + moved)),
        c_max=capacity_ah * SECONDS_PER_HOUR,
        r_s=known.r_s / ratio * np.exp(generator.normal(0.0, 0.5)),
        r_sp0=known.r_sp0 * polarisation,
        r_sp1=known.r_sp1 * polarisation,
        c_sp=known.c_sp * ratio,
    )
    end = 30.0 + depth * SECONDS_PER_HOUR / 3.5
    time = np.arange(0.0, end + 90.0, 1.0)
    gusts = 1.0 + 0.1 * np.sin(time / 7.0) + 0.05 * generator.normal(size=time.size)
    current = capacity_ah * np.where((time > 30.0) & (time < end), 3.5 * gusts, 0.02)
    run = PackModel(cell, 1).simulate(time, current, generator.uniform(0.9, 1.0))
    volts = np.asarray(run.voltage) + generator.normal(0.0, 0.003, time.size)
    return Experiment(label="flight", kind=Kind.FLIGHT, time_s=time, current_a=current, voltage_v=volts)


def identified(flights: list[Experiment], generic: BatteryFile, sd: float = LABEL_SD) -> Identified:
    request = Request(experiments=tuple(flights), series=6, capacity_ah=LABEL_AH, models=("circ",))
    return identify_flights(request, generic, sd)


def capacity(found: Identified) -> tuple[float, float]:
    cell = found.battery.circ
    assert cell is not None
    return float(cell.c_max) / SECONDS_PER_HOUR, found.battery.sd["circ"]["c_max"] / SECONDS_PER_HOUR


@pytest.mark.parametrize("depth", [0.08, 0.3, 0.7])
def test_capacity_is_found_within_what_is_stated(generic: BatteryFile, depth: float) -> None:
    assert generic.circ is not None
    off, spread = [], []
    for seed in range(8):
        generator = np.random.default_rng(seed)
        true_ah = LABEL_AH * float(np.exp(generator.normal(0.0, LABEL_SD)))
        found, sd = capacity(identified([flown(generic.circ, true_ah, depth, generator)], generic))
        off.append((found - true_ah) / sd)
        spread.append(sd / found)
    assert np.sqrt(np.mean(np.square(off))) < 1.5
    assert np.max(np.abs(off)) < 3.0
    # A short hop tells hardly more than the label; most of a pack tells it twice as well.
    assert np.median(spread) > 0.7 * LABEL_SD if depth < 0.1 else np.median(spread) < 0.7 * LABEL_SD


def test_resistance_is_told_by_any_flight(generic: BatteryFile) -> None:
    assert generic.circ is not None
    generator = np.random.default_rng(3)
    found = identified([flown(generic.circ, LABEL_AH, 0.08, generator)], generic)
    assert found.battery.uncertainty.resistance < 0.3 * generic.uncertainty.resistance
    assert "r_s" not in found.results[0].not_told


@pytest.mark.parametrize("rested_v", [4.28, 4.36])
def test_a_pack_charged_beyond_the_known_curve_is_full_there(generic: BatteryFile, rested_v: float) -> None:
    """LiHV cells rest at 4.35 V: SoC 1 is where this pack is full."""
    assert generic.circ is not None
    flight = flown(generic.circ, LABEL_AH, 0.3, np.random.default_rng(0))
    found = identified([replace(flight, voltage_v=flight.voltage_v + rested_v - flight.voltage_v[0])], generic)
    assert found.results[0].assessments[0].soc[0] == pytest.approx(1.0, abs=0.02)
    assert found.battery.circ is not None
    nine_tenths, full = np.asarray(found.battery.circ.open_circuit(np.array([0.9, 1.0])))
    assert full == pytest.approx(rested_v, abs=0.02)
    assert 0.06 < full - nine_tenths < 0.14  # the known curve rises by a volt from empty, by a tenth of that here


def test_a_flight_of_another_pack_is_left_out_and_named(generic: BatteryFile) -> None:
    assert generic.circ is not None
    flights = [flown(generic.circ, LABEL_AH, 0.3, np.random.default_rng(1)) for _ in range(4)]
    flights = [replace(f, label=f"flight {k}") for k, f in enumerate(flights)]
    worn = replace(flights[2], voltage_v=flights[2].voltage_v - 0.02 * flights[2].current_a)
    found = identified([*flights[:2], worn, flights[3]], generic)
    assert [a.label for a in found.results[0].assessments] == ["flight 0", "flight 1", "flight 3"]
    assert "left out flight 2: it does not fit the pack of the others" in found.results[0].remarks[0]


def test_the_written_file_reads_back_and_says_how_little_is_known(generic: BatteryFile, tmp_path: Path) -> None:
    assert generic.circ is not None
    flight = flown(generic.circ, LABEL_AH, 0.3, np.random.default_rng(2))
    request = Request(experiments=(flight,), series=6, capacity_ah=LABEL_AH, name="mine")
    found = identify_flights(request, generic, LABEL_SD).battery
    write_battery(tmp_path / "mine.toml", found)
    again = read_battery(tmp_path / "mine.toml")
    assert again.series == 6
    assert not again.bench
    assert not lab_of(again, "circ", None, None).identified
    assert again.circ is not None
    assert again.chem is not None
    assert again.uncertainty.capacity == pytest.approx(found.uncertainty.capacity, rel=1e-6)
    soc = np.linspace(0.05, 1.0, 20)
    assert np.all(np.diff(np.asarray(again.chem.open_circuit(soc))) > 0.0)


# ---- real flights ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("files", "series", "capacity_ah", "pieces", "error_v"),
    [
        (["tlog/pterosoar_hexa_2022-06-02.tlog"], 6, 7.0, 1, 0.015),
        ([f"tlog/acuasi_quad_flight{k}.tlog" for k in (1, 3, 5)], 4, 4.0, 3, 0.015),
        (["bin/joey_y6_2014-10-18.bin"], 4, 6.0, 1, 0.015),
        (["karl_fpv/flight_32.csv"], 4, 1.5, 1, 0.045),  # 30 C bursts, recorded 15 times a second
    ],
)
def test_real_flights_are_followed(data, generic, files, series, capacity_ah, pieces, error_v):
    flights = [e for file in files for e in read_flights(read_log(data / "flights" / file), 0, series, capacity_ah)]
    assert len(flights) == pieces
    request = Request(experiments=tuple(flights), series=series, capacity_ah=capacity_ah)
    found = identify_flights(request, generic, 0.3)
    for result in found.results:
        for assessed in result.assessments:
            assert assessed.whole.rmse < error_v
            assert -0.01 < assessed.soc[-1] < assessed.soc[0] < 1.05
    assert 0.05 <= found.battery.uncertainty.capacity < 0.31


def test_a_log_that_begins_in_flight_is_followed_once_the_pack_has_settled(data):
    """Chem's charge transfer takes minutes to settle: from rest, 60 mV of this flight's begin."""
    lihv = read_battery(shipped("batteries", "generic-lihv.toml"))
    flights = read_flights(read_log(data / "flights" / "wadl_m100" / "msl_20200121_211644.csv"), 0, 6, 5.4)
    assert flights[0].current_a[0] > 10.0
    request = Request(experiments=tuple(flights), series=6, capacity_ah=5.4)
    for result in identify_flights(request, lihv, 0.3).results:
        assert result.assessments[0].whole.rmse < 0.015


def test_on_the_matrice_flights_capacity_agrees_with_the_packs_own_gauge(data, generic):
    """The gauge counts charge against its own percentage: an independent opinion of each pack's capacity."""
    with (data / "flights" / "manifest.csv").open(newline="") as stream:
        rows = [r for r in csv.DictReader(stream) if r["group"] == "wadl_m100" and float(r["rest_before_s"]) > 100.0]
    rows = [r for r in rows if float(r["mAh"]) > 2500.0][:8]
    off = []
    for row in rows:
        flights = read_flights(read_log(data / "flights" / row["file"]), 0, 6, 4.9)
        request = Request(experiments=tuple(flights[:1]), series=6, capacity_ah=4.9, models=("circ",))
        found, sd = capacity(identify_flights(request, generic, 0.3))
        off.append((found - float(row["cap_from_pct"]) / 1000.0) / sd)
    assert len(off) == 8
    assert np.sqrt(np.mean(np.square(off))) < 2.5


def test_a_log_without_current_or_without_a_flight_is_refused(data):
    with pytest.raises(BadInputError, match="battery 0 reports no current"):
        read_flights(read_log(data / "sitl" / "px4_no_current_sensor.tlog"), 0, 4, 5.0)
    with pytest.raises(BadInputError, match="holds no flight that takes out 2% of 100 Ah"):
        read_flights(read_log(data / "flights" / "karl_fpv" / "flight_28.csv"), 0, 4, 100.0)


def test_a_log_is_cut_where_the_count_of_charge_was_lost(data):
    log = read_log(data / "flights" / "wadl_m100" / "waddle1_20191128_183439.csv")
    pieces = read_flights(log, 0, 6, 4.9)
    assert [p.label for p in pieces] == [f"{log.path.name} [1]", f"{log.path.name} [2]"]
    assert all(p.time_s[0] == 0.0 for p in pieces)
