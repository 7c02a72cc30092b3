"""One way in which physics may be missing: effects of the catalogue, with their unknowns over a set of flights."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bhm_service.battery.battery_file import ModelName
from bhm_service.battery.effects import EFFECTS, Effect
from bhm_service.battery.parameters import Parameter
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.noise import MOST_DOUBT, WITNESSES
from bhm_service.identification.unknowns import Block, numbers
from bhm_service.units import Array, Places

_STEPS = "intermittent-contact"
_ONE_OF_MANY = "weak-cell"
# What a battery file of another pack leaves open, by what it is that these would change.
_STARTS = ("partial-charge", "self-discharge")
_SCALES = {
    "capacity-fade": "capacity",
    "resistance-growth": "resistance",
    "contact-resistance": "resistance",
    "current-gain": "capacity and resistance",
    "voltage-gain": "open-circuit curve",
    "voltage-offset": "open-circuit curve",
    "ocv-shape": "open-circuit curve",
    "resistance-shape": "resistance",
}
# A pack that is cold has more resistance before anything else: what else a temperature that nobody recorded would do is
# not told from a temperature that is made to fit.
_SHOWS = {"temperature": "resistance-temperature"}
_FINEST = 0.25  # times what is declared: how alike flights may be expected to be in what differs between them
_OPEN = 10.0  # times what is declared: nothing that flights show is pulled by what was expected any more
_FEW = MOST_DOUBT / WITNESSES  # flights: from so many on they are not doubted the more for being alike
SCALE_NATS = 1.0  # that a scale costs which the flights themselves gave


def alike_sd(count: int, sd: float, apart: float) -> float:
    """Of each of some numbers that are alike but for ``apart``, if nothing tied them, so that their mean is known so.

    `alike` ties them; ``sd`` is that of each of them as they are.
    """
    return float(np.sqrt(count * (sd**2 - apart**2) + apart**2))


def alike(count: int, sd: float, apart: float) -> Array:
    """What ties numbers of `alike_sd` ``sd`` to each other: times them, in that, standard normals; (count, count)."""
    return np.asarray(np.sqrt((sd / apart) ** 2 - 1.0) * (np.eye(count) - 1.0 / count))


@dataclass(frozen=True, slots=True)
class Unknown:
    """One declared number over the flights: how it stands in the fit's vector."""

    effect: str
    declared: Parameter
    prior: tuple[float, float]  # in the declared unit
    log: bool
    per_flight: bool
    apart: float | None = None  # how far flights may lie from each other in it, where that is less than the prior
    level_sd: float = 0.0  # of all flights together, where these do not tell it; in the declared unit

    @property
    def name(self) -> str:
        """Of its block."""
        return f"{self.effect}.{self.declared.name}"

    @property
    def of_course(self) -> bool:
        """Whether it is where a flight's driver begins, or what that is drawn to."""
        return self.per_flight and self.declared.absent is None

    @property
    def usual(self) -> float:
        """Of what makes an effect vanish, the size that is usual where it is there; in the declared unit."""
        mean, sd = self.prior
        return mean if mean != self.declared.absent else mean + sd

    def closer(self, share: float) -> Unknown:
        """The same with flights expected to lie apart by a ``share`` of what is declared."""
        if self.apart is not None:
            return replace(self, apart=share * self.apart)
        mean, sd = self.prior
        return replace(self, prior=(mean, share * sd))

    def doubted(self, share: float) -> Unknown:
        """The same, what all flights share known before to a ``share`` of what is declared, their mean as usual."""
        mean, sd = self.prior
        if self.apart is not None:
            return replace(self, prior=(mean, self.apart), apart=None, level_sd=sd)
        return self if self.per_flight else replace(self, prior=(mean, share * sd))

    def block(self, flights: int) -> Block:
        """Its block of unknowns."""
        size = flights if self.per_flight else 1
        mean, sd = self.prior
        low, high = self.declared.low, self.declared.high
        if self.apart is not None:
            sd = alike_sd(size, sd, self.apart)
        if not self.log:
            found = numbers(self.name, np.full(size, mean), sd, 1.0)
            return Block(
                name=self.name, start=found.start, low=np.full(size, low), high=np.full(size, high),
                prior=found.prior, sd=found.sd,
            )  # fmt: skip
        inner = np.log([mean, max(low, 1e-12), high])
        return Block(
            name=self.name,
            start=np.full(size, inner[0]),
            low=np.full(size, inner[1]),
            high=np.full(size, inner[2]),
            prior=np.full(size, inner[0]),
            sd=np.full(size, np.log1p(sd / mean)),
            log=True,
        )


