"""Effects of sensors and of the demand, and effects that no catalogue holds."""

from __future__ import annotations

import numpy as np

from sim.concealed.catalogue import EffectKind, Scene
from sim.concealed.knobs import Heater
from sim.concealed.packs import GRID

# ---- sensors --------------------------------------------------------------------------------------------------------


def _unseen_load(scene: Scene, ampere: float) -> None:
    amount = ampere * scene.pack.capacity_ah / 16.0
    scene.sensors(unseen_a=scene.knobs.sensors.unseen_a + amount)
    scene.tell("current", amount, "A")


def _current_offset(scene: Scene, ampere: float) -> None:
    amount = -scene.sign() * ampere * scene.pack.capacity_ah / 16.0
    scene.sensors(current_offset_a=scene.knobs.sensors.current_offset_a + amount)
    scene.tell("offset", amount, "A read too much")


def _current_gain(scene: Scene, share: float) -> None:
    gain = 1.0 + scene.sign() * share
    scene.sensors(current_gain=scene.knobs.sensors.current_gain * gain)
    scene.tell("gain", gain, "read / true")
    if gain < 1.0:
        # A pack that has lost electrode area reads the same: less charge, and in one fixed ratio more resistance.
        scene.accept = (
            "current-gain", "capacity-fade", "capacity-fade+resistance-growth", "capacity-fade+contact-resistance",
        )  # fmt: skip


def _voltage_gain(scene: Scene, share: float) -> None:
    gain = 1.0 + scene.sign() * share
    scene.sensors(voltage_gain=scene.knobs.sensors.voltage_gain * gain)
    scene.tell("gain", gain, "read / true")


def _voltage_offset(scene: Scene, millivolt: float) -> None:
    offset = scene.sign() * 1e-3 * millivolt
    scene.sensors(voltage_offset_v=scene.knobs.sensors.voltage_offset_v + offset)
    scene.tell("offset", offset, "V read too much")


def _time_skew(scene: Scene, seconds: float) -> None:
    scene.sensors(skew_s=scene.knobs.sensors.skew_s + seconds)
    scene.tell("lag", seconds, "s of the voltage behind the current")


# ---- demand ---------------------------------------------------------------------------------------------------------


def _air_density(scene: Scene, metres: float) -> None:
    scene.demand(field_m=scene.shuffled(10.0, metres), air_c=scene.shuffled(8.0, 30.0))
    scene.tell("highest_field", metres, "m")


def _payload(scene: Scene, share: float) -> None:
    carries = scene.rng.permutation(np.arange(scene.flights) % 2 == 0)
    mass = scene.knobs.demand.mass * np.where(carries, 1.0 + share, 1.0)
    scene.demand(mass=mass)
    scene.tell("payload", share, "fraction of the vehicle's mass")
    if scene.rng.random() < 0.5:
        when = np.where(carries, np.round(scene.rng.uniform(180.0, 350.0, scene.flights)), np.nan)
        scene.demand(release_s=when, released=np.where(carries, share / (1.0 + share), 0.0))
        scene.accept = ("payload-mass",)
        scene.change_points += [(int(f), float("nan")) for f in np.flatnonzero(carries)]  # set when take-off is known


def _wind(scene: Scene, mps: float) -> None:
    scene.demand(wind_mps=scene.shuffled(1.0, mps), plan=("windy-legs",) * scene.flights)
    scene.tell("strongest_wind", mps, "m/s")


def _some_fly(scene: Scene, plan: str, share: float) -> None:
    chosen = scene.rng.permutation(np.arange(scene.flights) < max(round(share * scene.flights), 1))
    scene.demand(plan=tuple(plan if c else "hover" for c in chosen))


def _lift(scene: Scene, share: float) -> None:
    _some_fly(scene, "speeds", share)
    scene.tell("induced_velocity", 6.5, "m/s in hover")


def _climb(scene: Scene, share: float) -> None:
    _some_fly(scene, "climbs", share)
    scene.tell("induced_velocity", 6.5, "m/s in hover")


def _efficiency(scene: Scene, lost: float) -> None:
    passed = np.linspace(0.0, 1.0, scene.flights)
    trend = lost * passed / passed[scene.sheet.shown].max()
    if scene.sheet.ages_recorded and scene.cycles is None:
        scene.cycles = np.round(np.linspace(10.0, 200.0, scene.flights))
    scene.demand(efficiency=scene.knobs.demand.efficiency * (1.0 - trend))
    scene.tell("lost", lost, "fraction at the last flight shown")


# ---- outside the catalogue ------------------------------------------------------------------------------------------


def _heater(scene: Scene, ampere: float) -> None:
    amount = ampere * scene.pack.capacity_ah / 16.0
    heater = Heater(
        ampere=amount, period_s=float(scene.rng.uniform(60.0, 200.0)), duty=float(scene.rng.uniform(0.3, 0.5))
    )
    scene.sensors(heater=heater)
    scene.tell("current", amount, "A while on")
    scene.tell("period", heater.period_s, "s")
    scene.tell("duty", heater.duty, "")


