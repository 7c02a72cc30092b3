"""By what a member of a hypothesis may be off: an equation of the catalogue need not be exact (`exactness`).

What a member adds to the voltage may be off by shares of itself: from flight to flight, over the state of charge, in
how it grows with the load, and in how fast it follows it. A second effect has to beat that.
"""

from __future__ import annotations

import numpy as np

from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.effects.resistance_temperature import ResistanceTemperature
from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.discrepancy.abreast import Abreast
from bhm_service.discrepancy.lab import hats
from bhm_service.identification.unknowns import Block, numbers
from bhm_service.units import Array

_FLIGHT_SD, _SOC_SD, _LOAD_SD, _LAG_SD = 0.08, 0.12, 0.3, 0.2
_NO_LAG_SD = 1e-4  # of a skew: to change how fast that follows the load is to take it back
# What a voltage sensor makes of a reading is no matter of a cell's physics: under another load, or after a step of it,
# it is what its equation says. An offset that goes with the load is a resistance, or a load that no sensor sees.
_READ = frozenset({"measured_voltage"})
_READ_SHARE = 0.1  # of what an equation of a cell may be off by
_SOC = np.array([0.15, 0.4, 0.65, 0.95])
# Diffusion slows in the cold, so charge at the surface of particles lags more behind that within, and each step of the
# open-circuit curve comes earlier: no resistance does that, and steps are a twentieth of the charge wide.
_STEPS = np.linspace(0.05, 1.0, 20)
_INFERRED = 0.5  # of what a law may be off by at each of those, where nobody recorded the temperature
_LAG_S = (1.0, 10.0, 60.0)
_REACH = 5.0  # standard deviations
MEAN_SD = 0.02  # of all flights, and of all charges: what is off alike everywhere is the member's own size


def of_start(member: str) -> bool:
    """Whether a member says what charge flights begin with and nothing else: that follows no load."""
    return EFFECTS[member].own_hooks == frozenset({"initial_soc"})


def by_flight(member: str) -> str:
    """The block that holds one number for every flight."""
    return f"form_flight.{member}"


def by_charge(member: str) -> str:
    """The block over the state of charge."""
    return f"form_soc.{member}"


def names_of(member: str) -> list[str]:
    """All blocks of a member, in the order of their `shapes`."""
    return [by_flight(member), by_charge(member), f"form_load.{member}", f"form_lag.{member}"]


def knots(member: str, told: bool) -> Array:
    """The charges at which a member may be off by its own share.

    They are close where the lab ``told`` what its model's form is off by: at its own temperature the steps are right.
    """
    return _STEPS if told and member == ResistanceTemperature.id else _SOC


def blocks(member: str, flights: int, told: bool, inferred: bool) -> list[Block]:
    """Those blocks; ``inferred`` where nobody recorded what drives the member."""
    # So free at charges so close it would say of a temperature that nobody recorded what suits it.
    soc_sd = _SOC_SD * (_INFERRED if told and inferred else 1.0)
    share = _READ_SHARE if EFFECTS[member].own_hooks == _READ else 1.0
    swift = member == TimeSkew.id or of_start(member)
    load_sd, lag_sd = share * _LOAD_SD, _NO_LAG_SD if swift else share * _LAG_SD
    sizes = ((flights, _FLIGHT_SD), (knots(member, told).size, soc_sd), (1, load_sd), (len(_LAG_S), lag_sd))
    named = zip(names_of(member), sizes, strict=True)
    return [numbers(name, np.zeros(size), sd, _REACH * sd) for name, (size, sd) in named]


def shapes(charges: Array, added: Array, group: Abreast, soc: Array) -> Array:
    """By which shapes what a member of such `knots` adds to the voltage (F, T) may be off; (shapes, F, T)."""
    late = [group.lag(tau)(added) - added for tau in _LAG_S]
    return np.stack([added, *(added * hat for hat in hats(charges, soc)), added * group.lightness, *late])


def formed(charges: Array, sizes: Array, added: Array, group: Abreast, soc: Array) -> Array:
    """Those shapes together, each of its size in each flight (M, F, shapes), of what a member adds; (M, F, T)."""
    level, at, light, lags = np.split(sizes, np.cumsum([1, charges.size, 1]), axis=-1)
    by = np.stack([np.interp(own, charges, row[0]) for own, row in zip(soc, at, strict=True)])
    total = added * (level - lags.sum(axis=-1, keepdims=True) + by + light * group.lightness)
    for size, tau in zip(np.moveaxis(lags, -1, 0), _LAG_S, strict=True):
        total += size[..., None] * group.lag(tau)(added)
    return np.asarray(total)