@dataclass(frozen=True, slots=True)
class Candidate:
    """A named piece of missing physics; ``parts`` may hold a companion that carries a driver no log has."""

    id: str
    parts: tuple[tuple[str, type[Effect]], ...]  # by the name that their unknowns go under
    unknowns: tuple[Unknown, ...]
    fixed: Mapping[str, Sequence[float]] = field(default_factory=dict)  # numbers that the flights themselves give
    inferred: tuple[str, ...] = ()  # drivers that are carried as hidden states
    price: float = 0.0  # [nats] of having been looked for in many places
    credit: float = 0.0  # [nats] that it has from what is measured beside the pack's voltage

    @property
    def driven_by_temperature(self) -> bool:
        """Whether it does more, or less, where the pack is warm."""
        return any("temperature" in kind.drivers for _, kind in self.parts)

    def blocks(self, flights: int) -> list[Block]:
        """The unknowns that it adds."""
        return [u.block(flights) for u in self.unknowns]

    def as_spread(self, found: Mapping[str, Array]) -> Candidate:
        """The same with sizes that differ from flight to flight expected as far apart as a fit ``found`` them.

        Never farther than declared. With the widest of priors for each of many flights, small sizes could be seen in
        every flight and still not pay for it.
        """

        def scaled(u: Unknown) -> Unknown:
            if not u.per_flight or u.declared.absent is None:
                return u
            mean, sd = u.prior
            apart = float(np.sqrt(np.mean((found[u.name] - u.declared.absent) ** 2)))
            return replace(u, prior=(mean, float(np.clip(apart, _FINEST * sd, sd))))

        unknowns = tuple(scaled(u) for u in self.unknowns)
        return self if unknowns == self.unknowns else replace(self, unknowns=unknowns, price=self.price + SCALE_NATS)

    def unexpected(self) -> Candidate:
        """The same with hardly anything known of its size beforehand.

        As it is where it has several sizes, or is driven by what nobody recorded: the flights do not tell these apart.
        """
        sizes = self.amplitudes()
        if len(sizes) != 1 or sizes[0].per_flight or self.inferred:
            return self
        (size,) = sizes
        mean, sd = size.prior
        open_ = replace(size, prior=(mean, _OPEN * sd))
        return replace(self, unknowns=tuple(open_ if u is size else u for u in self.unknowns))

    def on(self, flights: Sequence[int]) -> Candidate:
        """The same for some of the flights."""
        return replace(self, fixed={key: [told[k] for k in flights] for key, told in self.fixed.items()})

    def doubted(self, flights: int) -> Candidate:
        """The same for flights of a pack that nobody identified, where its driver is not recorded.

        How warm all flights were and how much resistance the pack has is one number to them. How fast it warms and how
        much its resistance minds trade against what a cell that is only like this one gets wrong, and that is the same
        in all flights: many of them tell no more of it than a few.
        """
        if not self.inferred:
            return self
        share = min(1.0, float(np.sqrt(_FEW / flights)))
        return replace(self, unknowns=tuple(u.doubted(share) for u in self.unknowns))

    def alone(self) -> Candidate:
        """The same without the companion that carries its driver."""
        own = tuple(u for u in self.unknowns if u.effect == self.id)
        return replace(self, parts=self.parts[:1], unknowns=own, inferred=())

    def shown_beside(self, names: frozenset[str]) -> bool:
        """Whether it changes anything beside these members."""
        by = EFFECTS[self.id].shown_by
        return bool(self.inferred) or not by or not names.isdisjoint(by)

    def amplitudes(self) -> list[Unknown]:
        """The unknowns that make it vanish; none of them is kept as a logarithm, which would never come to nothing."""
        return [u for u in self.unknowns if u.declared.absent is not None]

    def effects(self, values: Mapping[str, Array], flights: int | Places) -> list[Effect]:
        """Its effects in one flight or in F of them, numbers (M, F, 1); ``values`` are blocks (M, size)."""
        given: dict[str, dict[str, object]] = {key: {} for key, _ in self.parts}
        at = np.atleast_1d(flights)
        for u in self.unknowns:
            own = values[u.name][:, at] if u.per_flight else values[u.name]
            given[u.effect][u.declared.name] = own[:, :, None] * u.declared.scale
        for key, per_flight in self.fixed.items():
            effect, name = key.rsplit(".", 1)
            given[effect][name] = np.asarray(per_flight, dtype=float)[at][:, None]
        return [kind(**given[key]) for key, kind in self.parts]


@dataclass(frozen=True, slots=True)
class NotExcited:
    """An effect that these recordings cannot show, and why."""

    id: str
    because: str


