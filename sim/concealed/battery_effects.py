"""Effects of the battery: heat, age, charge, kinetics, contacts."""

from __future__ import annotations

import numpy as np

from sim.concealed.catalogue import EffectKind, Scene
from sim.concealed.knobs import ContactStep
from sim.concealed.packs import FARADAY, GAS, GRID, SERIES, Array, Pack

_SLOWED_MOHM = 6.0  # a size of the first world over this is by how much longer diffusion takes in the second


def pulse_ohm(pack: Pack, celsius: float, current_a: float) -> float:
    """Resistance of a new pack at half charge after ten seconds of a current, at a temperature."""
    kelvin = celsius + 273.15
    tilt = (1.0 / kelvin - 1.0 / 298.15) / GAS
    ohmic, kinetic, diffusion = (np.exp(e * tilt) for e in pack.activation_j_mol)
    z_slope = float(np.interp(0.52, GRID, pack.ocv_v) - np.interp(0.48, GRID, pack.ocv_v)) / 0.04
    charge = 3600.0 * pack.capacity_ah
    depleted = sum(
        share * pack.depletion_s * diffusion / charge * (1.0 - np.exp(-10.0 / (tau * diffusion)))
        for share, tau in zip(pack.ladder_share, pack.ladder_s, strict=True)
    )
    electrolyte = pack.electrolyte.sum() * ohmic * (1.0 - np.exp(-10.0 / pack.electrolyte_s))
    exchange = pack.exchange_a / kinetic * (4.0 * 0.5 * 0.55) ** 0.5
    kinetic_v = (2.0 * GAS * kelvin / FARADAY * np.arcsinh(current_a / (2.0 * exchange))).sum()
    return float(pack.ohmic.sum() * ohmic + electrolyte + kinetic_v / current_a + SERIES * depleted * z_slope)


def activation_kj_mol(pack: Pack, low_c: float, high_c: float) -> float:
    """Activation energy [kJ/mol] of the resistance as a whole between two temperatures."""
    hover = pack.hover_c_rate * pack.capacity_ah
    ratio = np.log(pulse_ohm(pack, low_c, hover) / pulse_ohm(pack, high_c, hover))
    return float(ratio * GAS / (1.0 / (low_c + 273.15) - 1.0 / (high_c + 273.15)) / 1000.0)


def _seasons(scene: Scene, contrast: float) -> Array:
    """Temperatures of the flights, of pack and air: mostly colder than the lab."""
    spread = scene.shuffled(25.0 - 1.2 * contrast, 25.0 + 0.4 * contrast)
    ambient = spread + scene.rng.uniform(-1.0, 1.0, scene.flights)
    scene.demand(air_c=ambient)
    scene.permitted.append("air-density")
    return ambient


def _resistance_temperature(scene: Scene, contrast: float) -> None:
    ambient = _seasons(scene, contrast)
    scene.cells(arrhenius=1.0, entropy=max(scene.knobs.cells.entropy, 0.0))
    scene.heat(heats=True, start_c=ambient, ambient_c=ambient)
    _tell_heat(scene, float(ambient.min()), 30.0)


def _tell_heat(scene: Scene, low_c: float, high_c: float) -> None:
    if scene.sheet.world == "porous":
        return  # its cells have a temperature law and a heat balance of their own
    scene.tell("activation_energy", activation_kj_mol(scene.pack, low_c, high_c), "kJ/mol")
    scene.tell("heat_capacity", scene.pack.heat_j_per_k, "J/K")
    scene.tell("cooling", scene.pack.cooling_w_per_k * scene.knobs.heat.cooling, "W/K")


def _self_heating(scene: Scene, insulation: float) -> None:
    scene.cells(arrhenius=1.0)
    same = np.full(scene.flights, 25.0)
    scene.heat(heats=True, start_c=same, ambient_c=same, cooling=1.0 / insulation)
    _tell_heat(scene, 25.0, 40.0)


def _core_lag(scene: Scene, factor: float) -> None:
    scene.heat(core=factor)  # shows beside an effect that warms the pack: see suites.py
    scene.tell("core_to_surface", scene.pack.core_k_per_w * factor / SERIES, "K/W of the pack")


def _entropic(scene: Scene, factor: float) -> None:
    ambient = _seasons(scene, 20.0)
    scene.heat(heats=True, start_c=ambient, ambient_c=ambient)
    scene.cells(entropy=factor)
    scene.tell("entropy", 1e3 * factor * float(np.interp(0.7, GRID, scene.pack.entropy_v_per_k)), "mV/K at 70 %")


