"""Short flights with a story each, for golden replays: what the log holds and what happened in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from bhm_service.mavlink.encode import stamped
from sim.autopilot import Autopilot
from sim.battery import SimulatedPack
from sim.multirotor import Multirotor, State, hover_plan

_EPOCH_S = 1_750_000_000.0
_HOVER_W = 240.0
Edit = Callable[[State], State | None]


def _flight(seed: int, seconds: float, left: float, capacity_ah: float = 3.0) -> list[State]:
    pack = SimulatedPack(series=4, capacity_ah=capacity_ah, left=left)
    vehicle = Multirotor(pack, hover_plan(_HOVER_W, seconds), seed)
    states: list[State] = []
    while (state := vehicle.second()) is not None:
        states.append(state)
    return states


def _log(states: list[State], stamps: Callable[[State], float] | None = None) -> bytes:
    autopilot = Autopilot()
    out = bytearray()
    for state in states:
        for frame in autopilot.frames(state):
            out += stamped(_EPOCH_S + (state.time_s if stamps is None else stamps(state)), frame)
    return bytes(out)


def _edited(states: list[State], edit: Edit) -> list[State]:
    return [new for state in states if (new := edit(state)) is not None]


def hover() -> bytes:
    """Nothing goes wrong."""
    return _log(_flight(1, 150.0, 0.97))


def current_lost() -> bytes:
    """The current sensor says nothing for forty seconds in the middle."""

    def edit(state: State) -> State:
        return replace(state, current_a=-0.01) if 70.0 <= state.time_s < 110.0 else state

    return _log(_edited(_flight(2, 150.0, 0.90), edit))


def voltage_spikes() -> bytes:
    """Three readings from nowhere."""
    spikes = {50.0: 18.25, 51.0: 0.0, 90.0: 9.4}

    def edit(state: State) -> State:
        return replace(state, voltage_v=spikes.get(state.time_s, state.voltage_v))

    return _log(_edited(_flight(3, 150.0, 0.85), edit))


def clock_set() -> bytes:
    """The recorder's clock is set back an hour in flight."""
    return _log(_flight(4, 150.0, 0.92), lambda s: s.time_s - (3600.0 if s.time_s >= 80.0 else 0.0))


def pack_swapped() -> bytes:
    """Two flights; between them the autopilot is off and another pack goes in."""
    first, second = _flight(5, 60.0, 0.70), _flight(6, 60.0, 0.98)
    autopilot, out = Autopilot(), bytearray()
    for state in first:
        for frame in autopilot.frames(state):
            out += stamped(_EPOCH_S + state.time_s, frame)
    later = first[-1].time_s + 90.0
    autopilot = Autopilot()
    for state in second:
        for frame in autopilot.frames(state):
            out += stamped(_EPOCH_S + later + state.time_s, frame)
    return bytes(out)


def slow_link() -> bytes:
    """Every fifth second only."""

    def edit(state: State) -> State | None:
        return state if state.time_s % 5.0 == 0.0 else None

    return _log(_edited(_flight(7, 200.0, 0.95), edit))


FLIGHTS: dict[str, Callable[[], bytes]] = {
    flight.__name__: flight for flight in (hover, current_lost, voltage_spikes, clock_set, pack_swapped, slow_link)
}
