"""Flights of packs whose resistance goes with a temperature that no log has."""

import numpy as np
from discrepancy.flown import flown

from bhm_service.battery.effects import EFFECTS

ENERGY = 22.0  # [kJ/mol]
COOLS = 1.5  # [W/K]
_SEED = 2


def days(count):
    """How warm each day was, as far apart as the catalogue expects. [K]"""
    return np.random.default_rng(_SEED).normal(293.0, 6.0, count)


def warmed(ambients, beside=()):
    """A flight on each day, its pack as warm as the day when it begins; ``beside`` holds one more effect for each."""
    found = []
    for number, ambient in enumerate(ambients):
        heat = EFFECTS["self-heating"](heat_capacity=400.0, conductance=COOLS, ambient=ambient, start_above=0.0)
        physics = [
            EFFECTS["resistance-temperature"](activation_energy=1e3 * ENERGY),
            heat,
            *beside[number : number + 1],
        ]
        found.append(flown(physics, seed=_SEED, number=number, samples=200))
    return tuple(found)