def _aged(scene: Scene, amount: float) -> tuple[Array, bool]:
    """Amount at each flight, all of it at the oldest that is shown, and whether it grows with cycles in the sidecar."""
    if scene.sheet.ages_recorded and scene.rng.random() < 0.6:
        cycles = scene.cycles
        if cycles is None:
            cycles = np.floor(np.sort(scene.rng.uniform(1.0, 300.0, scene.flights)))
        scene.cycles = cycles
        return amount * cycles / _oldest(scene, cycles), True
    return np.full(scene.flights, amount), False


def _oldest(scene: Scene, cycles: Array) -> float:
    """Cycles of the oldest flight that is shown."""
    return float(cycles[scene.sheet.shown].max())


def _capacity_fade(scene: Scene, amount: float) -> None:
    lost, grows = _aged(scene, amount)
    scene.cells(capacity=scene.knobs.cells.capacity * (1.0 - lost[:, None]))
    if scene.sheet.world == "porous":
        scene.permitted.append("resistance-growth")  # its cell is smaller: the same current goes through less area
    scene.tell("capacity_lost", amount, "fraction at the oldest flight shown")
    _tell_cycles(scene, amount, grows)


def _tell_cycles(scene: Scene, amount: float, grows: bool) -> None:
    if grows and scene.cycles is not None:
        scene.tell("per_cycle", amount / _oldest(scene, scene.cycles), "fraction per cycle")


def _resistance_growth(scene: Scene, amount: float) -> None:
    more, grows = _aged(scene, amount)
    scene.cells(resistance=scene.knobs.cells.resistance * (1.0 + more[:, None]))
    scene.tell("growth", amount, "fraction at the oldest flight shown")
    _tell_cycles(scene, amount, grows)
    scene.accept = None if grows else ("resistance-growth", "contact-resistance")


def _cold_capacity(scene: Scene, per_k: float) -> None:
    ambient = _seasons(scene, 20.0)
    scene.heat(start_c=ambient, ambient_c=ambient)
    scene.cells(cold_per_k=per_k)
    scene.tell("per_kelvin", per_k, "1/K")


def _slow_diffusion(scene: Scene, milliohm: float) -> None:
    if scene.sheet.world == "porous":
        # Its cells have a diffusion of their own, which takes up to two and a half times as long.
        scene.cells(diffusion=scene.knobs.cells.diffusion / (1.0 + milliohm / _SLOWED_MOHM))
        return
    ohm = 1e-3 * milliohm / SERIES * 16.0 / scene.pack.capacity_ah
    tau = float(scene.rng.uniform(150.0, 450.0))
    scene.cells(slow_ohm=np.full(scene.flights, ohm), slow_s=tau)
    scene.tell("resistance", ohm, "Ohm of a cell")
    scene.tell("time_constant", tau, "s")


def _charge_transfer(scene: Scene, factor: float) -> None:
    scene.cells(exchange=scene.knobs.cells.exchange / factor)
    scene.tell("exchange_current", float(scene.pack.exchange_a.mean()) / factor, "A")


def _hysteresis(scene: Scene, millivolt: float) -> None:
    scene.cells(hysteresis_v=1e-3 * millivolt)
    scene.tell("half_loop", millivolt, "mV of a cell")


