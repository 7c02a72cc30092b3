"""The repaired battery is a battery file: it reads back, it follows the flights, it flies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.flown import BATTERY, SERIES, SIZES, base, catalogue, error, flown, four, noise_model, with_members

from bhm_service.battery.battery_file import Joined, read_battery, write_battery
from bhm_service.battery.effects import EFFECTS, SelfHeating, SlowDiffusion
from bhm_service.discrepancy.as_flown import as_flown
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.repair import flying, patched, repaired
from bhm_service.estimation.tracker import Tracker
from bhm_service.messages import BatterySample, Model

NOISE = noise_model()
LASTING = [name for name in SIZES if name != "partial-charge"]


def mended(name, model, folder):
    """A battery file repaired from four flights, written and read; the flights it was not made from."""
    battery = repaired(BATTERY, [fit(with_members(four(name, model), {name}, model), NOISE)], "a test")
    write_battery(folder / "battery.toml", battery)
    return read_battery(folder / "battery.toml")


@pytest.mark.parametrize("model", ["circ", "chem"])
@pytest.mark.parametrize("name", LASTING)
def test_the_file_written_and_read_back_follows_new_flights(name, model, tmp_path):
    battery, new = mended(name, model, tmp_path), four(name, model, seed=9)
    (joined,) = battery.joined
    assert joined.effect.id == name
    assert joined.model == model  # the other model was not asked
    assert all(sd > 0.0 for sd in joined.sd.values())
    assert "a test" in battery.source
    assert error(battery, model, new) < 0.25 * error(BATTERY, model, new)


def test_the_filter_runs_it_and_keeps_nearer_to_the_charge(tmp_path):
    battery = mended("capacity-fade", "circ", tmp_path)
    flight = four("capacity-fade", seed=9)[0]
    true = 1.0 - flight.charge_c[-1] / (0.9 * float(BATTERY.circ.c_max))
    off = []
    for own in (battery, BATTERY):
        tracker = Tracker(Model.CIRC, own.cell("circ"), SERIES, 1.0, own.effects("circ"))
        track = None
        for t, amps, volts in zip(flight.time_s, flight.current_a, flight.voltage_v, strict=True):
            sample = BatterySample(
                time_s=float(t), battery_id=0, voltage_v=float(volts), current_a=float(amps), temperature_k=None
            )
            track, estimate = tracker.step(track, sample)
        off.append(abs(estimate.soc - true))
    assert off[0] < 0.03
    assert off[0] < off[1] + 0.005


def test_what_differs_between_flights_is_nothing_that_a_file_could_hold():
    fitted = fit(with_members(four("partial-charge"), {"partial-charge"}), NOISE)
    assert repaired(BATTERY, [fitted], "a test") is None


def test_repairing_twice_replaces_what_was_there(tmp_path):
    once = mended("resistance-growth", "circ", tmp_path)
    again = repaired(once, [fit(with_members(four("resistance-growth", seed=1), {"resistance-growth"}), NOISE)], "b")
    assert [j.effect.id for j in again.joined] == ["resistance-growth"]


def test_both_models_are_mended_each_with_its_own_size(tmp_path):
    fits = [fit(with_members(four("capacity-fade", m), {"capacity-fade"}, m), NOISE) for m in ("circ", "chem")]
    battery = repaired(BATTERY, fits, "a test")
    assert [j.model for j in battery.joined] == ["circ", "chem"]
    write_battery(tmp_path / "battery.toml", battery)
    back = read_battery(tmp_path / "battery.toml")
    for model in ("circ", "chem"):
        new = four("capacity-fade", model, seed=9)
        assert error(back, model, new) < 0.25 * error(BATTERY, model, new)


def test_repairing_one_model_leaves_the_other_as_it_was():
    shared = replace(BATTERY, joined=(Joined(effect=EFFECTS["resistance-growth"](growth=0.5)),))
    fitted = fit(with_members(four("resistance-growth"), {"resistance-growth"}), NOISE)
    battery = repaired(shared, [fitted], "a test")
    (kept,) = battery.effects("chem")
    (new,) = battery.effects("circ")
    assert kept.growth == 0.5
    assert new.growth != 0.5


def pair(resistance, time_constant):
    """One pair of slow diffusion of Circ, as the lab joined it."""
    effect = SlowDiffusion(resistance=resistance, time_constant=time_constant)
    return Joined(effect=effect, model="circ", sd={"resistance": 1e-5, "time_constant": 20.0})


def repaired_beside(*joined, found):
    """The effects of a file that has some already, repaired by a fit of Circ with what was found."""
    battery = replace(BATTERY, joined=joined)
    flights = tuple(four("resistance-growth"))
    members = tuple(catalogue(flights, only=found))
    fitted = fit(Joint(lab_of(battery, "circ", None, None), flights, members), NOISE)
    return repaired(battery, [fitted], "a test").joined


def test_two_pairs_that_the_fit_had_beside_it_stay():
    two = (pair(5e-4, 60.0), pair(4e-4, 1800.0))
    found = repaired_beside(*two, found=("slow-diffusion",))
    assert found[:2] == two
    assert [j.effect.id for j in found[2:]] == ["slow-diffusion"]


def test_only_one_effect_carries_the_temperature():
    heating = SelfHeating(heat_capacity=100.0, conductance=0.2, ambient=298.0, start_above=0.0)
    found = repaired_beside(Joined(effect=heating, model="circ"), found=("resistance-temperature",))
    assert [j.effect.id for j in found] == ["resistance-temperature", "self-heating"]
    assert found[1].effect != heating


def test_flying_time_to_the_reserve_falls_with_the_capacity():
    fitted = fit(with_members(four("capacity-fade"), {"capacity-fade"}), NOISE)
    for flight in flying(fitted.joint, fitted):
        assert flight.after_s / flight.before_s == pytest.approx(0.9, abs=0.04)


def test_flying_time_is_that_of_a_cell_whose_own_numbers_moved():
    fitted = fit(base([flown([EFFECTS["capacity-fade"](fade=0.03)], number=k) for k in range(4)]), NOISE)
    for plain, flight in zip(
        flying(fitted.joint, fitted), flying(fitted.joint, fitted, as_flown(BATTERY, [fitted])), strict=True
    ):
        charge = float(np.exp(fitted.x[fitted.joint.places["lab_capacity"]][0]))
        assert charge < 0.99
        assert flight.after_s / plain.after_s == pytest.approx(charge, abs=0.004)
        assert flight.before_s == plain.before_s


def test_what_nobody_can_name_widens_the_trust_in_the_voltage_and_changes_no_physics(tmp_path):
    wary = patched(BATTERY, 0.03)
    assert (wary.circ, wary.chem, wary.joined) == (BATTERY.circ, BATTERY.chem, BATTERY.joined)
    write_battery(tmp_path / "battery.toml", wary)
    assert read_battery(tmp_path / "battery.toml").uncertainty.voltage_error_v == pytest.approx(0.03)
    assert patched(BATTERY, 1e-6).uncertainty.voltage_error_v == BATTERY.uncertainty.voltage_error_v
