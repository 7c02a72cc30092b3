"""Flights in the world: all of a case at once, beside their twins that carry no effect, or one effect less."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.concealed.electrics import Electrics, current_for
from sim.concealed.knobs import Knobs
from sim.concealed.load import DT, REST_S, Indices, Load
from sim.concealed.packs import SERIES, Array, Pack
from sim.concealed.thermal import Heat

SECOND = round(1.0 / DT)
LOW_CELL_V = 3.30  # under load: the pilot lands, the pack is empty
_LOW_S = 4  # a pilot waits that long: gusts are no empty pack
RESERVE = 0.20  # of what the lab's slow discharge takes out
REST_MINUTES = 20
_LONGEST_S = 5400


@dataclass(frozen=True, slots=True)
class Flown:
    """What happened (F, K), ten times a second from the plan's first step."""

    load: Load
    position: Indices  # (F, K) step of the plan that was flown
    ends: Indices  # (F,) step after the last that is logged
    current_a: Array  # of the pack
    told_a: Array  # what the shunt tells, without noise
    voltage_v: Array
    twins_v: Array  # (T, F, K) of the pack in other worlds, were the told current what their sensors say
    cells_v: Array  # (F, S, 6) once a second
    soc: Array  # (F, S) charge left of what the pack can hold
    core_c: Array  # (F, S) mean of the cells
    surface_c: Array
    rested_v: Array  # (F,) 20 min after landing
    landing: Indices  # (F,) step
    takeoff: Indices
    empty_soc_s: Array  # (F,) since the plan's first step: when the reserve would be left, had the flight gone on
    empty_voltage_s: Array  # when a cell would fall to 3.3 V
    power_w: Array  # (F, K) that the load took
    heat_j: Array  # (F,) made in the cells since the start
    lost_j: Array  # given to the air
    stored_j: Array  # kept as warmth


def _heat_of(pack: Pack, worlds: list[Knobs]) -> Heat:
    return Heat.of(
        pack,
        np.concatenate([w.heat.start_c for w in worlds]),
        np.concatenate([w.heat.ambient_c for w in worlds]),
        np.concatenate([np.full(w.flights, float(w.heat.heats)) for w in worlds]),
        np.concatenate([np.full(w.flights, w.heat.cooling) for w in worlds]),
        np.concatenate([np.full(w.flights, w.heat.core) for w in worlds]),
    )


def contact_along(knobs: Knobs, begins: Indices, steps: int) -> Array:
    """Contact resistance along the flights (F, K) [Ohm]."""
    out = np.repeat(knobs.cells.contact_ohm[:, None], steps, axis=1)
    for bad in knobs.cells.contact_steps:
        a, b = (int(begins[bad.flight]) + round(s / DT) for s in (bad.start_s, bad.end_s))
        out[bad.flight, a:b] += bad.ohm
    return out


def hidden_along(knobs: Knobs, steps: int) -> Array:
    """Current past the shunt (F, K) [A]."""
    out = np.repeat(knobs.sensors.unseen_a[:, None], steps, axis=1)
    heater = knobs.sensors.heater
    if heater is not None:
        phase = np.arange(knobs.flights)[:, None] * 0.37 * heater.period_s
        time = np.arange(steps)[None, :] * DT + phase
        out = out + heater.ampere * ((time % heater.period_s) < heater.duty * heater.period_s)
    return out


def turns(cells_v: Array, steps: int) -> Indices:
    """Steps (F,) at which pilots see that a cell has been low for too long; ``steps`` where they never do.

    ``cells_v`` are voltages (F, S, 6) once a second, of a flight of so many ``steps`` at most.
    """
    found = np.full(len(cells_v), steps, dtype=np.intp)
    low_for = np.zeros(len(cells_v))
    for second in range(cells_v.shape[1]):
        low_for = _low_for(low_for, cells_v[:, second])
        found[(low_for > _LOW_S) & (found == steps)] = SECOND * second
    return found


def _low_for(before: Array, cells_v: Array) -> Array:
    """For how long a cell has been low (F,), with this second's voltages (F, 6). [s]"""
    return np.where(cells_v.min(axis=1) < LOW_CELL_V, before + 1.0, 0.0)


