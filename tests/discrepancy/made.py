"""A small pack with round numbers, and flights that it flew with an effect of the catalogue: quick to search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from battery.cells import CURVE, circ

from bhm_service.battery.battery_file import BatteryFile
from bhm_service.battery.effects import EFFECTS, Effect
from bhm_service.battery.pack import PackModel
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.discrepancy.candidate import candidates
from bhm_service.discrepancy.explanation import Course
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.search import Search
from bhm_service.units import ZERO_CELSIUS_K

SERIES = 6
BATTERY = BatteryFile(
    name="test pack",
    series=SERIES,
    circ=circ(r_s=0.004, r_sp0=0.003, r_sp1=0.0, ocv=CURVE),
    uncertainty=Uncertainty(voltage_error_v=0.01),
)
NOISE = Noise(0.3, 0.1, 0.01)


def lab() -> Lab:
    return lab_of(BATTERY, "circ", None, None)


def flight(number: int, celsius: float = 20.0, amps: float = 20.0, seconds: int = 300) -> FlightData:
    """Half a minute on the ground, a hover with steps, half a minute on the ground; nothing measured yet."""
    t = np.arange(0.0, seconds, 2.0)
    airborne = (t >= 30.0) & (t < seconds - 30.0)
    current = np.where(airborne, amps * (1.0 + 0.3 * (np.sin(t / 7.0) > 0.5)), 0.5)
    nowhere = np.full(t.size, np.nan)
    return FlightData(
        label=f"{number:02d}.tlog", time_s=t, current_a=current, voltage_v=nowhere.copy(),
        temperature_k=np.full(t.size, celsius + ZERO_CELSIUS_K), airborne=airborne, altitude_m=nowhere,
        climb_mps=nowhere, speed_mps=nowhere, pressure_pa=nowhere,
    )  # fmt: skip


def flown(data: FlightData, effects: Sequence[Effect] = (), seed: int = 1, soc: float = 1.0) -> FlightData:
    """The flight with the voltage that the pack would have had."""
    pack = PackModel(BATTERY.cell("circ"), SERIES, 1.0, effects)
    run = pack.simulate(data.time_s, data.current_a, soc, data.temperature_k)
    noise = np.random.default_rng(seed).normal(0.0, 0.01, data.time_s.size)
    return replace(data, voltage_v=np.ravel(run.voltage) + noise)


def course(data: FlightData, effects: Sequence[Effect] = (), soc: float = 1.0) -> Course:
    """The flight by the battery as it is and with effects."""
    before, after = (
        PackModel(BATTERY.cell("circ"), SERIES, 1.0, own).simulate(data.time_s, data.current_a, soc, data.temperature_k)
        for own in ((), effects)
    )
    return Course(data, np.ravel(before.voltage), np.ravel(after.voltage), np.ravel(after.soc))


def searched(flights: Sequence[FlightData], costs: Mapping[tuple[str, ...], float]) -> Search:
    """A search that found these costs for these sets; nothing is fitted."""
    tried, _ = candidates(flights, "circ", 100.0)
    found = Search(Joint(lab(), tuple(flights)), tuple(tried), NOISE)
    for names, cost in costs.items():
        joint = found.joint(frozenset(names))
        x = joint.unknowns.start
        found.fits[frozenset(names)] = Fitted(joint, NOISE, x, cost, [np.ones(100)], np.eye(x.size), np.zeros(x.size))
    return found


def si(effect_id: str, values: Mapping[str, float]) -> Effect:
    """An effect from values in the declared units."""
    declared = {p.name: p for p in EFFECTS[effect_id].parameters()}
    return EFFECTS[effect_id](**{name: declared[name].si(value) for name, value in values.items()})
