"""The other cell model as a witness: what one model of a cell cannot follow, the other one often can.

An effect that only mends the structure of one model earns nothing with the other; physics that the pack has earns with
both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.first_order import saturated_noise
from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.odds import Names
from bhm_service.discrepancy.search import Search
from bhm_service.discrepancy.valleys import fit_over_valleys


@dataclass(slots=True)
class Witness:
    """The same flights with the other cell model; ``start_sd`` as in the search that it checks.

    Of what its model has in the battery file already, of the lab's making, the flights are not asked again. Its fits
    begin as well from those of ``near``, a search with the same model, or with the sizes that ``other``, one with the
    other model, found.
    """

    lab: Lab
    candidates: Sequence[Candidate]
    base: Joint
    near: Search | None = None
    other: Search | None = None
    _bare: Fitted | None = field(default=None)
    _searches: dict[Names, Search] = field(default_factory=dict)

    def earned(self, names: Names) -> dict[str, float]:
        """Evidence that each member of a set adds to the others, by this model; of what it is asked for. [nats]"""
        asked = self._asked(names)
        return self._search(asked).earned(asked) if asked else {}

    def turned_round(self, found: Search, names: Names) -> Names:
        """The members of a set that do by this model the opposite of what they do by another search's."""
        asked = self._asked(names)
        if not asked:
            return asked
        own, other = self._search(asked).added_by(asked), found.added_by(names)
        return frozenset(name for name in asked if float(np.vdot(own[name], other[name])) < 0.0)

    def fitted(self, names: Names) -> Fitted:
        """The set with this model, with the sizes that its members have by it."""
        asked = self._asked(names)
        return self._search(asked).fitted(asked)

    def _asked(self, names: Names) -> Names:
        return names & {c.id for c in self.candidates}

    def _search(self, names: Names) -> Search:
        if names in self._searches:
            return self._searches[names]
        members = tuple(c for c in self.candidates if c.id in names)
        if self._bare is None:
            self._bare = fit(self.base, Noise.at_first(self.lab.series))
        rough = saturated_noise(self._bare, members)
        joint = replace(self.base, members=members)
        starts = [joint.unknowns.start, *([] if self.near is None else [self.near.fitted(names).x])]
        if self.other is not None:
            numbers = (u.name for member in members for u in member.unknowns)
            starts.append(self.other.fitted(names).into(joint, numbers))
        first = min((fit_over_valleys(joint, rough, start) for start in starts), key=lambda found: found.cost)
        noise = saturated_noise(first, ())
        lab = self.lab.widened(lambda name: first.joint.pulled(name, first.x))
        found = Search(replace(self.base, lab=lab), members, noise)
        found.fitted(names, first)
        self._searches[names] = found
        return found


def witness(
    lab: Lab,
    flights: Joint,
    candidates: Sequence[Candidate],
    near: Search | None = None,
    other: Search | None = None,
) -> Witness:
    """A witness on the flights of a search."""
    return Witness(lab, candidates, Joint(lab, flights.flights, (), flights.start_sd), near, other)