def candidates(
    flights: Sequence[FlightData],
    model: ModelName,
    pack_wh: float,
    identified: bool = True,
    joined: Collection[str] = (),
    capacity_c: float = 0.0,
    series: int | None = None,
) -> tuple[list[Candidate], list[NotExcited]]:
    """What of the catalogue can be tried on these flights, and what cannot; ``joined`` is in the battery already.

    Without ``capacity_c`` [C] flights are taken to be as deep as any effect needs, without ``series`` the pack to have
    several cells.
    """
    known = known_drivers(flights)
    deepest = min(1.0 - float(f.charge_c[-1]) / capacity_c for f in flights) if capacity_c else 0.0
    found: list[Candidate] = []
    missing: list[NotExcited] = []
    for kind in EFFECTS.values():
        if kind.id == _STEPS:
            continue  # its times are found first
        if kind.id in joined and not kind.repeats:
            missing.append(NotExcited(kind.id, "is in the battery file already"))
            continue
        if kind.id in _STARTS and not identified:
            missing.append(NotExcited(kind.id, "the battery file is not of this pack, so its start is open anyway"))
            continue
        if kind.id in _SCALES and not identified and not _differs(kind, flights, known):
            open_ = _SCALES[kind.id]
            missing.append(NotExcited(kind.id, f"the battery file is not of this pack, so its {open_} is open anyway"))
            continue
        if kind.id == _ONE_OF_MANY and series == 1:
            missing.append(NotExcited(kind.id, "a single cell has no weaker one beside it"))
            continue
        if deepest > kind.shown_below:
            missing.append(NotExcited(kind.id, f"no flight goes below {kind.shown_below:.0%} of charge"))
            continue
        needed = [d for d in kind.drivers if d not in known]
        carriers = [e for e in EFFECTS.values() if set(needed) & set(e.supplies)]
        if needed and not carriers:
            missing.append(NotExcited(kind.id, f"needs {' and '.join(needed)}, which is not recorded"))
            continue
        first = {_SHOWS.get(d, kind.id) for d in needed}
        if first and kind.id not in first:
            told = (
                f"needs a recorded {' and '.join(needed)}: one that is not shows by {' and '.join(sorted(first))} first"
            )
            missing.append(NotExcited(kind.id, told))
            continue
        if kind.supplies and set(kind.supplies) <= known:
            missing.append(NotExcited(kind.id, f"{' and '.join(kind.supplies)} is recorded"))
            continue
        if kind.shown_by and not needed and not identified:
            # What stands beside an inexact equation would mend what another pack's battery file gets wrong.
            missing.append(NotExcited(kind.id, "the battery file is not of this pack: too fine to be told"))
            continue
        own = _candidate(kind, tuple(carriers), tuple(needed), flights, known, model, pack_wh, joined)
        found.append(own if identified else own.doubted(len(flights)))
    return found, missing


def known_drivers(flights: Sequence[FlightData]) -> set[str]:
    """What drives effects and is known of every flight."""
    known = set()
    if all(f.temperature_k is not None for f in flights):
        known.add("temperature")
    if all(f.notes.storage_days is not None for f in flights):
        known.add("storage")
    if all(f.notes.cycles is not None for f in flights):
        known.add("age")
    return known


def _differs(kind: type[Effect], flights: Sequence[FlightData], known: set[str]) -> bool:
    """Whether what drives an effect is recorded and is not the same on all flights."""
    told = [driven(flights, p.driver) for p in kind.parameters() if p.driver in known and p.driver is not None]
    return any(len(set(values)) > 1 for values in told)


def _candidate(
    kind: type[Effect],
    carriers: tuple[type[Effect], ...],
    inferred: tuple[str, ...],
    flights: Sequence[FlightData],
    known: set[str],
    model: ModelName,
    pack_wh: float,
    joined: Collection[str],
) -> Candidate:
    unknowns: list[Unknown] = []
    fixed: dict[str, Sequence[float]] = {}
    for part in (kind, *carriers):
        priors = part.priors(pack_wh)
        for p in part.parameters():
            if p.model not in (None, model) or (p.beside is not None and p.beside not in known) or p.unless in joined:
                continue
            if p.driver is not None:
                if p.driver in known:
                    fixed[f"{part.id}.{p.name}"] = [p.si(v) for v in driven(flights, p.driver)]
                continue
            if p.name not in priors:
                continue
            mean, sd = priors[p.name]
            log = p.absent is None and p.low > 0.0 and not p.per_flight
            unknowns.append(Unknown(part.id, p, (mean, sd), log, p.per_flight, p.apart if p.per_flight else None))
    parts = tuple((part.id, part) for part in (kind, *carriers))
    return Candidate(kind.id, parts, tuple(unknowns), fixed, inferred)


def driven(flights: Sequence[FlightData], driver: str) -> list[float]:
    """What the notes say of each flight: days in storage, or age as a share of the oldest flight's."""
    if driver == "storage":
        return [f.notes.storage_days or 0.0 for f in flights]
    cycles = [f.notes.cycles or 0.0 for f in flights]
    return [c / (max(cycles) or 1.0) for c in cycles]
