"""The numbers of what was found, with what they may be off by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.findings import Quantity
from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.physical import physical
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


def teller(fits: Sequence[Fitted], name: str) -> Fitted:
    """Of the fits of one set by several models of the cell, the one whose numbers of a member are told.

    It is that of the model under which the flights are likeliest, among those that give the member the same numbers as
    the first one does (one that has it in its battery file already gives none), and physical ones where any does. The
    model that a search was made with is often not the one that follows the flights better, and what it cannot follow it
    lays on the size of what it found.
    """
    asked = _numbers(fits[0], name)
    able = [f for f in fits if _numbers(f, name) == asked]
    return max(able, key=lambda f: (physical(f, _member(f, name)), _likelihood(f)))


def _likelihood(fitted: Fitted) -> float:
    """Log of how likely a model makes the flights, its noise as large as it leaves, and its own errors. [nats]

    But for what is the same for all models. How far a noise is doubted says nothing of its model.
    """
    pulls = float(np.sum(fitted.joint.pulls(fitted.x) ** 2))
    left = 0.5 * fitted.size * np.log(fitted.misfit) + fitted.joint.log_scale(fitted.noise)
    return float(-left - 0.5 * pulls)


def _numbers(fitted: Fitted, name: str) -> list[str]:
    return [u.name for member in fitted.joint.members if member.id == name for u in member.unknowns]


def parameters(fits: Sequence[Fitted], name: str) -> dict[str, Quantity]:
    """The numbers of one member, those of a flight by its number; in the units of the catalogue.

    ``fits`` are of the same members with several models of the cell. Which of the models is right nobody knows, so a
    number's spread is that of their mixture about what one of them says.
    """
    fitted = teller(fits, name)
    others = [f for f in fits if f is not fitted]
    values = fitted.joint.values(fitted.x[None, :])
    found: dict[str, Quantity] = {}
    for u in _member(fitted, name).unknowns:
        value, sd = values[u.name][0], fitted.sd(u.name)
        if u.log:
            sd = sd * value
        if u.declared.absent is not None:
            sd = np.hypot(sd, _MEANS * (value - u.declared.absent))
        sd = np.hypot(sd, u.level_sd)
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
    having = [f for f in fits if unknown in _numbers(f, name)]
    return [f.joint.values(f.x[None, :])[unknown][0] for f in having]


def _member(fitted: Fitted, name: str) -> Candidate:
    return next(m for m in fitted.joint.members if m.id == name)
