"""An open-circuit curve that the flights bend further than a lab leaves it open: no error of that lab any more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import BEND_SOC, Lab
from bhm_service.discrepancy.odds import NATS
from bhm_service.discrepancy.patterns import VOLTAGE_SD, added

_FAR = 5.0  # standard deviations: curves of some labs are off by twice what is usual, and somewhere by more
_PEAK = 2.0  # times what a model is off by on average: somewhere every model is off by as much
_WIDTH = float(BEND_SOC[1] - BEND_SOC[0])  # of charge: what is narrower no lab's curve tells, what is wider is a bend
_ENDS = (0.1, 0.9)  # of charge: near empty and near full no model of a cell is to be held to millivolts


@dataclass(frozen=True, slots=True)
class BentCurve:
    """Where the curve is furthest from the lab's."""

    soc: float
    cell_v: float  # [V] above the lab's
    narrow: bool = False


def bent_curve(fitted: Fitted, lab: Lab) -> BentCurve | None:
    """The furthest bend of a fit beyond what ``lab``, as it identified the pack, leaves open; None where none is."""
    if not lab.identified:
        return None
    bends = (fitted.x - fitted.joint.unknowns.start)[fitted.joint.places["lab_bends"]]
    at = int(np.argmax(np.abs(bends) / lab.bend_sds_v))
    least_v = max(_FAR * float(lab.bend_sds_v[at]), _PEAK * lab.voltage_error_v)
    return BentCurve(float(BEND_SOC[at]), float(bends[at])) if abs(bends[at]) > least_v else None


def bumped_curve(fitted: Fitted[Joint], lab: Lab) -> BentCurve | None:
    """A bump narrower than a lab's errors are wide, on top of a fit; None where the flights do not say so.

    Where the lab told what its curve is off by, flights that bend it further have to do so over tenths of charge. What
    rises and falls within less is none of its errors. Evidence is over all places that it might have.
    """
    if not lab.form_told:
        return None
    soc = np.concatenate([modelled.soc for modelled in fitted.joint.all_predicted(fitted.x[None, :])])
    usual = VOLTAGE_SD * lab.series
    tried = [
        (*added(fitted, usual * np.exp(-0.5 * ((soc - at) / _WIDTH) ** 2)[None, :]), float(at))
        for at in np.arange(_ENDS[0], _ENDS[1] + 0.25 * _WIDTH, 0.5 * _WIDTH)
    ]
    nats = np.array([found[2] for found in tried])
    if float(logsumexp(nats)) - np.log(nats.size) < NATS:
        return None
    sizes, _, _, at = tried[int(np.argmax(nats))]
    cell_v = VOLTAGE_SD * float(sizes[0])
    return BentCurve(at, cell_v, narrow=True) if abs(cell_v) > _PEAK * lab.voltage_error_v else None
