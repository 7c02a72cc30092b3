"""A sheet to a case: the directory that a tool may see, and the answer that it may not."""

from __future__ import annotations

import gzip
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sim.concealed import lab
from sim.concealed.answer import Answer, Regime, TrueEffect, TrueFlight, snr_class
from sim.concealed.battery_effects import BATTERY_EFFECTS
from sim.concealed.catalogue import EffectKind, Scene
from sim.concealed.flying import REST_MINUTES, SECOND, Flown, fly, turns
from sim.concealed.knobs import Knobs, neutral
from sim.concealed.load import DT, Load, Plan, demand, fly_plans
from sim.concealed.other_effects import DEMAND_EFFECTS, OUTSIDE_EFFECTS, SENSOR_EFFECTS
from sim.concealed.packs import GRID, SERIES, Array, Pack, draw_pack
from sim.concealed.porous import PorousPack
from sim.concealed.sensors import Quality, Recording, draw_quality, record, told_voltage
from sim.concealed.sheets import CaseSheet
from sim.concealed.strength import Shown, power_snr, ranges, voltage_snr
from sim.concealed.tlog import tlog
from sim.concealed.vehicle import vehicle_file

CATALOGUE: dict[str, EffectKind] = {e.name: e for e in (*BATTERY_EFFECTS, *SENSOR_EFFECTS, *DEMAND_EFFECTS)}
OUTSIDE: dict[str, EffectKind] = {e.name: e for e in OUTSIDE_EFFECTS}
EFFECTS = CATALOGUE | OUTSIDE
_EVERY_S = 30
_DECOYS = ("humidity_pct", "propeller_hours", "gps_satellites_mean", "operator_shift", "link_rssi_dbm")


@dataclass(frozen=True, slots=True)
class Laid:
    """A world with effects on it."""

    knobs: Knobs
    scene: Scene
    parameters: tuple[dict[str, dict[str, float | str]], ...]
    accepts: tuple[tuple[str, ...], ...]


def _flown(
    pack: Pack, porous: PorousPack | None, knobs: Knobs, twins: tuple[Knobs, ...], load: Load, empty_soc: float
) -> Flown:
    """The flights of a world; in the second one the first one's pilots land by the voltages that the second one has."""
    flown = fly(pack, knobs, twins, load, empty_soc)
    if porous is None:
        return flown
    steps = load.power_w.shape[1]
    latest = turns(porous.flown(flown, knobs, ()).cells_v, steps)
    # Once is enough: each flies the same up to there, and then it lands.
    if (latest < steps).any():
        flown = fly(pack, knobs, twins, load, empty_soc, latest)
    return porous.flown(flown, knobs, twins)


def _plain(sheet: CaseSheet, pack: Pack) -> Knobs:
    """The world without effects: the lab's pack, to within what a lab can tell."""
    rng = sheet.generator("plain")
    n = sheet.flights
    if sheet.rich:
        plans = tuple(rng.permutation([("legs", "shuttle", "hover")[k % 3] for k in range(n)]).tolist())
        # The second world's cells cannot be stepped past empty.
        land = rng.permutation(np.linspace(0.20 if sheet.world == "ladder" else 0.32, 0.55, n))
    else:
        plans = (str(rng.choice(["hover", "legs"])),) * n
        land = rng.uniform(0.38, 0.46, n)
    knobs = neutral(n, plans, land)
    by_flight = np.ones((n, 1))
    wobble = 0.006 if sheet.noise == "wrong-ocv" else 0.003
    knots = np.linspace(0.0, 1.0, 6)
    ocv = np.interp(GRID, knots, wobble * rng.standard_normal(len(knots)))
    cells = replace(
        knobs.cells,
        soc=(1.0 - np.abs(rng.normal(0.0, 0.004, (n, 1)))) * np.ones(SERIES),
        capacity=(1.0 + rng.normal(0.0, 0.008)) * by_flight * np.ones(SERIES),
        resistance=(1.0 + rng.normal(0.0, 0.02) + rng.normal(0.0, 0.004, (n, 1))) * np.ones(SERIES),
        ocv_change_v=ocv - np.interp(1.0, GRID, ocv),
    )
    sensors = replace(
        knobs.sensors,
        current_gain=np.full(n, 1.0 + rng.normal(0.0, 0.004)),
        current_offset_a=np.full(n, rng.normal(0.0, 0.03)),
        voltage_gain=np.full(n, 1.0 + rng.normal(0.0, 0.0006)),
    )
    vehicle = replace(knobs.demand, wind_mps=rng.uniform(0.5, 2.5, n), turbulence=rng.uniform(0.7, 1.3, n))
    return replace(knobs, cells=cells, sensors=sensors, demand=vehicle)