def fly(
    pack: Pack,
    knobs: Knobs,
    twins: tuple[Knobs, ...],
    load: Load,
    empty_soc: float = 0.0,
    latest: Indices | float = np.inf,
) -> Flown:
    """Fly a case: lanes of the world with its effect, and twins in others, through the same steps.

    A twin carries the current that its own sensors would have to see to tell what is told. ``empty_soc`` is the mean
    state of charge of the cells when the lab calls the pack empty, which it does by the weakest of them. From the step
    ``latest`` (F,) on a pilot takes the pack for empty, whatever these cells say.
    """
    plan, sensors = load.plan, knobs.sensors
    worlds = [knobs, *twins]
    flights, steps = load.power_w.shape
    lane = np.arange(flights)
    cells, heat = Electrics.of(pack, [w.cells for w in worlds], DT), _heat_of(pack, worlds)
    contact = np.concatenate([contact_along(w, plan.begins, steps) for w in worlds])
    hidden = np.concatenate([hidden_along(w, steps) for w in worlds])
    twin_gain = np.concatenate([w.sensors.current_gain for w in worlds[1:]] or [np.empty(0)])
    twin_offset = np.concatenate([w.sensors.current_offset_a for w in worlds[1:]] or [np.empty(0)])
    twin_vibration = np.repeat([w.sensors.vibration for w in worlds[1:]], flights)
    seen = np.full((3, flights, steps), np.nan)
    volts_seen = np.full((len(worlds) * flights, steps), np.nan)
    seen_core, seen_surface, soc = (np.full((flights, steps // SECOND + 1), np.nan) for _ in range(3))
    where = np.full((flights, steps), steps - 1, dtype=np.intp)
    cells_v = np.full((flights, steps // SECOND + 1, SERIES), np.nan)
    position, ends = np.zeros(flights, dtype=np.intp), np.zeros(flights, dtype=np.intp)
    low_for = np.zeros(flights)
    turning: dict[int, tuple[Electrics, Heat, int]] = {}
    resting: dict[int, tuple[Electrics, Heat]] = {}
    airborne = np.zeros(len(worlds) * flights)
    for k in range(steps):
        if k % SECOND == 0:
            cells.refresh(heat.core_c)
            second = k // SECOND
            seen_core[:, second] = heat.core_c[:flights].mean(axis=1)
            seen_surface[:, second] = heat.surface_c[:flights].mean(axis=1)
            airborne = np.tile(plan.airborne[lane, position].astype(float), len(worlds))
        source, ohm = cells.source(contact[:, k])
        power, unseen = load.power_w[lane, position], hidden[:flights, k]
        current = current_for(power, source[:flights], ohm[:flights], unseen)
        shake = load.vibration_g[lane, position]
        told = (current - unseen) * (1.0 - sensors.vibration * shake) * sensors.current_gain + sensors.current_offset_a
        carried = (np.tile(told, len(twins)) - twin_offset) / twin_gain
        carried = carried / (1.0 - twin_vibration * np.tile(shake, len(twins))) + hidden[flights:, k]
        everything = np.concatenate([current, carried])
        volts_seen[:, k] = source - ohm * everything
        seen[:, :, k] = current, told, power
        where[:, k] = position
        if k % SECOND == 0:
            of_cells = cells.cells_v(everything)[:flights]
            cells_v[:, second], soc[:, second] = of_cells, cells.z[:flights].mean(axis=1)
            low_for = _low_for(low_for, of_cells)
        heat.step(cells.step(everything), airborne, DT)
        low = (low_for > _LOW_S) | (k >= latest)
        due = (position >= plan.land) | (low & plan.may_land[lane, position])
        down = due & (position < plan.descent)
        if down.any():
            for flight in map(int, np.flatnonzero(down)):
                turning[flight] = (cells.lanes([flight], 1.0), heat.lanes([flight]), k + 1)
        position = np.where(down, plan.descent, position + 1)
        if position.max() >= steps:
            for flight in map(int, np.flatnonzero((position >= steps) & (ends == 0))):
                ends[flight] = k + 1
                resting[flight] = (cells.lanes([flight], 10.0), heat.lanes([flight]))
            position = np.minimum(position, steps - 1)
            if (ends > 0).all():
                break
    flying = plan.airborne[0, where] & (np.arange(steps)[None, :] < ends[:, None])
    takeoff = np.argmax(flying, axis=1)
    landing = steps - np.argmax(flying[:, ::-1], axis=1)
    reserve_soc = empty_soc + RESERVE * (1.0 - empty_soc)
    soc_s, voltage_s = _flown_on(knobs, turning, seen[2], takeoff, reserve_soc)
    # What flies on through its reserve has left it before it turns to land.
    below = soc <= reserve_soc
    soc_s = np.where(below.any(axis=1), np.fmin(soc_s, below.argmax(axis=1)), soc_s)
    nodes = (heat.core_j_per_k, heat.surface_j_per_k)
    warm = nodes[0] * (heat.core_c[:flights] - knobs.heat.start_c[:, None])
    warm = warm + nodes[1] * (heat.surface_c[:flights] - knobs.heat.start_c[:, None])
    return Flown(
        load=load,
        position=where,
        ends=ends,
        cells_v=cells_v,
        rested_v=_rested(resting, flights),
        landing=landing,
        takeoff=takeoff,
        empty_soc_s=soc_s,
        empty_voltage_s=voltage_s,
        heat_j=cells.heat_j[:flights].sum(axis=1),
        lost_j=heat.lost_j[:flights].sum(axis=1),
        stored_j=warm.sum(axis=1),
        soc=soc,
        core_c=seen_core,
        surface_c=seen_surface,
        current_a=seen[0],
        told_a=seen[1],
        voltage_v=volts_seen[:flights],
        twins_v=volts_seen[flights:].reshape(len(twins), flights, steps),
        power_w=seen[2],
    )


def _rested(resting: dict[int, tuple[Electrics, Heat]], flights: int) -> Array:
    """Voltage [V] when the pack has rested, unplugged, until 20 min after landing."""
    out = np.empty(flights)
    for flight, (cells, heat) in resting.items():
        none = np.zeros(1)
        for _ in range((60 * REST_MINUTES - round(REST_S)) // 10):
            cells.refresh(heat.core_c)
            heat.step(cells.step(none), none, 10.0)
        cells.refresh(heat.core_c)
        out[flight] = cells.source(none)[0][0]
    return out


def _flown_on(
    knobs: Knobs, turning: dict[int, tuple[Electrics, Heat, int]], power_w: Array, takeoff: Indices, reserve_soc: float
) -> tuple[Array, Array]:
    """When charge and voltage would have ended each flight (F,) [s], had it gone on at its mean power."""
    flights = len(takeoff)
    order = sorted(turning)
    cells = Electrics.joined([turning[f][0] for f in order])
    soc_s, volt_s = np.full(flights, np.nan), np.full(flights, np.nan)
    mean_w = np.array([power_w[f, takeoff[f] + 150 : turning[f][2]].mean() for f in order])
    begin = np.array([turning[f][2] * DT for f in order])
    core = np.concatenate([turning[f][1].core_c for f in order])
    contact, hidden = knobs.cells.contact_ohm[order], knobs.sensors.unseen_a[order]
    soc_left, volt_left = np.full(len(order), np.nan), np.full(len(order), np.nan)
    for second in range(_LONGEST_S):
        if second % 10 == 0:
            cells.refresh(core)
        source, ohm = cells.source(contact)
        current = current_for(mean_w, source, ohm, hidden)
        low = cells.cells_v(current).min(axis=1) < LOW_CELL_V
        volt_left = np.where(np.isnan(volt_left) & low, second, volt_left)
        soc_left = np.where(np.isnan(soc_left) & (cells.z.mean(axis=1) <= reserve_soc), second, soc_left)
        if not (np.isnan(volt_left).any() or np.isnan(soc_left).any()):
            break
        cells.step(current)
    soc_s[order], volt_s[order] = begin + soc_left, begin + volt_left
    return soc_s, volt_s
