"""Flights of a pack whose physics is known: simulated by the pack model itself, with noise as a sensor adds it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from battery.cells import CAPACITY_C, chem, circ
from scipy.signal import lfilter

from bhm_service.battery.battery_file import BatteryFile
from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.left_open import left_open
from bhm_service.battery.pack import PackModel
from bhm_service.discrepancy.candidate import candidates
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import FORM
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.noise import estimated
from bhm_service.discrepancy.search import Search
from bhm_service.discrepancy.sidecar import Notes

SERIES = 6
STEP_S = 3.0
SAMPLES = 330
BATTERY = BatteryFile(name="known", series=SERIES, circ=circ(), chem=chem())
_LANDED_S = 60.0  # of rest in the log after landing
_REST_S = 1200.0
_HOVER_A = 12.5


def noise(rng, size, phi=0.9, white_v=0.006, coloured_v=0.006):
    """White and first-order coloured noise together. [V]"""
    slow = lfilter([1.0], [1.0, -phi], rng.standard_normal(size)) * np.sqrt(1.0 - phi**2)
    return white_v * rng.standard_normal(size) + coloured_v * slow


def flown(
    effects=(), *, model="circ", seed=0, number=0, kelvin=None, samples=SAMPLES, step_s=STEP_S, rested=True, idle_a=0.3
):
    """One flight from full: half a minute on the ground, gusts and throttle steps, a minute of rest at the end."""
    rng = np.random.default_rng([seed, number])
    t = step_s * np.arange(float(samples))
    airborne = (t >= 30.0) & (t < t[-1] - _LANDED_S)
    gusts = lfilter([1.0], [1.0, -0.8], rng.standard_normal(samples)) * 0.9
    bursts = np.where((t // 45).astype(int) % 4 == number % 4, 6.0, 0.0)
    current = np.where(airborne, np.maximum(_HOVER_A + gusts + bursts, 1.0), idle_a)
    pack = PackModel(BATTERY.cell(model), SERIES, 1.0, effects)
    warmth = None if kelvin is None else kelvin + 8.0 * (1.0 - np.exp(-t / 500.0))
    run = pack.simulate(t, current, 1.0, warmth)
    rest = None
    if rested:
        landed = np.stack([np.ravel(s)[-1] for s in run.states])
        at = None if warmth is None else float(warmth[-1])
        # Unplugged: nothing flows, whatever a sensor would read or miss.
        kept = [e for e in effects if e.id not in ("unseen-load", "current-offset")]
        bare = PackModel(BATTERY.cell(model), SERIES, 1.0, kept)
        states = bare.step(landed, _REST_S, 0.0, 0.0, at)
        rest = float(bare.voltage(states, 0.0, at)) + 0.005 * float(rng.standard_normal())
    return FlightData(
        label=f"{number:02d}.tlog",
        time_s=t,
        current_a=current,
        voltage_v=np.ravel(run.voltage) + noise(rng, samples),
        temperature_k=warmth,
        airborne=airborne,
        altitude_m=np.where(airborne, 30.0, 0.0),
        climb_mps=np.zeros(samples),
        speed_mps=np.where(airborne, 5.0, 0.0),
        pressure_pa=np.full(samples, 101325.0),
        notes=Notes(rest_voltage_v=rest, rest_s=_REST_S),
    )


def off_by_its_curve(flights, by_v=0.025):
    """Flights of a battery whose open-circuit curve is off by up to so many volts a cell."""
    return [
        replace(f, voltage_v=f.voltage_v + by_v * SERIES * np.sin(2.0 * np.pi * f.charge_c / CAPACITY_C))
        for f in flights
    ]


def error(battery, model, flights):
    """RMSE of a battery file's pack model over flights, from full. [V]"""
    pack = PackModel(battery.cell(model), SERIES, 1.0, battery.effects(model))
    runs = [np.ravel(pack.simulate(f.time_s, f.current_a, 1.0, f.temperature_k).voltage) for f in flights]
    off = [f.voltage_v - run for f, run in zip(flights, runs, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


def base(flights, model="circ"):
    """The battery as it is over flights."""
    return Joint(lab_of(BATTERY, model, None, None), tuple(flights))


def noise_model():
    """What `noise` is as the fits take it."""
    return estimated([noise(np.random.default_rng(k), 2000) for k in range(4)], 1e-4)


def told_its_form(lab, by_charge=False):
    """The same lab where its own recordings showed, to some hundredth, that its model's form is off by nothing.

    They may have shown it of a lag ``by_charge`` too.
    """
    sizes = {name: size for name, size in FORM.items() if by_charge or name != "lag_at"}
    told = left_open({name: np.zeros(size) for name, size in sizes.items()}, 1e-6 * np.eye(sum(sizes.values())))
    return replace(lab, left_open=told)


def catalogue(flights, model="circ", only=None):
    """Candidates of the catalogue on these flights, all or some."""
    found, _ = candidates(flights, model, 3.7 * SERIES * CAPACITY_C / 3600.0)
    return [c for c in found if only is None or c.id in only]


def with_members(flights, names, model="circ"):
    """A hypothesis with effects of the catalogue."""
    flights = tuple(flights)
    return Joint(lab_of(BATTERY, model, None, None), flights, tuple(catalogue(flights, model, names)))


def searching(flights, names, model="circ"):
    """A search over a few candidates in which nothing has been fitted yet."""
    return Search(base(flights, model), tuple(catalogue(flights, model, names)), noise_model())


# One effect of each kind, at a size that these flights show.
AMBIENT_K = (277.0, 287.0, 297.0, 305.0)
DEFICITS = (0.03, 0.14, 0.08, 0.19)
SIZES = {
    "capacity-fade": {"fade": 0.10},
    "resistance-growth": {"growth": 0.5},
    "unseen-load": {"current": 1.5},
    "partial-charge": {"deficit": DEFICITS},
    "resistance-temperature": {"activation_energy": 22e3},
}


def four(name=None, model="circ", seed=0):
    """Four flights of a pack with one effect of `SIZES`, or with none; temperature is logged where it is the cause."""
    warmth = AMBIENT_K if name == "resistance-temperature" else (None,) * 4
    flights = []
    for k in range(4):
        sizes = {n: v[k] if isinstance(v, tuple) else v for n, v in SIZES.get(name, {}).items()}
        effects = [EFFECTS[name](**sizes)] if name else []
        flights.append(flown(effects, model=model, seed=seed, number=k, kelvin=warmth[k]))
    return flights


def with_steps_that_come_earlier(flight, joules):
    """The flight with two steps of 50 mV in a cell's curve, at 25 degC where the lab saw them.

    Otherwise they lag by three per cent of the charge times what the drop has grown by.
    """
    grown = np.exp(joules / 8.314462618 * (1.0 / flight.temperature_k - 1.0 / 298.15))
    soc = 1.0 - flight.charge_c / CAPACITY_C
    lag = 0.03 * (grown - 1.0) * np.clip(flight.current_a / 12.5, 0.0, 1.0)
    more = sum(0.05 / (1.0 + np.exp((at - soc + lag) / 0.01)) - 0.05 / (1.0 + np.exp((at - soc) / 0.01))
               for at in (0.93, 0.75))  # fmt: skip
    return replace(flight, voltage_v=flight.voltage_v + SERIES * more)
