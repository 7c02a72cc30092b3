"""What an effect does to the voltage of flights: the pack run along each of them with it and without it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.effects import EFFECTS, Effect
from bhm_service.battery.pack import PackModel
from bhm_service.discrepancy.candidate import driven, known_drivers
from bhm_service.discrepancy.explanation import Course
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.lab import Lab
from bhm_service.units import Array, Flags, Value

_MINUTE_S = 60.0


@dataclass(frozen=True, slots=True)
class Toll:
    """One flight: by what the effect lowers its voltage. [V]"""

    label: str
    takeoff_v: float  # mean of the first minute in the air
    landing_v: float  # of the last one
    most_v: float  # largest of all, either way


def tolls(
    effect_id: str, values: Mapping[str, Value], lab: Lab, flights: Sequence[FlightData], courses: Sequence[Course]
) -> list[Toll]:
    """Of every flight; ``values`` in the declared units, those that differ from flight to flight as (flights,)."""
    found = []
    for k, (data, course) in enumerate(zip(flights, courses, strict=True)):
        effect = effect_of(effect_id, values, flights, k)
        begun = float(course.soc[0])
        # What starts lower because of the effect would have started higher without it.
        assumed = begun + (begun - float(np.asarray(effect.initial_soc(begun))))
        kelvin = temperature_k(course)
        run = [
            PackModel(lab.cell, lab.series, lab.parallel, own).simulate(data.time_s, data.current_a, assumed, kelvin)
            for own in (lab.effects, (*lab.effects, effect))
        ]
        lower = np.ravel(run[0].voltage - run[1].voltage)
        first, last = minute_after_takeoff(data), _minute_before_landing(data)
        most = lower[int(np.argmax(np.abs(lower)))]
        found.append(Toll(data.label, float(lower[first].mean()), float(lower[last].mean()), float(most)))
    return found


def effect_of(effect_id: str, values: Mapping[str, Value], flights: Sequence[FlightData], index: int) -> Effect:
    """The effect in one of the flights, from values in the declared units."""
    kind = EFFECTS[effect_id]
    given: dict[str, float] = {}
    for p in kind.parameters():
        told = values.get(p.name)
        if told is None and p.driver is not None and p.driver in known_drivers(flights):
            told = driven(flights, p.driver)[index]
        if told is not None:
            row = np.ravel(told)
            given[p.name] = p.si(float(row[index if p.per_flight and row.size > 1 else 0]))
    return kind(**given)


def temperature_k(course: Course) -> Array | None:
    """Temperature of the pack along a flight: measured, else inferred, else None."""
    if course.flight.temperature_k is not None:
        return course.flight.temperature_k
    inferred = course.hidden.get("temperature")
    return None if inferred is None else inferred[0]


def minute_after_takeoff(data: FlightData) -> Flags:
    """Which samples are of a flight's first minute in the air; of the recording, where nobody knows of take-offs."""
    since = data.since_takeoff_s
    return np.asarray((since >= 0.0) & (since <= _MINUTE_S))


def _minute_before_landing(data: FlightData) -> Flags:
    last = data.time_s[np.flatnonzero(data.airborne)[-1]] if data.airborne.any() else data.time_s[-1]
    return np.asarray((data.time_s <= last) & (data.time_s >= last - _MINUTE_S))
