"""How alike flights are in what is each one's own: as far apart as they say, never more than usual.

Where packs came from one room on days of one kind, a course for each flight to choose at will is a great many numbers
for what one would tell: it is never credible, however well it fits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from bhm_service.discrepancy.candidate import SCALE_NATS, Candidate
from bhm_service.discrepancy.fitting import Fitted, weights
from bhm_service.discrepancy.joint import Joint
from bhm_service.units import Array, Flags

_SHARES = tuple(np.geomspace(1.0, 0.1, 6).tolist())  # of what is declared; half a kelvin is as alike as rooms are


@dataclass(frozen=True)
class FlightSpread:
    """A candidate as it was declared, and the fit of it only, which says how far apart flights lie in what it has."""

    declared: Candidate
    alone: Fitted[Joint]

    def told(self, unseen: int | None = None) -> Candidate:
        """The candidate with flights expected as far apart as they say, all of them but one."""
        if self.declared.inferred:
            return self._as_alike(unseen)
        found = self.alone.joint.values(self.alone.x[None, :])
        per_flight = self.alone.joint.per_flight
        seen = [k for k in range(len(self.alone.joint.flights)) if k != unseen]
        return self.declared.as_spread({n: rows[0][seen] if n in per_flight else rows[0] for n, rows in found.items()})

    def _as_alike(self, unseen: int | None) -> Candidate:
        """As far apart as the fit makes likeliest.

        That is by the evidence of a linear problem, the fit's own, its sizes held where they are (what they lean by is
        no part of what the flights say). What the flight ``unseen`` has to say is left out of it.
        """
        if not any(u.of_course for u in self.declared.unknowns):
            return self.declared
        free, joint = self._free, self.alone.joint
        data, pull = self.alone.curvature - joint.known, np.zeros(self.alone.x.size)
        if unseen is not None:
            row, slope = self.alone.rows[unseen], self.alone.slopes[unseen]
            own = np.zeros_like(data)
            slope.add_square(own, weights(row))
            data, pull = data - own, slope.back(weights(row) * row)
        data = data[np.ix_(free, free)]
        score = (data + joint.known[np.ix_(free, free)]) @ joint.unknowns.pulls(self.alone.x)[0][free] + pull[free]

        def likely(choice: tuple[Candidate, Array, float]) -> float:
            tried, known, volume = choice
            factor = cho_factor(data + known, lower=True)
            gone = 2.0 * float(np.sum(np.log(np.diag(factor[0])))) - volume
            return float(0.5 * score @ cho_solve(factor, score) - 0.5 * gone) - tried.price

        return max(self._choices, key=likely)[0]

    @cached_property
    def _free(self) -> Flags:
        """Which numbers of the fit are no size of the candidate."""
        free = np.ones(self.alone.x.size, dtype=bool)
        for u in self.declared.amplitudes():
            free[self.alone.joint.places[u.name]] = False
        return free

    @cached_property
    def _choices(self) -> list[tuple[Candidate, Array, float]]:
        """The candidate with flights at all distances; what is known then of the other numbers, and its volume."""
        courses = [k for k, u in enumerate(self.declared.unknowns) if u.of_course]
        found = []
        for shares in product(_SHARES, repeat=len(courses)):
            closer = dict(zip(courses, shares, strict=True))
            unknowns = tuple(u.closer(closer.get(k, 1.0)) for k, u in enumerate(self.declared.unknowns))
            paid = SCALE_NATS * sum(share < 1.0 for share in shares)
            tried = replace(self.declared, unknowns=unknowns, price=self.declared.price + paid)
            known = _known(self.alone.joint, tried)[np.ix_(self._free, self._free)]
            found.append((tried, known, float(np.linalg.slogdet(known)[1])))
        return found


def _known(joint: Joint, tried: Candidate) -> Array:
    """Curvature of what is known with a candidate as it is tried, by the vector in standard deviations of ``joint``."""
    others = [tried if member.id == tried.id else member for member in joint.members]
    again = replace(joint, members=tuple(others))
    by = joint.scale / again.scale
    return again.known * np.outer(by, by)
