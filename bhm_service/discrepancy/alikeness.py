"""How alike flights are in what is each one's own: as far apart as they say, never more than usual.

Where packs came from one room on days of one kind, a course for each flight to choose at will is a great many numbers
for what one would tell: it is never credible, however well it fits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from bhm_service.discrepancy.candidate import SCALE_NATS, Candidate
from bhm_service.discrepancy.fitting import Fitted, weights
from bhm_service.discrepancy.joint import Joint
from bhm_service.units import Array

_SHARES = tuple(np.geomspace(1.0, 0.1, 6).tolist())  # of what is declared; half a kelvin is as alike as rooms are


@dataclass(frozen=True, slots=True)
class FlightSpread:
    """A candidate as it was declared, and the fit of it only, which says how far apart flights lie in what it has."""

    declared: Candidate
    alone: Fitted[Joint]

    def told(self, unseen: int | None = None) -> Candidate:
        """The candidate with flights expected as far apart as they say, all of them but one."""
        if self.declared.inferred:
            return as_alike(self.declared, self.alone, unseen)
        found = self.alone.joint.values(self.alone.x[None, :])
        per_flight = self.alone.joint.per_flight
        seen = [k for k in range(len(self.alone.joint.flights)) if k != unseen]
        return self.declared.as_spread({n: rows[0][seen] if n in per_flight else rows[0] for n, rows in found.items()})


def as_alike(candidate: Candidate, alone: Fitted[Joint], unseen: int | None = None) -> Candidate:
    """The candidate with flights expected as far apart as their fit makes likeliest; ``alone``: the fit of it only.

    That is by the evidence of a linear problem, the fit's own, its sizes held where they are (what they lean by is no
    part of what the flights say). What the flight ``unseen`` has to say is left out of it.
    """
    courses = [k for k, u in enumerate(candidate.unknowns) if u.of_course]
    if not courses:
        return candidate
    free = np.ones(alone.x.size, dtype=bool)
    for u in candidate.amplitudes():
        free[alone.joint.places[u.name]] = False
    at = alone.joint.unknowns.pulls(alone.x)[0][free]
    curvature, pull = alone.curvature - alone.joint.known, np.zeros(alone.x.size)
    if unseen is not None:
        row, slope = alone.rows[unseen], alone.slopes[unseen]
        own = np.zeros_like(curvature)
        slope.add_square(own, weights(row))
        curvature, pull = curvature - own, slope.back(weights(row) * row)
    data = curvature[np.ix_(free, free)]
    score = data @ at + alone.joint.known[np.ix_(free, free)] @ at + pull[free]

    def likely(tried: Candidate) -> float:
        known = _known(alone.joint, tried)[np.ix_(free, free)]
        posterior = data + known
        volume = np.linalg.slogdet(posterior)[1] - np.linalg.slogdet(known)[1]
        return float(0.5 * score @ np.linalg.solve(posterior, score) - 0.5 * volume) - tried.price

    tried = []
    for shares in product(_SHARES, repeat=len(courses)):
        closer = dict(zip(courses, shares, strict=True))
        unknowns = tuple(u.closer(closer.get(k, 1.0)) for k, u in enumerate(candidate.unknowns))
        paid = SCALE_NATS * sum(share < 1.0 for share in shares)
        tried.append(replace(candidate, unknowns=unknowns, price=candidate.price + paid))
    return max(tried, key=likely)


def _known(joint: Joint, tried: Candidate) -> Array:
    """Curvature of what is known with a candidate as it is tried, by the vector in standard deviations of ``joint``."""
    others = [tried if member.id == tried.id else member for member in joint.members]
    again = replace(joint, members=tuple(others))
    by = joint.scale / again.scale
    return again.known * np.outer(by, by)
