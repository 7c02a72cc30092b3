"""An open-circuit curve that the flights bend further than a lab leaves it open: no error of that lab any more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.lab import BEND_SOC, Lab

_FAR = 5.0  # standard deviations: curves of some labs are off by twice what is usual, and somewhere by more
_PEAK = 2.0  # times what a model is off by on average: somewhere every model is off by as much


@dataclass(frozen=True, slots=True)
class BentCurve:
    """Where the curve is furthest from the lab's."""

    soc: float
    cell_v: float  # [V] above the lab's


def bent_curve(fitted: Fitted, lab: Lab) -> BentCurve | None:
    """The furthest bend of a fit beyond what ``lab``, as it identified the pack, leaves open; None where none is."""
    if not lab.identified:
        return None
    bends = (fitted.x - fitted.joint.unknowns.start)[fitted.joint.places["lab_bends"]]
    at = int(np.argmax(np.abs(bends) / lab.bend_sds_v))
    least_v = max(_FAR * float(lab.bend_sds_v[at]), _PEAK * lab.voltage_error_v)
    return BentCurve(float(BEND_SOC[at]), float(bends[at])) if abs(bends[at]) > least_v else None