def _icing(scene: Scene, per_minute: float) -> None:
    scene.demand(icing_per_min=per_minute)
    scene.tell("growth", per_minute, "1/min of the blades' drag")


def _board_drift(scene: Scene, millivolt: float) -> None:
    scene.sensors(board_v_per_k=1e-3 * scene.sign() * millivolt)
    scene.tell("drift", millivolt, "mV/K of the pack's voltage with the board's temperature")


def _filter_change(scene: Scene, seconds: float) -> None:
    first = scene.flights // 2
    scene.sensors(voltage_lag_s=np.where(np.arange(scene.flights) >= first, seconds, 0.0))
    scene.tell("time_constant", seconds, "s of the voltage's new filter")
    scene.change_points.append((first, 0.0))


def _ocv_bump(scene: Scene, millivolt: float) -> None:
    at = float(scene.rng.uniform(0.5, 0.8))
    bump = 1e-3 * scene.sign() * millivolt * np.exp(-0.5 * ((GRID - at) / 0.03) ** 2)
    scene.cells(ocv_change_v=scene.knobs.cells.ocv_change_v + bump)
    scene.tell("height", millivolt, "mV of a cell")
    scene.tell("at", at, "state of charge")


def _vibration(scene: Scene, share: float) -> None:
    scene.sensors(vibration=share)
    scene.tell("lost", share, "share of the current at 1 g")


def _regenerates(scene: Scene, share: float) -> None:
    _some_fly(scene, "shuttle", share)
    scene.demand(regenerates=True)
    scene.tell("given_back", 0.12, "share of the hover power")


_NO_CURRENT = ("unseen-load", "current-offset")
_VOLTAGE = ("voltage-gain", "voltage-offset")
_LEVEL = ("payload-mass", "propulsion-efficiency")
SENSOR_EFFECTS = (
    EffectKind(name="unseen-load", sizes=(0.8, 1.6, 3.2), lay=_unseen_load, accept=_NO_CURRENT),
    EffectKind(name="current-offset", sizes=(0.8, 1.6, 3.2), lay=_current_offset, accept=_NO_CURRENT),
    EffectKind(name="current-gain", sizes=(0.03, 0.06, 0.12), lay=_current_gain),
    EffectKind(name="voltage-gain", sizes=(0.003, 0.007, 0.015), lay=_voltage_gain, accept=_VOLTAGE),
    EffectKind(name="voltage-offset", sizes=(60.0, 120.0, 250.0), lay=_voltage_offset, accept=_VOLTAGE),
    EffectKind(name="time-skew", sizes=(0.05, 0.15, 1.0), lay=_time_skew),
)
DEMAND_EFFECTS = (
    EffectKind(name="air-density", sizes=(300.0, 900.0, 2500.0), lay=_air_density, channel="power"),
    EffectKind(name="payload-mass", sizes=(0.006, 0.015, 0.12), lay=_payload, channel="power", accept=_LEVEL),
    EffectKind(name="wind-tilt", sizes=(5.0, 8.0, 12.0), lay=_wind, channel="power", term="tilt", twins_fly_it=True),
    EffectKind(
        name="translational-lift", sizes=(0.2, 0.5, 1.0), lay=_lift, channel="power", term="lift", twins_fly_it=True
    ),
    EffectKind(name="climb-power", sizes=(0.2, 0.5, 1.0), lay=_climb, channel="power", term="climb", twins_fly_it=True),
    EffectKind(
        name="propulsion-efficiency", sizes=(0.008, 0.02, 0.12), lay=_efficiency, channel="power", accept=_LEVEL
    ),
)
OUTSIDE_EFFECTS = (
    EffectKind(
        name="heater-duty-cycle",
        sizes=(2.0, 4.0, 7.0),
        lay=_heater,
        accept=("unknown", "unseen-load+unknown", "current-offset+unknown"),
    ),
    EffectKind(
        name="icing-drag",
        sizes=(0.01, 0.03, 0.06),
        lay=_icing,
        channel="power",
        accept=("unknown", "propulsion-efficiency+unknown"),
    ),
    EffectKind(
        name="board-temperature-drift",
        sizes=(3.0, 7.0, 14.0),
        lay=_board_drift,
        accept=("unknown", "voltage-gain+unknown", "voltage-offset+unknown"),
    ),
    EffectKind(
        name="filter-change",
        sizes=(0.7, 1.5, 3.0),
        lay=_filter_change,
        accept=("unknown", "time-skew", "time-skew+unknown"),
    ),
    EffectKind(
        name="ocv-bump",
        sizes=(8.0, 16.0, 30.0),
        lay=_ocv_bump,
        accept=("unknown", "ocv-shape", "ocv-shape+unknown"),
    ),
    EffectKind(
        name="vibration-shunt",
        sizes=(0.08, 0.16, 0.30),
        lay=_vibration,
        accept=("unknown", "current-gain", "current-gain+unknown"),
    ),
    EffectKind(
        name="regenerative-descent",
        sizes=(0.34, 0.5, 1.0),
        lay=_regenerates,
        channel="power",
        accept=("unknown", "climb-power", "climb-power+unknown"),
        twins_fly_it=True,
        term="regeneration",
    ),
)
