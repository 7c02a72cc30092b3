"""Phantom drivers: what fits as well although it cannot be the cause.

An effect that is driven by temperature or age is fitted again with drivers that vary as smoothly but are not it: that
of other flights, time in the air, charge used, the same with its phases drawn anew. A name that does not beat them is
only one of several.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bhm_service.discrepancy.cores import on_cores
from bhm_service.discrepancy.explanation import Contest
from bhm_service.discrepancy.fitting import Bare, fit
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.odds import NEAR, Names
from bhm_service.discrepancy.search import Search
from bhm_service.units import REFERENCE_TEMPERATURE_K, Array

_WARMING_K = 15.0  # by which a phantom pack warms up along a flight
_SHIFTS = 3  # permutations of the flights' drivers


BEATEN = 0.8  # of the phantoms, below which a driver has no claim
_ALONG: Mapping[str, Callable[[FlightData], Array]] = {
    "time in the air": lambda f: f.time_s,
    "charge used": lambda f: f.charge_c,
}


@dataclass(frozen=True, slots=True)
class Phantom:
    """A driver that is not it: its courses on the flights [K], and on a flight to come."""

    courses: list[Array]
    anew: Callable[[FlightData], Array]


def contests(found: Search, names: Names, rng: np.random.Generator) -> list[Contest]:
    """The chosen set against itself with phantom temperatures; empty where no member depends on temperature."""
    members = [c for c in found.candidates if c.id in names]
    driven = [c for c in members if c.driven_by_temperature]
    if not driven:
        return []
    flights = found.base.flights
    hidden = any(c.inferred for c in driven)
    phantoms = _hidden_phantoms(flights) if hidden else _phantoms(flights, rng)
    true = found.fitted(names)
    by = found.inflation
    plain = tuple(c.alone() if c.inferred else c for c in members)
    joints = [
        Joint(found.base.lab, _given(flights, phantom.courses), plain, found.base.start_sd)
        for phantom in phantoms.values()
    ]
    rivals = on_cores([partial(_fitted, joint, found.noise) for joint in joints], found.cores)
    results = []
    for (name, phantom), joint, bare in zip(phantoms.items(), joints, rivals, strict=True):
        rival = bare.on(joint, found.noise)
        # Where the warmth itself has to be found, that it could have been another is not what a phantom beats it by.
        nats = 0.5 * (rival.cost - true.cost) / by if hidden else true.evidence(by) - rival.evidence(by)
        results.append(Contest(name, float(nats), bool(nats > NEAR), rival, phantom.anew))
    return results


def _given(flights: tuple[FlightData, ...], courses: list[Array]) -> tuple[FlightData, ...]:
    """The flights with these temperatures."""
    return tuple(replace(f, temperature_k=t) for f, t in zip(flights, courses, strict=True))


def _fitted(joint: Joint, noise: Noise) -> Bare:
    return fit(joint, noise).bare


def _phantoms(flights: tuple[FlightData, ...], rng: np.random.Generator) -> dict[str, Phantom]:
    courses = [t for f in flights if (t := f.temperature_k) is not None]
    assert len(courses) == len(flights)
    every = np.concatenate(courses)
    mean, spread = float(np.mean(every)), float(np.std(every)) + 1e-3
    found: dict[str, Phantom] = {}
    for shift in range(1, min(_SHIFTS, len(flights) - 1) + 1):
        shifted = [_stretched(courses[(k + shift) % len(flights)], f.time_s.size) for k, f in enumerate(flights)]
        found[f"temperature of other flights ({shift})"] = Phantom(shifted, _like(flights[0], shifted[0]))
    for name, of in _ALONG.items():
        along = np.concatenate([of(f) for f in flights])
        rise = spread / max(float(along.std()), 1e-9)
        found[name] = _along(flights, of, mean - rise * float(along.mean()), rise)
    means = [float(t.mean()) for t in courses]
    drawn = [means[int(rng.integers(len(means)))] + _phase(t, rng) for t in courses]
    return found | {"phases drawn anew": Phantom(drawn, _like(flights[0], drawn[0]))}


def _like(flight: FlightData, course: Array) -> Callable[[FlightData], Array]:
    """Of a flight to come: as it was on another, whatever is done."""
    return lambda data: np.interp(data.time_s, flight.time_s, course)


def _hidden_phantoms(flights: tuple[FlightData, ...]) -> dict[str, Phantom]:
    most = {name: max(float(of(f)[-1]) for f in flights) for name, of in _ALONG.items()}
    return {name: _along(flights, of, REFERENCE_TEMPERATURE_K, _WARMING_K / most[name]) for name, of in _ALONG.items()}


def _along(flights: tuple[FlightData, ...], of: Callable[[FlightData], Array], start: float, rise: float) -> Phantom:
    """A temperature that rises evenly with something else."""

    def anew(data: FlightData) -> Array:
        return start + rise * of(data)

    return Phantom([anew(f) for f in flights], anew)


def _stretched(course: Array, size: int) -> Array:
    return np.interp(np.linspace(0.0, 1.0, size), np.linspace(0.0, 1.0, course.size), course)


def _phase(course: Array, rng: np.random.Generator) -> Array:
    spectrum = np.fft.rfft(course - course.mean())
    turned = np.abs(spectrum) * np.exp(2j * np.pi * rng.random(spectrum.size))
    return np.asarray(np.fft.irfft(turned, course.size))
