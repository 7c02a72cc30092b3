"""Recorded flights as the search takes them: what is mended, what is left out, what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.tables import columns, write

from bhm_service.discrepancy.flights import SHIFTS_S, at_skew, read_flights
from bhm_service.discrepancy.sidecar import Notes
from bhm_service.errors import BadInputError

CAPACITY_C = 18000.0


@pytest.fixture
def read(tmp_path):
    """Write tables, named 0.csv and so on, and read them as flights of a pack of six cells."""

    def run(*tables, notes=None, series=6):
        paths = [write(tmp_path / f"{k}.csv", rows) for k, rows in enumerate(tables)]
        return read_flights(paths, series, CAPACITY_C, notes or {})

    return run


def blank(values, where):
    holed = np.array(values, dtype=float)
    holed[where] = np.nan
    return holed


def test_a_flight_is_what_its_log_says(read):
    rows = columns()
    (flight,), left_out = read(rows)
    assert not left_out
    assert flight.label == "0.csv"
    np.testing.assert_allclose(flight.time_s, rows["t_s"])
    np.testing.assert_allclose(flight.current_a, rows["I"], atol=1e-3)
    np.testing.assert_allclose(flight.voltage_v, rows["V"], atol=1e-3)
    assert flight.charge_c[-1] == pytest.approx(np.trapezoid(rows["I"], rows["t_s"]), rel=1e-4)
    # The autopilot arms a moment before it flies.
    assert flight.since_takeoff_s[0] == pytest.approx(-30.0, abs=8.0)
    assert flight.reading is None


@pytest.mark.parametrize(
    ("rows", "because"),
    [
        (columns(seconds=50.0), "lasts 49 s only; 60 s are needed"),
        (columns(I=np.full(240, np.nan)), "has no measured current"),
        (columns(I=blank(columns()["I"], slice(40, 100))), "its current is missing in too many samples"),
        (columns(I=blank(columns()["I"], slice(40, 80))), "its current is not known for 41 s"),
        (columns(V=np.full(240, np.nan)), "no sample of it"),
        (columns(amps=1.3), "nothing of the pack can be seen"),
    ],
)
def test_a_flight_that_cannot_be_used_is_left_out_with_its_reason_and_the_others_are_not(read, rows, because):
    flights, left_out = read(columns(), rows, columns())
    assert [f.label for f in flights] == ["0.csv", "2.csv"]
    assert [r.label for r in left_out] == ["1.csv"]
    assert because in left_out[0].because


def test_a_log_that_is_no_log_is_left_out_too(read, tmp_path):
    path = tmp_path / "noise.tlog"
    path.write_bytes(bytes(range(256)) * 40)
    good = write(tmp_path / "good.csv", columns())
    flights, left_out = read_flights([path, good], 6, CAPACITY_C, {})
    assert [f.label for f in flights] == ["good.csv"]
    assert [r.label for r in left_out] == ["noise.tlog"]
    assert left_out[0].because


def test_a_short_gap_of_the_current_is_bridged(read):
    rows = columns()
    (flight,), _ = read(rows | {"I": blank(rows["I"], slice(100, 110))})
    straight = np.interp(rows["t_s"], [99.0, 110.0], rows["I"][[99, 110]])
    np.testing.assert_allclose(flight.current_a[100:110], straight[100:110], atol=1e-3)
    assert np.isfinite(flight.current_a).all()


def test_charge_is_counted_across_samples_without_voltage(read):
    rows = columns()
    (flight,), _ = read(rows | {"V": blank(rows["V"], slice(150, 153))})
    assert flight.charge_c[-1] == pytest.approx(np.trapezoid(rows["I"], rows["t_s"]), rel=2e-3)


def test_a_reading_that_jumps_away_and_back_is_no_measurement(read):
    rows = columns()
    rows["V"] = rows["V"].copy()
    rows["V"][120] += 5.0
    (flight,), _ = read(rows)
    assert np.flatnonzero(np.isnan(flight.voltage_v)).tolist() == [120]


def test_a_lone_reading_is_no_measurement_where_the_current_is_as_before(read):
    """A volt of a pack of 22 V is no more than a load can do, but a load shows in the current."""
    rows = columns()
    noise = np.random.default_rng(3).normal(0.0, 0.01, rows["V"].size)
    rows["V"], rows["I"] = rows["V"] + noise, rows["I"].copy()
    rows["V"][[80, 120]] -= 1.0
    rows["I"][120] += 25.0
    (flight,), _ = read(rows)
    assert np.flatnonzero(np.isnan(flight.voltage_v)).tolist() == [80]


def without_a_cell(rows, where):
    """The same table with a cell left out of the voltage for some samples."""
    volts = rows["V"].copy()
    volts[where] *= 5.0 / 6.0
    return rows | {"V": volts}


def test_what_a_pack_cannot_rest_at_before_it_flies_is_left_out_and_counted(read):
    """A FPV pack read 11.3 V on the ground and 14.5 V under 20 A a minute later (karl_fpv, flight 31)."""
    (flight,), left_out = read(without_a_cell(columns(), slice(0, 30)))
    assert np.flatnonzero(np.isnan(flight.voltage_v)).tolist() == list(range(30))
    assert np.isfinite(flight.current_a).all()
    assert [(r.label, r.because) for r in left_out] == [
        ("0.csv", "30 of its 240 voltages, at rest and below what it reads under load later: a cell was not connected")
    ]


def test_a_voltage_that_falls_under_load_or_stays_down_is_the_packs(read):
    """A contact that opens in flight, and a cell that is lost for good, are for the analysis to find."""
    for where in (slice(80, 120), slice(150, None)):
        rows = without_a_cell(columns(), where)
        (flight,), left_out = read(rows)
        assert not left_out
        # The first reading of a jump stands alone.
        known = np.isfinite(flight.voltage_v)
        assert known.mean() > 0.99
        np.testing.assert_allclose(flight.voltage_v[known], rows["V"][known], atol=1e-3)


def without_rows(rows, low, high):
    """A table that lacks what was recorded from ``low`` to before ``high`` seconds."""
    kept = (rows["t_s"] < low) | (rows["t_s"] >= high)
    return {name: values[kept] for name, values in rows.items()}


def test_what_follows_a_landing_that_nobody_saw_is_left_out_and_counted(read):
    """The load of columns() ends at 209 s: whether it took 15 A for 10 s or for 20 of a gap, the log does not say."""
    rested = {"0.csv": Notes(rest_voltage_v=23.0, rest_s=1200.0)}
    (flight,), left_out = read(without_rows(columns(), 200, 220), notes=rested)
    assert flight.time_s[-1] == 199.0
    assert flight.airborne[-1]
    assert flight.notes.rest_voltage_v is None
    assert [(r.label, r.because) for r in left_out] == [
        ("0.csv", "its last 40 s: the load ended within 21 s of which nothing is recorded")
    ]


@pytest.mark.parametrize("gap", [(100, 120), (20, 40), (207, 211), (215, 235), (200, 240)],
                         ids=["in the air", "take-off", "short", "after it", "and nothing more"])  # fmt: skip
def test_other_gaps_leave_a_flight_as_long_as_it_was(read, gap):
    rows = without_rows(columns(), *gap)
    (flight,), left_out = read(rows)
    assert not left_out
    assert flight.time_s.size == rows["t_s"].size


def test_temperature_in_whole_degrees_is_smoothed_without_delay(read):
    t = columns(900.0)["t_s"]
    true = 15.0 + 15.0 * (1.0 - np.exp(-t / 400.0))
    (flight,), _ = read(columns(900.0, amps=8.0, T_C=np.round(true)))
    smooth = flight.temperature_k - 273.15
    inner = slice(120, -120)
    assert np.abs(np.diff(smooth)).max() < 0.1
    assert np.sqrt(np.mean((smooth - true)[inner] ** 2)) < 0.2
    # A filter of a minute that only looks back would be a minute late.
    late = min(range(-90, 91), key=lambda lag: np.sum((np.roll(smooth, -lag) - true)[inner] ** 2))
    assert abs(late) <= 15


def test_a_temperature_that_is_mostly_absent_counts_as_not_recorded(read):
    rows = columns()
    (flight,), _ = read(rows | {"T_C": blank(rows["T_C"], slice(0, 150))})
    assert flight.temperature_k is None


def test_a_gauge_is_believed_only_where_it_says_other_than_full(read):
    percent = np.full(240, 71.0)
    full, partial = read(columns(soc_pct=np.full(240, 99.0)), columns(soc_pct=percent))[0]
    assert full.reading is None
    assert partial.reading == pytest.approx(0.71)


def test_a_thinned_flight_has_the_same_course_in_fewer_samples(read):
    (flight,), _ = read(columns(900.0, amps=8.0))
    thin = flight.thinned(300)
    assert thin.time_s.size == 300
    assert thin.charge_c[-1] == pytest.approx(flight.charge_c[-1], rel=0.01)
    np.testing.assert_allclose(thin.voltage_v[10:-10], np.interp(thin.time_s, flight.time_s, flight.voltage_v)[10:-10],
                               atol=0.15)  # fmt: skip
    assert flight.thinned(900) is flight


def test_a_thinned_flight_still_knows_the_current_before_and_after_its_samples(read):
    """To the second, though its own samples are three seconds apart; in a part of it too."""
    (flight,), _ = read(columns(900.0, amps=8.0))
    rough = replace(flight, current_a=flight.current_a + np.random.default_rng(1).normal(0.0, 3.0, flight.time_s.size))
    for skew_s in (-1.0, 0.0, 2.0):
        weights = at_skew(np.array([skew_s]))[0]
        moved = np.interp(rough.time_s + skew_s, rough.time_s, rough.current_a)
        thin = rough.thinned(300)
        np.testing.assert_allclose(weights @ thin.shifted_a, moved.reshape(300, 3).mean(axis=1), atol=1e-9)
        part = thin.part(slice(40, 90))
        np.testing.assert_array_equal(part.shifted_a, thin.shifted_a[:, 40:90])


def test_between_the_instants_that_are_kept_a_current_is_interpolated_smoothly():
    skews = np.linspace(-3.0, 3.0, 601)
    weights = at_skew(skews)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(weights @ SHIFTS_S**2, skews**2, atol=1e-9)
    course = weights @ np.random.default_rng(2).normal(size=SHIFTS_S.size)
    slope = np.diff(course) / np.diff(skews)
    assert np.abs(np.diff(slope)).max() < 0.2 * np.ptp(slope)


# ---- refused -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cells", [2, 3, 4, 8, 12])
def test_a_pack_of_another_number_of_cells_is_refused_with_what_the_log_looks_like(read, cells):
    with pytest.raises(BadInputError, match=rf"0\.csv: .*the battery file has 6 cells .*the log looks like {cells}"):
        read(columns(cells=cells))


def test_flights_of_different_packs_are_refused_by_the_name_of_the_stranger(read):
    with pytest.raises(BadInputError, match=r"1\.csv: .*the log looks like 3"):
        read(columns(), columns(cells=3))


def test_a_sidecar_of_other_files_is_refused(read):
    with pytest.raises(BadInputError, match=r"none of its files is among the logs; it names x\.tlog, y\.tlog"):
        read(columns(), notes={"x.tlog": Notes(), "y.tlog": Notes()})


def test_a_flight_whose_rested_voltage_is_of_another_pack_is_left_out(read):
    flights, (without,) = read(columns(), columns(), notes={"0.csv": Notes(rest_voltage_v=15.2)})
    assert [f.label for f in flights] == ["1.csv"]
    assert "rest_voltage_V = 15.2, but the log ends at" in without.because


def test_a_sidecar_may_know_fewer_flights_than_there_are(read):
    flights, _ = read(columns(), columns(), notes={"1.csv": Notes(cycles=7.0)})
    assert [f.notes.cycles for f in flights] == [None, 7.0]
