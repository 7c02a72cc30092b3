"""Whether a fit's numbers are inside of what is physical: one at the end of its range stands for something else."""

from __future__ import annotations

import numpy as np

from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.joint import Joint
from bhm_service.identification.unseen import KNOWN
from bhm_service.units import Array

_REACH = 0.995  # of the way to a bound
_ABSENT = 0.01  # of that way: so near to no effect is none


def inside(x: Array, low: Array, high: Array, absent: float) -> bool:
    """Whether no number stands at an end of its range, but where its effect vanishes (``absent``)."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return not np.any((np.abs(x - middle) > _REACH * half) & (np.abs(x - absent) > _ABSENT * half))


def physical(fitted: Fitted[Joint], member: Candidate) -> bool:
    """Whether all numbers of a member that make it vanish are inside of their ranges."""
    unknowns = fitted.joint.unknowns
    for u in member.amplitudes():
        where = unknowns.slice_of(u.name)
        assert u.declared.absent is not None
        if not inside(fitted.x[where], unknowns.low[where], unknowns.high[where], u.declared.absent):
            return False
    return True


def as_known(fitted: Fitted[Joint], member: Candidate) -> bool:
    """Whether all numbers of a member that make it vanish are of about the size that was known of them before."""
    unknowns = fitted.joint.unknowns
    told = [(fitted.x[unknowns.slice_of(u.name)], u.declared.prior) for u in member.amplitudes()]
    return not any(np.any(np.abs(x - prior[0]) > KNOWN * prior[1]) for x, prior in told if prior is not None)
