"""Phantom drivers: what fits as well although it cannot be the cause.

An effect that is driven by temperature or age is fitted again with drivers that vary as smoothly but are not it: that
of other flights, time in the air, charge used, the same with its phases drawn anew. A name that does not beat them is
only one of several.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bhm_service.discrepancy.explanation import Contest
from bhm_service.discrepancy.fitting import fit
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.search import NEAR, Names, Search
from bhm_service.units import REFERENCE_TEMPERATURE_K, Array

_WARMING_K = 15.0  # by which a phantom pack warms up along a flight
_SHIFTS = 3  # permutations of the flights' drivers


BEATEN = 0.8  # of the phantoms, below which a driver has no claim


def contests(found: Search, names: Names, rng: np.random.Generator) -> list[Contest]:
    """The chosen set against itself with phantom temperatures; empty where no member depends on temperature."""
    members = [c for c in found.candidates if c.id in names]
    driven = [c for c in members if any("temperature" in kind.drivers for _, kind in c.parts)]
    if not driven:
        return []
    flights = found.base.flights
    hidden = any(c.inferred for c in driven)
    phantoms = _hidden_phantoms(flights) if hidden else _phantoms(flights, rng)
    true = found.fitted(names)
    by = found.inflation
    results = []
    for name, series in phantoms.items():
        given = tuple(replace(f, temperature_k=t) for f, t in zip(flights, series, strict=True))
        plain = tuple(c.alone() if c.inferred else c for c in members)
        rival = fit(Joint(found.base.lab, given, plain, found.base.start_sd), found.noise)
        # Where the warmth itself has to be found, that it could have been another is not what a phantom beats it by.
        nats = 0.5 * (rival.cost - true.cost) / by if hidden else true.evidence(by) - rival.evidence(by)
        results.append(Contest(name, float(nats), bool(nats > NEAR)))
    return results


def _phantoms(flights: tuple[FlightData, ...], rng: np.random.Generator) -> dict[str, list[Array]]:
    known = [f.temperature_k for f in flights]
    assert all(t is not None for t in known)
    courses = [t for t in known if t is not None]
    found: dict[str, list[Array]] = {}
    for shift in range(1, min(_SHIFTS, len(flights) - 1) + 1):
        found[f"temperature of other flights ({shift})"] = [
            _stretched(courses[(k + shift) % len(flights)], f.time_s.size) for k, f in enumerate(flights)
        ]
    mean = float(np.mean(np.concatenate(courses)))
    spread = float(np.std(np.concatenate(courses))) + 1e-3
    every = [float(t.mean()) for t in courses]
    found["time in the air"] = _ramps([f.time_s for f in flights], mean, spread)
    found["charge used"] = _ramps([f.charge_c for f in flights], mean, spread)
    found["phases drawn anew"] = [every[int(rng.integers(len(every)))] + _phase(t, rng) for t in courses]
    return found


def _hidden_phantoms(flights: tuple[FlightData, ...]) -> dict[str, list[Array]]:
    last = max(float(f.time_s[-1]) for f in flights)
    most = max(float(f.charge_c[-1]) for f in flights)
    return {
        "time in the air": [REFERENCE_TEMPERATURE_K + _WARMING_K * f.time_s / last for f in flights],
        "charge used": [REFERENCE_TEMPERATURE_K + _WARMING_K * f.charge_c / most for f in flights],
    }


def _ramps(courses: list[Array], mean: float, spread: float) -> list[Array]:
    every = np.concatenate(courses)
    return [mean + spread * (c - every.mean()) / max(float(every.std()), 1e-9) for c in courses]


def _stretched(course: Array, size: int) -> Array:
    return np.interp(np.linspace(0.0, 1.0, size), np.linspace(0.0, 1.0, course.size), course)


def _phase(course: Array, rng: np.random.Generator) -> Array:
    spectrum = np.fft.rfft(course - course.mean())
    turned = np.abs(spectrum) * np.exp(2j * np.pi * rng.random(spectrum.size))
    return np.asarray(np.fft.irfft(turned, course.size))
