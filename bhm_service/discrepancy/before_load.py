"""What flights read at rest, before their load begins, against the charge that a set of effects has them begin with.

A pack that lacks charge reads less before anything is drawn from it. In a fit these samples are few, and what a model
is off by under load is doubted in them as well: a smaller capacity passes for a pack that was not full, though its
flights begin at a full pack's voltage.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.forms import of_start
from bhm_service.discrepancy.joint import Joint
from bhm_service.units import Array, Flags

_IDLE = 0.1  # of the mean load: less than this hardly moves a voltage
_FELT = 3.0  # times what the lab leaves open of a curve


def begins_as_read(at: Fitted[Joint], added: Mapping[str, Array]) -> bool:
    """Whether flights that begin at rest do not deny the charge that some members have them begin without.

    ``added`` is what each member adds to the voltage of all flights by its equation [V]. They deny it where the fit is
    nearer to what they read there without those members than with them, and the lab leaves no curve open by as much.
    By equations alone: what these may be off by could make of them what shows under load only.
    """
    own = [added[name] for name in added if of_start(name)]
    if not own:
        return True
    flights, joint = at.joint.flights, at.joint
    modelled = [joint.predicted(at.x[None, :], k, forms=False).voltage[0] for k in range(len(flights))]
    parts = np.split(np.sum(own, axis=0), np.cumsum([f.time_s.size for f in flights])[:-1])
    off, took = [], []
    for flight, volts, part in zip(flights, modelled, parts, strict=True):
        rests = before_load(flight)
        if rests.any():
            off.append(float(np.mean((flight.voltage_v - volts)[rests])))
            took.append(float(np.mean(part[rests])))
    with_them, without = np.sum(np.square(off)), np.sum(np.square(np.add(off, took)))
    felt = len(took) * (_FELT * joint.lab.series * joint.lab.bend_sd_v) ** 2
    return bool(with_them <= without or np.sum(np.square(took)) <= felt)


def before_load(flight: FlightData) -> Flags:
    """The samples with a voltage that a flight begins with, while next to nothing is drawn."""
    return np.asarray(_until_loaded(flight, np.abs(flight.current_a)) & np.isfinite(flight.voltage_v))


def unloaded_a(flights: Sequence[FlightData]) -> float | None:
    """What the current sensor reads on average before flights' load begins. [A] None where all begin under load."""
    means = []
    for flight in flights:
        # A reading below zero is no charge that moves a voltage: it is what is looked for.
        rests = _until_loaded(flight, flight.current_a)
        if rests.any():
            means.append(float(np.mean(flight.current_a[rests])))
    return float(np.mean(means)) if means else None


def _until_loaded(flight: FlightData, drawn_a: Array) -> Flags:
    """The samples that a flight begins with, while next to nothing of its load is drawn."""
    return np.asarray(np.logical_and.accumulate(drawn_a < _IDLE * np.mean(flight.flown_a)))
