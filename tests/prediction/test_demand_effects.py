import numpy as np
import pytest
from scipy.optimize import brentq

from bhm_service.prediction.demand import AIR_DENSITY, hover_power
from bhm_service.prediction.demand_effects import (
    DEMAND_EFFECTS,
    AirDensity,
    ClimbPower,
    Motion,
    PayloadMass,
    PropulsionEfficiency,
    TranslationalLift,
    WindTilt,
    demanded,
    induced_velocity,
)

DISC = 4 * np.pi * 0.19**2


def motion(**changes):
    return Motion(**({"mass_kg": 6.0, "disc_area_m2": DISC} | changes))


@pytest.mark.parametrize("along", [0.0, 0.4, 5.0, 30.0])
@pytest.mark.parametrize("through", [-3.0, 0.0, 2.0, 12.0])
def test_induced_velocity_is_glauerts_root(along, through):
    root = brentq(lambda v: v * np.hypot(along, through + v) - 7.0**2, 1e-6, 30.0, xtol=1e-14)
    assert induced_velocity(7.0, along, through) == pytest.approx(root, rel=1e-11)


def test_without_their_sizes_demand_effects_change_nothing():
    moving = motion(density=1.0, airspeed=np.array([0.0, 9.0]), climb=np.array([2.0, -1.0]))
    effects = [e(**{p.name: p.si(p.absent) for p in e.parameters()}) for e in DEMAND_EFFECTS.values()]
    np.testing.assert_allclose(demanded(effects, moving), 1.0, rtol=1e-12)


def test_air_mass_and_tilt_follow_the_hover_formula():
    def power(mass=6.0, **kw):
        return hover_power(mass, 4, 0.19, 0.6, 0.0, **kw)

    assert demanded([AirDensity(exponent=0.5)], motion(density=0.98)) == pytest.approx(power(density=0.98) / power())
    assert demanded([PayloadMass(payload=0.25)], motion()) == pytest.approx(power(7.5) / power())
    tilt = np.arctan(0.5 * AIR_DENSITY * 0.1 * 12.0**2 / (6.0 * 9.80665))
    tilted = WindTilt(drag_area=0.1).factor(motion(airspeed=12.0))
    assert tilted == pytest.approx(power(tilt_rad=tilt) / power())
    assert demanded([PropulsionEfficiency(loss=0.1)], motion()) == pytest.approx(1.0 / 0.9)


def test_drag_costs_what_moving_it_takes():
    drag = 0.5 * AIR_DENSITY * 0.02 * 8.0**2
    tilted = np.hypot(6.0 * 9.80665, drag) / (6.0 * 9.80665)
    hover = 6.0 * 9.80665 * motion().hover_velocity
    found = demanded([WindTilt(drag_area=0.02)], motion(airspeed=8.0))
    assert found == pytest.approx(tilted**1.5 * (hover + drag * 8.0) / hover)


def test_climb_and_forward_flight_follow_their_closed_forms():
    v_h = motion().hover_velocity
    climb, speed = np.array([-2.0, 0.0, 3.0]), np.array([0.0, 5.0, 15.0])
    axial = climb / 2 + np.sqrt(climb**2 / 4 + v_h**2)
    np.testing.assert_allclose(demanded([ClimbPower(induced=1.0)], motion(climb=climb)), axial / v_h, rtol=1e-12)
    forward = np.sqrt(-(speed**2) / 2 + np.sqrt(speed**4 / 4 + v_h**4))
    found = demanded([TranslationalLift(induced=1.0)], motion(airspeed=speed))
    np.testing.assert_allclose(found, forward / v_h, rtol=1e-12)


def test_climbing_in_forward_flight_is_glauerts_solution_of_both():
    moving = motion(airspeed=8.0, climb=2.5)
    both = demanded([TranslationalLift(induced=1.0), ClimbPower(induced=1.0)], moving)
    v_h = moving.hover_velocity
    assert both == pytest.approx((2.5 + induced_velocity(v_h, 8.0, 2.5)) / v_h, rel=1e-12)


def test_typical_sizes_are_those_of_the_literature():
    assert demanded([AirDensity(exponent=0.5)], motion(density=AIR_DENSITY * 0.8638)) == pytest.approx(1.076, abs=2e-3)
    assert demanded([PayloadMass(payload=0.1)], motion()) == pytest.approx(1.154, abs=1e-3)
    seven = motion(mass_kg=2 * AIR_DENSITY * DISC * 7.0**2 / 9.80665)
    assert demanded([ClimbPower(induced=1.0)], Motion(mass_kg=seven.mass_kg, disc_area_m2=DISC, climb=3.0)) == (
        pytest.approx(1.24, abs=0.01)
    )


def test_sizes_may_be_columns():
    effect = TranslationalLift(induced=np.array([[0.5], [0.8]]))
    assert np.shape(demanded([effect], motion(airspeed=np.linspace(0.0, 12.0, 30)))) == (2, 30)


def test_demand_effects_declare_as_the_batterys_do():
    for name, effect in DEMAND_EFFECTS.items():
        assert effect.equation and effect.title and effect.source and effect.excited_by and effect.manoeuvre
        for other in effect.mimics:
            assert name in DEMAND_EFFECTS[other].mimics, f"{name} mimics {other}"
        for p in effect.parameters():
            assert p.prior is not None and p.absent is not None
            assert p.low <= min(p.prior[0], p.absent) <= p.high