def _lay(sheet: CaseSheet, pack: Pack, plain: Knobs, which: Iterable[int]) -> Laid:
    scene = Scene(pack=pack, sheet=sheet, rng=sheet.generator("unused"), knobs=plain)
    parameters: list[dict[str, dict[str, float | str]]] = []
    accepts: list[tuple[str, ...]] = []
    for index in which:
        ordered = sheet.effects[index]
        kind = EFFECTS[ordered.name]
        scene.rng = sheet.generator(f"effect {index}")
        scene.parameters, scene.accept = {}, None
        amount = kind.sizes[("small", "medium", "large").index(ordered.size)] * scene.rng.uniform(0.85, 1.15)
        kind.lay(scene, float(amount))
        parameters.append(scene.parameters)
        accepts.append(scene.accept or kind.accepted)
    return Laid(scene.knobs, scene, tuple(parameters), tuple(accepts))


def _without(sheet: CaseSheet, pack: Pack, plain: Knobs, full: Knobs, index: int | None) -> Knobs:
    """The world without one effect, or without any: what a twin flies in."""
    rest = [] if index is None else [k for k in range(len(sheet.effects)) if k != index]
    lacking = range(len(sheet.effects)) if index is None else [index]
    knobs = _lay(sheet, pack, plain, rest).knobs
    terms = [EFFECTS[sheet.effects[k].name] for k in lacking]
    flown = [kind.term for kind in terms if kind.twins_fly_it and kind.term is not None]
    if flown:
        same = replace(full.demand, without=tuple(flown))
        if "regeneration" in flown:
            same = replace(same, regenerates=False)
        knobs = replace(knobs, demand=same)
    return knobs


def _plan(sheet: CaseSheet, pack: Pack, knobs: Knobs) -> Plan:
    rng = sheet.generator("plan")
    hover_s = 3600.0 * (1.0 - knobs.demand.land_soc) / pack.hover_c_rate * 0.92
    heavier = knobs.demand.mass**1.5 * 1.0
    return fly_plans(rng, knobs.demand.plan, np.maximum(hover_s / heavier - 50.0, 240.0))


def _demands(sheet: CaseSheet, pack: Pack, worlds: list[Knobs], plan: Plan) -> list[Load]:
    """The same air and the same pilot for every world."""
    return [demand(sheet.generator("air"), pack, world.demand, plan) for world in worlds]


def _power_along(load: Load, flown: Flown, flight: int) -> Array:
    seconds = np.arange(int(flown.load.plan.begins[flight]), int(flown.ends[flight]), SECOND)
    along: Array = load.power_w[flight, flown.position[flight, seconds]]
    return along


@dataclass(frozen=True, slots=True)
class _Difference:
    """What an effect changes in the recordings: differences (F)(S,) in both channels."""

    voltage: list[Array]
    power: list[Array]


def _difference(knobs: Knobs, twin: Knobs, flown: Flown, which: int, loads: list[Load]) -> _Difference:
    voltage, power = [], []
    for f in range(knobs.flights):
        begin, end = int(flown.load.plan.begins[f]), int(flown.ends[f])
        ours = told_voltage(knobs, f, flown.voltage_v[f, begin:end])
        theirs = told_voltage(twin, f, flown.twins_v[which, f, begin:end])
        voltage.append((ours - theirs)[::SECOND])
        power.append(_power_along(loads[0], flown, f) - _power_along(loads[which + 1], flown, f))
    return _Difference(voltage, power)


