"""The numbers of what was found, with what they may be off by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.findings import Quantity
from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.units import Array

_MEANS = 0.08  # of an effect's size: no equation of a whole pack means its number more closely
_ROUNDS = 150  # of the one fit that is reported, to its very end


def measured(fitted: Fitted) -> Fitted:
    """A set's fit with nothing expected of its members' sizes: they are there, and the flights say how large.

    What is expected of a size is what a search needs. Of what was found it would make every large one too small.
    """
    members = tuple(member.unexpected() for member in fitted.joint.members)
    if not members:
        return fitted
    return fit(replace(fitted.joint, members=members), fitted.noise, fitted.x, rounds=_ROUNDS, aim=np.inf)


def parameters(fitted: Fitted, name: str, others: Sequence[Fitted] = ()) -> dict[str, Quantity]:
    """The numbers of one member, those of a flight by its number; in the units of the catalogue.

    ``others`` are fits of the same members with other models of the cell. Which of the models is right nobody knows, so
    a number's spread is that of their mixture about what the first one says.
    """
    values = fitted.joint.values(fitted.x[None, :])
    found: dict[str, Quantity] = {}
    for u in _member(fitted, name).unknowns:
        value, sd = values[u.name][0], fitted.sd(u.name)
        if u.log:
            sd = sd * value
        if u.declared.absent is not None:
            sd = np.hypot(sd, _MEANS * (value - u.declared.absent))
        apart = [other - value for other in _of(others, name, u.name)]
        sd = np.sqrt(sd**2 + sum((step**2 for step in apart), np.zeros(1)) / (1 + len(apart)))
        own = u.declared.name if u.effect == name else f"{u.effect}.{u.declared.name}"
        for k, number in enumerate(value):
            key = f"{own}[{fitted.joint.flights[k].label}]" if u.per_flight else own
            found[key] = Quantity(value=float(number), sd=float(sd[k]), unit=u.declared.unit)
    return found


def _of(fits: Sequence[Fitted], name: str, unknown: str) -> list[Array]:
    """What fits say of an unknown, where they have it; nothing of a skew, which is told by the logs' own samples."""
    if name == TimeSkew.id:
        return []
    having = [f for f in fits if any(u.name == unknown for u in _member(f, name).unknowns)]
    return [f.joint.values(f.x[None, :])[unknown][0] for f in having]


def _member(fitted: Fitted, name: str) -> Candidate:
    return next(m for m in fitted.joint.members if m.id == name)