def _contact_resistance(scene: Scene, milliohm: float) -> None:
    first = int(scene.rng.choice([0, 0, scene.flights // 3]))
    ohm = np.where(np.arange(scene.flights) >= first, 1e-3 * milliohm, 0.0)
    scene.cells(contact_ohm=scene.knobs.cells.contact_ohm + ohm)
    scene.tell("resistance", 1e-3 * milliohm, "Ohm")
    scene.tell("first_flight", first, "flight")
    if first:
        scene.change_points.append((first, 0.0))


def _deep(scene: Scene) -> None:
    land = scene.knobs.demand.land_soc.copy()
    low, high = (0.13, 0.20) if scene.sheet.world == "ladder" else (0.22, 0.28)
    land[::2] = scene.rng.uniform(low, high, len(land[::2]))
    scene.demand(land_soc=land)


def _weak_cell(scene: Scene, less: float) -> None:
    cell = int(scene.rng.integers(SERIES))
    capacity, resistance = scene.knobs.cells.capacity.copy(), scene.knobs.cells.resistance.copy()
    capacity[:, cell] *= 1.0 - less
    resistance[:, cell] *= 1.0 + 1.5 * less
    scene.cells(capacity=capacity, resistance=resistance)
    _deep(scene)
    scene.tell("capacity_lost", less, "fraction of one cell")
    scene.tell("resistance_growth", 1.5 * less, "fraction of one cell")


def _partial_charge(scene: Scene, most: float) -> None:
    missing = scene.shuffled(0.0, most)
    scene.cells(soc=scene.knobs.cells.soc - missing[:, None])
    scene.tell("most_missing", most, "fraction of the charge")


def _self_discharge(scene: Scene, per_day: float) -> None:
    days = np.round(scene.shuffled(0.0, 24.0))
    scene.cells(soc=scene.knobs.cells.soc - per_day * days[:, None])
    scene.tell("per_day", per_day, "1/day")
    if scene.sheet.ages_recorded:
        scene.storage_days = days
    else:
        scene.accept = ("self-discharge", "partial-charge")


def _rate_capacity(scene: Scene, exponent: float) -> None:
    scene.cells(rate_exponent=1.0 + exponent)
    scene.demand(mass=scene.knobs.demand.mass * scene.shuffled(0.80, 1.30))
    scene.permitted += ["payload-mass", "propulsion-efficiency"]
    scene.tell("exponent", 1.0 + exponent, "")


def _ocv_shape(scene: Scene, millivolt: float) -> None:
    at, width = float(scene.rng.uniform(0.45, 0.75)), float(scene.rng.uniform(0.10, 0.16))
    bump = 1e-3 * scene.sign() * millivolt * np.exp(-0.5 * ((GRID - at) / width) ** 2)
    scene.cells(ocv_change_v=scene.knobs.cells.ocv_change_v + bump)
    scene.tell("height", millivolt, "mV of a cell")
    scene.tell("at", at, "state of charge")


def _resistance_shape(scene: Scene, more: float) -> None:
    shape = 1.0 + more * np.exp(-np.clip(GRID, 0.0, None) / 0.22)
    scene.cells(ohmic_change=shape / np.interp(0.8, GRID, shape))
    _deep(scene)
    scene.tell("more_when_empty", more, "fraction of the ohmic resistance")


def _intermittent(scene: Scene, milliohm: float) -> None:
    shown = scene.sheet.shown
    chosen = sorted(scene.rng.choice(shown, size=min(int(scene.rng.integers(1, 3)), len(shown)), replace=False))
    steps: list[ContactStep] = []
    for flight in map(int, chosen):
        start = float(np.round(scene.rng.uniform(150.0, 400.0)))
        end = start + float(np.round(scene.rng.uniform(80.0, 300.0)))
        steps.append(ContactStep(flight, start, end, 1e-3 * milliohm))
        scene.change_points += [(flight, start), (flight, end)]
    scene.cells(contact_steps=tuple(steps))
    scene.tell("resistance", 1e-3 * milliohm, "Ohm")


_WARM = ("resistance-temperature", "self-heating", "resistance-temperature+self-heating")
_R = ("contact-resistance", "resistance-growth")
BATTERY_EFFECTS = (
    EffectKind(name="resistance-temperature", sizes=(1.5, 6.0, 20.0), lay=_resistance_temperature, accept=_WARM),
    EffectKind(name="self-heating", sizes=(0.1, 0.6, 3.0), lay=_self_heating, accept=_WARM),
    EffectKind(name="core-lag", sizes=(4.0, 8.0, 12.0), lay=_core_lag, needs_temperature=True),
    EffectKind(name="entropic-voltage", sizes=(0.4, 0.9, 2.0), lay=_entropic, needs_temperature=True),
    EffectKind(name="capacity-fade", sizes=(0.035, 0.07, 0.14), lay=_capacity_fade),
    EffectKind(name="resistance-growth", sizes=(0.07, 0.20, 0.60), lay=_resistance_growth),
    EffectKind(name="cold-capacity", sizes=(0.0004, 0.0012, 0.005), lay=_cold_capacity, needs_temperature=True),
    EffectKind(name="slow-diffusion", sizes=(1.5, 4.0, 9.0), lay=_slow_diffusion),
    EffectKind(name="charge-transfer", sizes=(1.2, 1.8, 5.0), lay=_charge_transfer),
    EffectKind(name="hysteresis", sizes=(5.0, 12.0, 25.0), lay=_hysteresis, accept=("hysteresis", "ocv-shape")),
    EffectKind(name="contact-resistance", sizes=(0.4, 1.2, 6.0), lay=_contact_resistance, accept=_R),
    EffectKind(name="weak-cell", sizes=(0.05, 0.10, 0.18), lay=_weak_cell),
    EffectKind(name="partial-charge", sizes=(0.012, 0.04, 0.15), lay=_partial_charge),
    EffectKind(name="self-discharge", sizes=(0.0006, 0.0018, 0.006), lay=_self_discharge),
    EffectKind(name="rate-capacity", sizes=(0.012, 0.03, 0.09), lay=_rate_capacity),
    EffectKind(name="ocv-shape", sizes=(7.0, 15.0, 30.0), lay=_ocv_shape),
    EffectKind(name="resistance-shape", sizes=(0.2, 0.5, 1.6), lay=_resistance_shape),
    EffectKind(
        name="intermittent-contact",
        sizes=(0.4, 1.5, 10.0),
        lay=_intermittent,
        accept=("intermittent-contact", "unknown"),
    ),
)