def _gust_w(flown: Flown) -> float:
    """Standard deviation [W] of the power about its own 20 s mean, in flight."""
    kernel = np.ones(20) / 20.0
    found = []
    for f in range(len(flown.ends)):
        seconds = np.arange(int(flown.takeoff[f]) + 20 * SECOND, int(flown.landing[f]) - 40 * SECOND, SECOND)
        power = flown.power_w[f, seconds]
        found.append(np.std((power - np.convolve(power, kernel, mode="same"))[20:-20]))
    return float(np.median(found))


def _shown(sheet: CaseSheet, flown: Flown, quality: Quality, pack: Pack, difference: list[Array]) -> list[Shown]:
    out = []
    ohm = float(pack.ohmic.sum())
    for f, delta in enumerate(difference):
        if f == sheet.kept_back:
            continue
        begin, end = int(flown.load.plan.begins[f]), int(flown.ends[f])
        at = np.arange(begin, end, SECOND)
        spectrum = quality.spectrum(len(delta)) + (ohm * quality.white_a) ** 2
        out.append(Shown(delta, spectrum, flown.soc[f, at // SECOND], flown.told_a[f, at]))
    return out


def _regimes(difference: list[Array], deviation: float) -> tuple[Regime, ...]:
    """Where an effect moves the recording by a standard deviation of its noise, or, where it never does, by more than
    half of what it does at its strongest.
    """
    smooth = [np.abs(np.convolve(delta, np.ones(5) / 5.0, mode="same")) for delta in difference]
    strongest = float(np.quantile(np.concatenate(smooth), 0.98))
    least = min(deviation, 0.5 * strongest)
    return tuple(
        Regime(flight=flight, start_s=a, end_s=b)
        for flight, size in enumerate(smooth)
        for a, b in ranges(size > max(least, 1e-9))
    )


def _effects(
    sheet: CaseSheet, pack: Pack, laid: Laid, twins: list[Knobs], flown: Flown, loads: list[Load], quality: Quality
) -> tuple[tuple[TrueEffect, ...], float, tuple[str, ...]]:
    """The true effects, the SNR of all together, and what could pass for a single one."""
    gust_w = _gust_w(flown)
    levels = [np.where(_power_along(loads[0], flown, f) > 3 * pack.avionics_w, 1.0, 0.0) for f in range(sheet.flights)]
    deviation = float(np.hypot(np.sqrt(quality.white_v**2 + quality.quantum_v**2 / 12.0), quality.red_v))
    found: list[TrueEffect] = []
    passing: tuple[str, ...] = ()
    together = 0.0
    for which in range(len(twins)):
        delta = _difference(laid.knobs, twins[which], flown, which, loads)
        volt_snr, mimics = voltage_snr(pack, _shown(sheet, flown, quality, pack, delta.voltage))
        watt_snr = power_snr([delta.power[f] for f in sheet.shown], [levels[f] for f in sheet.shown], gust_w)
        if which == 0:
            channels = {EFFECTS[e.name].channel for e in sheet.effects}
            together = max({"voltage": volt_snr, "power": watt_snr}[c] for c in channels)
            passing = mimics if len(sheet.effects) == 1 and channels == {"voltage"} else ()
        # A single effect's twin is the plain world itself; with more, twin k lacks effect k - 1.
        index = which if len(sheet.effects) == 1 else which - 1
        if index < 0:
            continue
        kind = EFFECTS[sheet.effects[index].name]
        power = kind.channel == "power"
        found.append(
            TrueEffect(
                name=kind.name,
                size=sheet.effects[index].size,
                channel=kind.channel,
                in_catalogue=kind.name in CATALOGUE,
                parameters=laid.parameters[index],
                snr=round(watt_snr if power else volt_snr, 2),
                regimes=_regimes(delta.power, gust_w) if power else _regimes(delta.voltage, deviation),
            )
        )
    return tuple(found), together, passing


def _accepted(laid: Laid, effects: tuple[TrueEffect, ...], passing: tuple[str, ...]) -> tuple[str, ...]:
    """Every right answer: one name of each effect; among several, one that cannot be seen may be left out."""
    if not laid.accepts:
        return ("none",)
    right = [""]
    for effect, names in zip(effects, laid.accepts, strict=True):
        choices = names if len(effects) == 1 or effect.snr >= 3.0 else (*names, "")
        right = [f"{so_far}+{name}".strip("+") for so_far in right for name in choices]
    right = [answer for answer in right if answer] or ["none"]
    return tuple(dict.fromkeys([*right, *passing]))


def _true_flight(laid: Laid, flown: Flown, f: int) -> TrueFlight:
    knobs, begin = laid.knobs, int(flown.load.plan.begins[f])
    at = np.arange(begin, int(flown.ends[f]), _EVERY_S * SECOND) // SECOND
    own = {
        "mass_factor": knobs.demand.mass[f],
        "efficiency": knobs.demand.efficiency[f],
        "field_m": knobs.demand.field_m[f],
        "air_c": knobs.demand.air_c[f],
        "wind_mps": knobs.demand.wind_mps[f],
        "start_c": knobs.heat.start_c[f],
        "ambient_c": knobs.heat.ambient_c[f],
        "start_soc": knobs.cells.soc[f].mean(),
        "capacity_factor": knobs.cells.capacity[f].mean(),
        "resistance_factor": knobs.cells.resistance[f].mean(),
        "contact_ohm": knobs.cells.contact_ohm[f],
        "unseen_a": knobs.sensors.unseen_a[f],
    }

    def series(values: Array, digits: int) -> tuple[float, ...]:
        return tuple(np.round(values, digits).tolist())

    return TrueFlight(
        file=f"{f:02d}.tlog",
        takeoff_s=round(float(flown.takeoff[f] - begin) * DT, 1),
        landing_s=round(float(flown.landing[f] - begin) * DT, 1),
        rest_voltage_v=round(float(flown.rested_v[f]), 4),
        every_s=float(_EVERY_S),
        soc=series(flown.soc[f, at], 4),
        core_c=series(flown.core_c[f, at], 2),
        surface_c=series(flown.surface_c[f, at], 2),
        empty_soc_s=round(float(flown.empty_soc_s[f]) - begin * DT, 1),
        empty_voltage_s=round(float(flown.empty_voltage_s[f]) - begin * DT, 1),
        parameters={name: round(float(value), 5) for name, value in own.items()},
    )


def _sidecar(sheet: CaseSheet, laid: Laid, flown: Flown) -> tuple[str, tuple[str, ...]]:
    """flights.csv, and the columns in it that mean nothing."""
    rng = sheet.generator("sidecar")
    n, scene = sheet.flights, laid.scene
    columns: dict[str, list[str]] = {
        "file": [f"{f:02d}.tlog" for f in range(n)],
        "battery_id": ["0"] * n,
        "rest_voltage_V": [f"{v + rng.normal(0.0, 0.003):.3f}" for v in flown.rested_v],
        "rest_minutes": [str(REST_MINUTES)] * n,
    }
    if sheet.ages_recorded:
        young = rng.integers(2, 30) + np.cumsum(rng.integers(1, 4, n))
        cycles = young if scene.cycles is None else scene.cycles
        days = rng.integers(0, 3, n) if scene.storage_days is None else scene.storage_days
        columns["cycles"] = [f"{c:.0f}" for c in cycles]
        columns["storage_days"] = [f"{d:.0f}" for d in days]
    decoys = tuple(str(d) for d in rng.permutation(_DECOYS)[: sheet.decoys])
    for decoy in decoys:
        trend = rng.uniform(10.0, 60.0) + rng.choice([-1.0, 1.0]) * np.arange(n) * rng.uniform(2.0, 8.0)
        columns[decoy] = [f"{v:.1f}" for v in trend + rng.normal(0.0, 1.0, n)]
    rows = [",".join(columns), *(",".join(values[k] for values in columns.values()) for k in range(n))]
    return "\n".join(rows) + "\n", decoys


def _boxed(sheet: CaseSheet, recordings: list[Recording]) -> list[Recording]:
    """The thermometer sits outside a heated box: it tells of the weather and of its own sun, not of the cells."""
    rng = sheet.generator("box")
    weather = rng.permutation(np.linspace(-4.0, 30.0, len(recordings)))
    warms = rng.uniform(4.0, 14.0, len(recordings))
    return [
        replace(r, temperature_c=np.round(c + w * (1.0 - np.exp(-r.boot_s / 500.0))))
        for r, c, w in zip(recordings, weather, warms, strict=True)
    ]


def _write(directory: Path, runs: dict[str, lab.LabRun], logs: list[bytes], sidecar: str) -> None:
    for name in ("lab", "flights"):
        (directory / name).mkdir(parents=True, exist_ok=True)
    for name, run in runs.items():
        # No time of writing in the file: the same seed gives the same bytes.
        packed = gzip.compress(run.rows().encode(), compresslevel=6, mtime=0)
        (directory / "lab" / f"{name}.csv.gz").write_bytes(packed)
    for index, log in enumerate(logs):
        (directory / "flights" / f"{index:02d}.tlog").write_bytes(log)
    (directory / "flights" / "flights.csv").write_text(sidecar)


def _release_points(laid: Laid, flown: Flown) -> tuple[tuple[int, float], ...]:
    """Change points, those of a payload's release counted from the log's start."""
    points = []
    for flight, seconds in laid.scene.change_points:
        at = seconds
        if np.isnan(seconds):
            after = laid.knobs.demand.release_s[flight]
            at = float(flown.load.plan.takeoff_s - flown.load.plan.begins[flight] * DT + after)
        points.append((flight, round(at, 1)))
    return tuple(points)


def generate(sheet: CaseSheet, directory: Path) -> Answer:
    """Write the case to a directory and return its answer. The same sheet gives the same bytes.

    Raises KeyError for an effect that the world does not know, BadInputError for the porous world
    without PyBaMM.
    """
    pack = draw_pack(sheet.generator("pack"))
    porous = None
    if sheet.world == "porous":
        porous = PorousPack(sheet.generator("porous"), pack)
        pack = porous.pack
    plain = _plain(sheet, pack)
    laid = _lay(sheet, pack, plain, range(len(sheet.effects)))
    if porous is not None and porous.entropic and laid.knobs.heat.heats:
        laid.scene.permitted.append("entropic-voltage")  # the lab, at 25 degC, could not know it
    lacking: list[int | None] = [None]
    if len(sheet.effects) > 1:
        lacking += list(range(len(sheet.effects)))
    twins = [_without(sheet, pack, plain, laid.knobs, index) for index in lacking] if sheet.effects else []
    plan = _plan(sheet, pack, laid.knobs)
    loads = _demands(sheet, pack, [laid.knobs, *twins], plan)
    bench = (
        lab.recordings(pack, sheet.generator("lab")) if porous is None else porous.recordings(sheet.generator("lab"))
    )
    flown = _flown(pack, porous, laid.knobs, tuple(twins), loads[0], lab.empty_soc(pack, bench["slow"]))
    quality = draw_quality(sheet.generator("quality"), sheet.noise)
    effects, snr, passing = _effects(sheet, pack, laid, twins, flown, loads, quality)
    rng = sheet.generator("sensors")
    recordings: list[Recording] = [
        record(rng, quality, laid.knobs, flown, f, sheet.temperature_recorded, sheet.cells_recorded)
        for f in range(sheet.flights)
    ]
    if sheet.boxed:
        recordings = _boxed(sheet, recordings)
    sidecar, decoys = _sidecar(sheet, laid, flown)
    logs = [tlog(recording, f) for f, recording in enumerate(recordings)]
    _write(directory, bench, logs, sidecar)
    # The second world's voltages go with currents that the first one's cells asked for: that power is no vehicle's.
    if porous is None:
        (directory / "vehicle.toml").write_text(vehicle_file(sheet, pack))
    return Answer(
        case=sheet.name,
        suite=sheet.suite,
        seed=sheet.seed,
        index=sheet.index,
        kind=sheet.kind,
        world=sheet.world,
        noise=sheet.noise,
        rich=sheet.rich,
        pack={"chemistry": pack.chemistry, "capacity_ah": pack.capacity_ah, "series": float(SERIES)},
        effects=effects,
        accept=_accepted(laid, effects, passing),
        permitted=tuple(laid.scene.permitted),
        change_points=_release_points(laid, flown),
        snr=round(snr, 2),
        snr_class=snr_class(snr),
        decoys=decoys,
        withheld=tuple(
            name
            for name, there in (("temperature", sheet.temperature_recorded), ("age", sheet.ages_recorded))
            if not there
        ),
        flights=tuple(_true_flight(laid, flown, f) for f in range(sheet.flights)),
    )
