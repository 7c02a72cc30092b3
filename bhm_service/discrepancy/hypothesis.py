"""What a hypothesis over flights looks for, as one vector, and what is known of that before any of them was flown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from bhm_service.discrepancy import forms as form
from bhm_service.discrepancy.candidate import Candidate, alike, alike_sd
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.lab import Lab
from bhm_service.identification.unknowns import Block, Unknowns, joined, numbers
from bhm_service.units import Array, Flags, Places

# Of the state of charge at the start: charged full, by a gauge, and of a pack that nobody identified.
FULL_SD, GAUGE_SD, GENERIC_SD = 0.01, 0.02, 0.08
# Of a full charge, from one flight to the next: charger and pack are the same, and so is what they are off by. What the
# MaxAmps cell gave in one discharge after another differs by 0.03-0.11 %, what NASA's cells gave by 0.24-0.68 %, with
# what a cell regains in rests between.
_REPEATS_SD = 0.003
STARTS = "start_soc"
PACKS = "pack_resistance"
_PACKS_SD, _PACKS_REACH = 0.1, 0.5  # of the logarithm: packs that nobody identified, from flight to flight


@dataclass(frozen=True)
class Hypothesis:
    """The lab's errors, each flight's start and the members' unknowns in one vector."""

    lab: Lab
    flights: tuple[FlightData, ...]
    members: tuple[Candidate, ...] = ()
    start_sd: tuple[float, ...] = field(default=())  # per flight; by what is known of its start where not given
    lean: Mapping[str, float] = field(default_factory=dict)  # half the cost of one more of a number, by its block

    @cached_property
    def unknowns(self) -> Unknowns:
        """Everything that is looked for."""
        mean = np.array([1.0 if f.reading is None else f.reading for f in self.flights])
        sd = np.array(self.start_sd or [self._start_sd(f) for f in self.flights])
        sd[self._alike] = alike_sd(self._alike.size, FULL_SD, _REPEATS_SD)
        starts = Block(
            name=STARTS, start=mean, low=np.full(mean.size, 0.02), high=np.full(mean.size, 1.06), prior=mean, sd=sd
        )
        packs = [] if self.lab.identified else [numbers(PACKS, np.zeros(len(self.flights)), _PACKS_SD, _PACKS_REACH)]
        members = [b for c in self.members for b in c.blocks(len(self.flights))]
        told = self.lab.form_told
        forms = [b for c in self.members for b in form.blocks(c.id, len(self.flights), told, bool(c.inferred))]
        return joined(self.lab.blocks(), [starts], packs, members, self.lab.additions(), forms)

    @cached_property
    def lab_adding(self) -> slice:
        """Errors of the lab that only add to the voltage: their derivatives need no run."""
        names = [b.name for b in self.lab.additions()]
        return slice(self.places[names[0]].start, self.places[names[-1]].stop)

    def _start_sd(self, flight: FlightData) -> float:
        if not self.lab.identified:
            return GENERIC_SD
        return FULL_SD if flight.reading is None else GAUGE_SD

    @cached_property
    def _alike(self) -> Places:
        """The flights that began with a full charge of which no more is known."""
        if self.start_sd or not self.lab.identified:
            return np.zeros(0, dtype=np.intp)
        return np.flatnonzero([f.reading is None for f in self.flights])

    def _tied(self, where: Places, apart: float) -> Array:
        """That some numbers of the vector are alike but for ``apart``; (numbers, n)."""
        rows = np.zeros((where.size, self.scale.size))
        if where.size > 1:
            rows[:, where] = alike(where.size, float(self.scale[where[0]]), apart)
        return rows

    def _alike_ties(self) -> list[Array]:
        """That full charges are alike, and what differs little between flights."""
        found = [self._tied(self.places[STARTS].start + self._alike, _REPEATS_SD)]
        for u in (u for member in self.members for u in member.unknowns):
            if u.apart is not None:
                where = self.places[u.name]
                found.append(self._tied(np.arange(where.start, where.stop), u.apart))
        return found

    @cached_property
    def per_flight(self) -> frozenset[str]:
        """Blocks that hold one number for every flight."""
        own = {u.name for c in self.members for u in c.unknowns if u.per_flight}
        return frozenset({STARTS, PACKS} | own | {form.by_flight(c.id) for c in self.members})

    @cached_property
    def columns(self) -> Places:
        """For each flight, the numbers of the vector that a run of it depends on; (flights, numbers)."""
        return self.places_by_flight(
            [name for name, where in self.places.items() if where.start < self.lab_adding.start]
        )

    @cached_property
    def additions(self) -> Places:
        """For each flight, the numbers of the vector that only add to its voltage, in the order of their shapes."""
        return self.places_by_flight(
            [name for name, where in self.places.items() if where.start >= self.lab_adding.start]
        )

    @cached_property
    def forms(self) -> list[Places]:
        """For each member, the numbers by which it may be off."""
        names = [form.names_of(c.id) for c in self.members]
        return [np.concatenate([np.arange(self.places[n].start, self.places[n].stop) for n in own]) for own in names]

    @cached_property
    def forms_by_flight(self) -> list[Places]:
        """The same flight by flight; (flights, numbers)."""
        return [self.places_by_flight(form.names_of(c.id)) for c in self.members]

    @cached_property
    def form_knots(self) -> list[Array]:
        """For each member, the charges at which it may be off by its own share."""
        return [form.knots(c.id, self.lab.form_told) for c in self.members]

    def places_by_flight(self, names: list[str]) -> Places:
        """Where some blocks stand, flight by flight: of those that hold a number for each only its own."""
        count = len(self.flights)
        found = [np.zeros((count, 0), dtype=np.intp)]
        for name in names:
            where = np.arange(self.places[name].start, self.places[name].stop)
            found.append(where[:, None] if name in self.per_flight else np.tile(where, (count, 1)))
        return np.concatenate(found, axis=1)

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where each block stands in the vector; of two of one name (a companion that two members have), the first."""
        found: dict[str, slice] = {}
        begin = 0
        for block in self.unknowns.blocks:
            found.setdefault(block.name, slice(begin, begin + block.size))
            begin += block.size
        return found

    def beyond(self, other: Hypothesis | None) -> tuple[Candidate, ...]:
        """Its members that another hypothesis lacks."""
        there = set() if other is None else {member.id for member in other.members}
        return tuple(member for member in self.members if member.id not in there)

    @cached_property
    def scale(self) -> Array:
        """Standard deviation of what was known before, of every number."""
        return np.concatenate([b.sd for b in self.unknowns.blocks])

    def values(self, x: Array) -> dict[str, Array]:
        """Blocks of vectors (M, n) by name, each (M, size), in their own units."""
        return {b.name: b.outer(x[:, self.places[b.name]]) for b in self.unknowns.blocks}

    def leaning(self, x: Array) -> tuple[float, Array]:
        """Half of what the vector costs by its leans, and the slopes of that in standard deviations; (n,)."""
        by = np.zeros(self.scale.size)
        for name, slope in self.lean.items():
            by[self.places[name]] = slope
        return float(by @ x), by * self.scale

    def pulls(self, x: Array) -> Array:
        """How far a vector is from what was known before, of its numbers and of their sums."""
        return np.asarray(self._before @ self.unknowns.pulls(x)[0])

    def pulled(self, name: str, x: Array) -> Array:
        """The same of one block of the lab's errors, for itself."""
        return self.lab.pulls(name, self.unknowns.pulls(x)[0][self.places[name]])

    @cached_property
    def of_lab(self) -> Flags:
        """Which numbers of the vector are errors of the lab."""
        return np.concatenate([np.full(b.size, b.name.startswith("lab_")) for b in self.unknowns.blocks])

    @cached_property
    def _before(self) -> Array:
        """What was known before: of the lab, of full charges, and that a form changes no member's size; (rows, n)."""
        rows = [self.lab.known(self.unknowns), *self._alike_ties()]
        for member in self.members:
            for name in (form.by_flight(member.id), form.by_charge(member.id)):
                row = np.zeros((1, self.scale.size))
                sds = self.scale[self.places[name]]
                row[0, self.places[name]] = sds / (form.MEAN_SD * sds.size)
                rows.append(row)
        return np.concatenate(rows)

    @cached_property
    def known(self) -> Array:
        """Curvature of what was known before, by the vector in its standard deviations."""
        return np.asarray(self._before.T @ self._before)
