"""Where the fit of a set of effects may begin: from a smaller set's, or from what was known before."""

from __future__ import annotations

import numpy as np

from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.valleys import SKEW, across
from bhm_service.units import Array

_BENT = 3.0  # standard deviations
_COLD_SDS = 2.0  # of what is known of the air before: colder hardly any flights are


def seeks(joint: Joint) -> bool:
    """Whether it has a driver that nobody recorded, or a skew: these have searches for their valleys of their own."""
    return SKEW in joint.places or any(member.inferred for member in joint.members)


def starts_of(joint: Joint, start: Fitted | None, hidden: bool) -> list[Array]:
    """Where the fit of a set may begin: from another set's, what joins that at its usual size or not there yet.

    Or, beside other effects, with the numbers that suit these best.

    A fit without a driver that nobody recorded has put what that does where it does not belong, into the lab's errors
    and the flights' starts: where it is ``hidden``, from what was known before as well.
    """
    if start is None:
        return [carried(joint, None)]
    joining = joint.beyond(start.joint)
    fresh = [carried(joint, None)] if hidden else []
    beside = [across(joint, start)] if start.joint.members and joining and not hidden else []
    return [carried(joint, start), *(absent(joint, start, member) for member in joining), *fresh, *beside]


def hides(joint: Joint, start: Fitted | None) -> bool:
    """Whether what joins a fit has a driver that nobody recorded.

    Such an effect has no slope at no effect: which way the driver has to go shows only once the effect is there, and a
    fit from none of it may stay there.
    """
    return any(member.inferred for member in joint.beyond(None if start is None else start.joint))


def vanished(at: Fitted) -> bool:
    """Whether a member of a fit has come to nothing."""
    values = at.joint.values(at.x[None, :])
    return any(
        all(np.all(values[u.name] == u.declared.absent) for u in member.amplitudes()) for member in at.joint.members
    )


def carried(joint: Joint, start: Fitted | None) -> Array:
    """A start for a set: what another set's fit found, where both have it."""
    if start is None:
        return joint.unknowns.start.copy()
    # A fit that lacked what this one has may have bent the lab's errors far to make up for it: a poor start.
    bent = bends_the_lab(start)
    return start.into(joint, (name for name in start.joint.places if not (bent and name.startswith("lab_"))))


def bends_the_lab(at: Fitted) -> bool:
    """Whether a fit lays on any error of the lab far more than the lab leaves open."""
    return bool(np.any(np.abs(at.joint.unknowns.pulls(at.x)[0][at.joint.of_lab]) > _BENT))


def colder(joint: Joint) -> Array:
    """A start from what was known before, but all flights as cold as they may well have been.

    Where a cold pack is fitted from a warm one, other numbers are first to take what the cold does, and keep it.
    """
    x = joint.unknowns.start.copy()
    air = [u.name for member in joint.members for u in member.unknowns if u.of_course and u.apart is not None]
    for where in map(joint.places.__getitem__, air):
        x[where] = np.maximum(x[where] - _COLD_SDS * joint.scale[where], joint.unknowns.low[where])
    return x


def absent(joint: Joint, start: Fitted, candidate: Candidate) -> Array:
    """The smaller set's fit with the candidate added at no effect."""
    x = carried(joint, start)
    for u in candidate.amplitudes():
        x[joint.unknowns.slice_of(u.name)] = u.declared.absent
    return x
