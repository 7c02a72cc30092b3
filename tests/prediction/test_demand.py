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


def test_what_is_not_a_number_is_passed_over():
    assert fed([250.0] * 30 + [float("nan")] + [250.0] * 30).mean_w == pytest.approx(250.0)
