import csv
import math

import numpy as np
import pytest

from bhm_service.prediction.demand import AIR_DENSITY, RecentLoad, air_density, hover_power


def test_hover_power_is_momentum_theory():
    mass, rotors, radius = 10.0, 8, 0.19
    weight = mass * 9.80665
    per_rotor = (weight / rotors) ** 1.5 / math.sqrt(2 * AIR_DENSITY * math.pi * radius**2)
    assert hover_power(mass, rotors, radius, 1.0, 0.0) == pytest.approx(rotors * per_rotor, rel=1e-12)


def test_tilted_rotors_carry_the_weight_with_the_vertical_part_of_their_thrust():
    level = hover_power(10.0, 8, 0.19, 0.6, 0.0)
    assert hover_power(10.0, 8, 0.19, 0.6, 0.0, tilt_rad=0.3) == pytest.approx(level / math.cos(0.3) ** 1.5)


def test_thin_air_costs_power():
    dense, thin = air_density(101325.0, 288.15), air_density(84556.0, 278.4)
    assert dense == pytest.approx(AIR_DENSITY, rel=1e-3)
    ratio = hover_power(5, 4, 0.2, 0.6, 0.0, thin) / hover_power(5, 4, 0.2, 0.6, 0.0, dense)
    assert ratio == pytest.approx(math.sqrt(dense / thin))


def fed(power, dt=1.0, window=90.0):
    load = RecentLoad(window_s=window)
    for p in power:
        load = load.add(float(p), dt)
    return load.load()


def test_nothing_is_expected_before_ten_seconds_of_flight():
    assert fed([200.0] * 9) is None
    assert fed([200.0] * 11) is not None


def test_steady_load_is_expected_to_go_on():
    load = fed([250.0] * 300)
    assert load.mean_w == pytest.approx(250.0)
    assert load.instant_sd_w == pytest.approx(0.0, abs=1e-6)


def test_it_does_not_start_from_zero():
    assert fed([250.0] * 12).mean_w == pytest.approx(250.0)


def test_spreads_are_those_of_seconds_and_of_blocks():
    rng = np.random.default_rng(11)
    white = fed(250.0 + 40.0 * rng.standard_normal(3000), window=600.0)
    assert white.mean_w == pytest.approx(250.0, abs=8.0)
    assert white.instant_sd_w == pytest.approx(40.0, rel=0.15)
    slow = np.repeat(250.0 + 40.0 * rng.standard_normal(150), 20)
    assert fed(slow, window=600.0).mean_sd_w > white.mean_sd_w + 1.0


def test_later_flight_counts_more():
    assert fed([200.0] * 300 + [400.0] * 180).mean_w > 360.0


def test_the_flight_ahead_is_as_uncertain_as_the_minutes_flown_departed_from_what_was_expected():
    phases = np.tile(np.repeat([200.0, 300.0], 150), 4)
    flown, steady = fed(phases), fed(np.full(phases.size, 250.0))
    ahead = [phases[n:].mean() / fed(phases[:n]).mean_w - 1.0 for n in range(150, phases.size - 300, 30)]
    assert 1.0 < flown.mean_sd_w / flown.mean_w / np.sqrt(np.mean(np.square(ahead))) < 2.0
    assert steady.mean_sd_w < 0.04 * steady.mean_w
    assert fed([250.0] * 60).mean_sd_w == pytest.approx(25.0)


def test_a_steady_load_flown_for_long_does_not_drown_what_it_does_now():
    steady = np.full(10 * 3600, 250.0)
    phases = np.tile(np.repeat([200.0, 300.0], 150), 6)
    assert fed([*steady, *phases]).mean_sd_w > 2.0 * fed(steady).mean_sd_w


def test_the_mean_of_what_recorded_flights_went_on_to_ask_for_lies_in_its_band(data):
    inside = []
    for path in sorted((data / "flights" / "wadl_m100").glob("*.csv")):
        power = airborne_power(path)
        load = RecentLoad(window_s=90.0)
        for n, watts in enumerate(power):
            load = load.add(float(watts), 1.0)
            if n >= 60 and n % 20 == 0 and n < power.size - 60:
                expected = load.load()
                inside.append(abs(power[n + 1 :].mean() - expected.mean_w) < 1.645 * expected.mean_sd_w)
    assert len(inside) > 2000
    assert 0.85 < np.mean(inside) < 0.95


def airborne_power(path, airborne_a=7.0):
    """Power of the longest run of flight in a table that was written on change, held from second to second. [W]"""
    with path.open() as stream:
        rows = [[float(row[key]) for key in ("t_s", "V", "I")] for row in csv.DictReader(stream) if row["I"]]
    time, volts, amps = np.array(rows).T
    seconds = np.arange(time[0], time[-1], 1.0)
    held = np.searchsorted(time, seconds, side="right") - 1
    runs = np.split(held, np.flatnonzero(np.diff(amps[held] > airborne_a)) + 1)
    flown = max((run for run in runs if amps[run[0]] > airborne_a), key=len)
    return (volts * amps)[flown]


def test_what_is_not_a_number_is_passed_over():
    assert fed([250.0] * 30 + [float("nan")] + [250.0] * 30).mean_w == pytest.approx(250.0)
