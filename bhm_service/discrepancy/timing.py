"""A time skew on the logs' own samples: over averaged ones it is told neither surely nor by how much."""

from __future__ import annotations

from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.discrepancy.crossing import Witness
from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.flights import usual_step_s
from bhm_service.discrepancy.odds import NATS, Names
from bhm_service.discrepancy.valleys import SKEW


def timed(closer: Witness, names: Names) -> bool:
    """Whether no skew is in a set that the logs' own samples do not show; half of one is a matter of any filter."""
    if TimeSkew.id not in names:
        return True
    at = closer.fitted(names)
    size = abs(float(at.x[at.joint.places[SKEW]][0]))
    return size > 0.5 * usual_step_s(at.joint.flights) and closer.earned(names)[TimeSkew.id] >= NATS


def by_samples(fitted: Fitted, closer: Witness, names: Names) -> Fitted:
    """A set's fit with the skew held at what the logs' own samples say, where it has one."""
    if TimeSkew.id not in names:
        return fitted
    at = closer.fitted(names)
    start = fitted.x.copy()
    start[fitted.joint.places[SKEW]] = at.x[at.joint.places[SKEW]]
    others = [block.name for block in fitted.joint.unknowns.blocks if block.name != SKEW]
    return fit(fitted.joint, fitted.noise, start, moving=others)
