"""Which sets of effects the flights support: a beam over sets, each refitted in full, compared by evidence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from bhm_service.battery.effects import EFFECTS, OcvShape, TimeSkew
from bhm_service.discrepancy.alikeness import FlightSpread
from bhm_service.discrepancy.bent_curve import bent_curve
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.cores import on_cores
from bhm_service.discrepancy.first_order import expected_snr, linear_gain, saturated_noise
from bhm_service.discrepancy.fitting import Bare, Fitted, cost_of, fit, moved
from bhm_service.discrepancy.forms import of_start
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.marginal import likelier, likeliest
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.odds import BRIEF, LAWS, LEAST_SNR, NATS, NEAR, OF_DROP, STRONG, Names, needed
from bhm_service.discrepancy.onset import begun, later
from bhm_service.discrepancy.physical import as_known
from bhm_service.discrepancy.starts import bends_the_lab, carried, colder, hides, seeks, starts_of, vanished
from bhm_service.discrepancy.steps import contact_candidate, episodes
from bhm_service.discrepancy.valleys import across, by_equation, fit_over_valleys, less_charged
from bhm_service.units import Array

_TRIED_SNR = 1.0  # below, they could not even show one of several times that
_WIDTH, _DEPTH, _EXPANSIONS = 3, 3, 4
_PAIR = 2  # effects: what joins two and earns its place is among the first of what looks best

Progress = Callable[[str], None]


@dataclass(slots=True)
class Search:
    """Fits of sets of candidates on the same flights and noise, each made once, and again where a look finds better."""

    base: Joint
    candidates: tuple[Candidate, ...]
    noise: Noise
    snr: dict[str, float] = field(default_factory=dict)  # expected of each candidate at its usual size
    fits: dict[Names, Fitted] = field(default_factory=dict)
    spreads: Mapping[str, FlightSpread] = field(default_factory=dict)  # of candidates that the flights told of
    cores: int = 1  # that it may use
    bent: bool = False  # whether flights bend the open-circuit curve further than any lab is off by
    _joints: dict[Names, Joint] = field(default_factory=dict, init=False)
    _added: dict[Names, Array] = field(default_factory=dict, init=False)
    _alone: dict[Names, Array] = field(default_factory=dict, init=False)
    _seen: set[tuple[Names, Names]] = field(default_factory=set, init=False)

    def fitted(self, names: Names, start: Fitted | None = None) -> Fitted:
        """The fit of a set, begun from a smaller set's where one is given."""
        if names not in self.fits:
            self.fits[names] = self._found(names, start, self._least)
        return self.fits[names]

    def fit_all(self, starts: Mapping[Names, Fitted]) -> None:
        """Fit sets that do not wait for each other, the likeliest first: what is far from that is fitted loosely."""
        new = [names for names in starts if names not in self.fits]
        if new:
            self.fitted(new[0], starts[new[0]])
        others, aim = new[1:], self._least
        tasks = [partial(self._bare, own, starts[own], aim) for own in others]
        for own, bare in zip(others, on_cores(tasks, self.cores), strict=True):
            self.fits[own] = bare.on(self.joint(own), self.noise)

    def look_by_equation(self, sets: Iterable[Names]) -> None:
        """Fit sets from where their equations alone come nearest to the flights as well."""
        self._look({own: partial(by_equation, self.joint(own), self.noise) for own in sets})

    def look_across(self, best: Names, sets: Iterable[Names]) -> None:
        """Fit sets from the valley of another one as well, once."""
        new = [own for own in sets if (best, own) not in self._seen]
        self._seen.update((best, own) for own in new)
        self._look({own: partial(across, self.joint(own), self.fits[best]) for own in new})

    def _look(self, begins: Mapping[Names, Callable[[], Array]]) -> None:
        """Fit sets from other starts, but for those that `seeks` is true of, and keep of each the likelier fit."""
        joints = {own: self.joint(own) for own in begins if not seeks(self.joint(own))}
        tasks = [partial(_begun_at, joint, self.noise, begins[own], self._least) for own, joint in joints.items()]
        for own, bare in zip(joints, on_cores(tasks, self.cores), strict=True):
            self.fits[own] = likelier([self.fits[own], bare.on(joints[own], self.noise)])
            self._added.pop(own, None)
            self._alone.pop(own, None)

    def _bare(self, names: Names, start: Fitted, aim: float | None) -> Bare:
        return self._found(names, start, aim).bare

    @property
    def _least(self) -> float | None:
        return min((f.cost for f in self.fits.values()), default=None)

    def _found(self, names: Names, start: Fitted | None, aim: float | None) -> Fitted:
        joint = self.joint(names)
        if start is not None:
            joint = replace(joint, lean={n: own for n, own in start.joint.lean.items() if n in joint.places})
        # What numbers lean by is of the noise and of what is known before: another search's is only a start.
        again = start is not None and start.noise is not self.noise
        # So is the valley that it took for a driver that nobody recorded.
        hidden = hides(joint, None if again else start)
        starts = starts_of(joint, start, hidden)
        if again and hidden:
            starts.append(colder(joint))
        if not hidden:
            starts.sort(key=lambda x: cost_of(joint, x, self.noise))
        ends = []
        for begin in starts:
            ends.append(fit_over_valleys(joint, self.noise, begin, aim=aim))
            # Where the start was bent the other way an effect of one sign ends at none, though it is there.
            if not hidden and not vanished(ends[-1]):
                break
        if not names:
            # From here all others grow: in another valley than theirs it would give each of them what lies between.
            ends.append(fit(joint, self.noise, less_charged(joint, ends[-1].x), aim=aim))
        end = likelier(ends)
        return likeliest(end) if hidden or again else end

    def joint(self, names: Names) -> Joint:
        """The hypothesis of a set."""
        if names not in self._joints:
            members = tuple(c for c in self.candidates if c.id in names)
            self._joints[names] = Joint(self.base.lab, self.base.flights, members, self.base.start_sd)
        return self._joints[names]

    def added(self, names: Names) -> Array:
        """What each member of a set adds to the pack's voltage over all flights [V]; (members, samples)."""
        if names not in self._added:
            at = self.fitted(names)
            self._added[names] = by_members(at.joint, at.x)
        return self._added[names]

    def added_by(self, names: Names) -> dict[str, Array]:
        """The same by the members' names."""
        members = self.fitted(names).joint.members
        return {member.id: own for member, own in zip(members, self.added(names), strict=True)}

    def alone(self, names: Names) -> Array:
        """What each adds where the members have to explain the flights by themselves, the lab taken at its word."""
        if names not in self._alone:
            at = self.fitted(names)
            own = {u.name: member.id for member in at.joint.members for u in member.unknowns}
            x = at.into(at.joint, list(own))
            # What is slow here, and nothing's to explain but the lab's, would give what is brief any size.
            moving = [name for name, of in own.items() if of not in BRIEF]
            joint = replace(at.joint, lean={})
            self._alone[names] = by_members(joint, moved(joint, self.noise, x, moving))
        return self._alone[names]

    def gains(self, names: Names) -> dict[str, float]:
        """What each other candidate that shows is expected to add to a set's evidence, by one linear step. [nats]"""
        at = self.fitted(names)
        others = [c for c in self.candidates if c.id not in names and c.shown_beside(names)]
        # What all of them need is made before they part.
        _ = at.known_curvature, at.weighted
        tasks = [partial(linear_gain, at, self.joint(names | {c.id}), c) for c in others]
        return {c.id: nats + c.credit for c, nats in zip(others, on_cores(tasks, self.cores), strict=True)}

    def needed(self, name: str, names: Names = frozenset()) -> float:
        """What a member of a set has to earn on these flights. [nats]

        That a curve bent further than any lab's is of another shape needs no longer odds than any other effect. Beside
        an effect of temperature a lab has told nothing of the drop's structure: it was told where that does nothing.
        """
        if self.bent and names == {OcvShape.id}:
            return NATS
        law = name in self.laws and (not names or name in self.lawful(names))
        alone = name in names and all(map(of_start, names - {name}))
        warmth = any("temperature" in EFFECTS[other].drivers for other in names - {name})
        told = self.base.lab.form_told and not (warmth and name in OF_DROP)
        return STRONG if law else needed(name, told, alone=alone)

    def credit(self, names: Names) -> float:
        """Of a set's evidence, what it has from what is measured beside the pack's voltage. [nats]"""
        return sum(c.credit for c in self.candidates if c.id in names)

    def measured(self, names: Names) -> bool:
        """Whether every member of a set may be heard by what is measured beside the pack's voltage alone."""
        return all(self.credit(frozenset({name})) > self.heard(name, names) for name in names)

    def heard(self, name: str, names: Names) -> float:
        """What a member of a set has to have at least by its own equation, and with another cell model. [nats]"""
        return min(NEAR, self.needed(name, names))

    @property
    def laws(self) -> Names:
        """The laws among the candidates that would show at their known size in flights that tell what drives them.

        What would not show at the size that no cell is without, and does show, is not known beforehand.
        """
        laws = (c.id for c in self.candidates if c.id in LAWS and not c.inferred)
        return frozenset(name for name in laws if self.snr.get(name, LEAST_SNR) >= LEAST_SNR)

    def lawful(self, names: Names) -> Names:
        """The laws of a set that its fit has by about their known size: by another one something else goes with it."""
        laws = names & self.laws
        return frozenset(c.id for c in self.joint(names).members if c.id in laws and as_known(self.fitted(names), c))

    @property
    def inflation(self) -> float:
        """Of the noise's variance, so that the best fit is as good as the noise says."""
        return max(1.0, min(f.misfit for f in self.fits.values()))

    def evidence(self, names: Names) -> float:
        """Of a set, against none. [nats]"""
        by = self.inflation
        price = sum(c.price for c in self.candidates if c.id in names)
        return self.fitted(names).evidence(by) - self.fitted(frozenset()).evidence(by) + self.credit(names) - price

    def ranked(self) -> list[Names]:
        """All sets, the best first."""
        return sorted(self.fits, key=lambda names: -self.evidence(names))

    def earned(self, names: Names) -> dict[str, float]:
        """Evidence that each member adds to the others. [nats]"""
        whole = self.fitted(names)
        self.fit_all({names - {m}: whole for m in sorted(names)})
        return {m: self.evidence(names) - self.evidence(names - {m}) for m in names}


def _begun_at(joint: Joint, noise: Noise, begin: Callable[[], Array], aim: float | None) -> Bare:
    return fit(joint, noise, begin(), aim=aim).bare


def by_members(joint: Joint, x: Array) -> Array:
    """What each member adds; what shows only beside another is its own, and not a part of that one as well."""
    parts = np.concatenate([p.members for p in joint.all_predicted(x[None, :])], axis=1)
    names = [member.id for member in joint.members]
    for own, member in zip(parts, joint.members, strict=True):
        beside = [k for k, name in enumerate(names) if member.shown_beside(frozenset({name}))]
        if beside and not member.shown_beside(frozenset()):
            parts[beside[0]] -= own
    return parts


def search(base: Joint, candidates: Sequence[Candidate], progress: Progress = lambda _: None, cores: int = 1) -> Search:
    """All sets worth comparing, fitted; the noise is taken again once the largest effects are known."""
    start = fit(base, Noise.at_first(base.lab.series))
    noise = saturated_noise(start, candidates)
    progress("one effect at a time")
    found = Search(base, tuple(candidates), noise, cores=cores)
    at = found.fitted(frozenset(), start)
    alone = [c for c in candidates if c.shown_beside(frozenset())]
    found.snr = {c.id: expected_snr(at, found.joint(frozenset({c.id})), c) for c in alone}
    found.candidates = tuple(c for c in alone if found.snr[c.id] > _TRIED_SNR or c.inferred or c.credit)
    _grow(found, depth=1, progress=progress)
    _join_shown(found, [c for c in candidates if c not in alone])
    best = found.fits[_largest(found)]
    steps = episodes(best)
    contacts = [contact_candidate(steps, len(base.flights))] if steps else []
    largest = frozenset(member.id for member in best.joint.members)
    begun_ = [_begun(found, c, largest) for c in found.candidates]
    spreads = {c.id: FlightSpread(c, own) for c in begun_ if (own := found.fits.get(frozenset({c.id}))) is not None}
    everything = (*(spreads[c.id].told() if c.id in spreads else c for c in begun_), *contacts)
    noise = saturated_noise(best, everything)
    progress("sets of effects")
    # An effect that is part of the answer is in the fit already; what is still pulled is the model's own error.
    wider = replace(base, lab=base.lab.widened(lambda name: best.joint.pulled(name, best.x)))
    again = Search(wider, everything, noise, found.snr, spreads=spreads, cores=cores)
    again.fitted(frozenset(), found.fits[frozenset()])
    # Sets grow one by one again: with their members' onsets and spreads known, others may be the best.
    best_alone = [names for names in found.ranked() if len(names) == 1][: 2 * _WIDTH]
    again.fit_all({names: found.fits[names] for names in best_alone})
    _grow(again, depth=_DEPTH, progress=progress)
    again.bent = bent_curve(again.fitted(frozenset()), base.lab) is not None
    return again


def _join_shown(found: Search, candidates: Sequence[Candidate]) -> None:
    """Let what shows only beside others join the search where the best effect shows it."""
    best = found.ranked()[0]
    for c in candidates:
        if c.shown_beside(best):
            found.candidates += (c,)
            found.snr[c.id] = expected_snr(found.fits[best], found.joint(best | {c.id}), c)


def _largest(found: Search) -> Names:
    """The best effect, and beside it what looks best for as long as that earns its place.

    What belongs to the answer and is left out here is taken for the lab's errors, and hardly seen again.
    """
    names = found.ranked()[0]
    while 0 < len(names) < _DEPTH:
        gains = found.gains(names)
        other = max(gains, key=lambda name: gains[name], default=None)
        if other is None or gains[other] < NATS:
            break
        wider = names | {other}
        found.fitted(wider, found.fitted(names))
        if found.evidence(wider) - found.evidence(names) < found.needed(other):
            break
        names = wider
    return names


def _begun(found: Search, candidate: Candidate, largest: Names) -> Candidate:
    """The candidate from its likeliest flight on, beside the largest effect or in the place of its mimics there.

    A driver that nobody recorded may be what it likes in every flight: beside it no mimic shows where it began, nor can
    one stand beside it. And what grows, or is only there, may have been taken for what began.
    """
    flights = len(found.base.flights)
    tried = later(candidate, flights)
    if not tried:
        return candidate
    mimics = frozenset(EFFECTS[candidate.id].mimics)
    hidden = frozenset(c.id for c in found.candidates if c.inferred) & mimics
    others = largest - {candidate.id} - hidden
    places = [found.fitted(names) for names in dict.fromkeys((others, others - mimics))]

    def beside(at: Fitted, tried: Candidate) -> Joint:
        return replace(at.joint, members=(*at.joint.members, tried))

    def by_one_step(tried: Candidate) -> float:
        return max(linear_gain(at, beside(at, tried), tried) for at in places)

    def by_fit(tried: Candidate) -> float:
        # Without what is looked for, a fit may have bent the others and the lab's errors far: one step tells little.
        nats = []
        for at in places:
            joint = beside(at, tried)
            there = fit(joint, at.noise, carried(joint, at))
            nats.append(there.evidence(found.inflation) - NATS * len(at.joint.members))
        return max(nats)

    if max(map(by_one_step, (candidate, *tried))) < NATS:
        return candidate
    return begun(candidate, flights, by_fit, NATS)


def _look_round(found: Search) -> None:
    """Look for other valleys of what has one effect, and of none, where there is anything to explain.

    Large effects that are fitted from none of them need not arrive: bends of the lab take their place on the way, and
    hold it.
    """
    alone = [names for names in found.fits if len(names) == 1]
    bare: Names = frozenset()
    followed = found.fits[bare].misfit <= 1.0 and not bends_the_lab(found.fits[bare])
    if not alone or (followed and all(found.evidence(n) < found.needed(name, n) for n in alone for name in n)):
        return
    found.look_by_equation(alone)
    found.look_across(max(alone, key=found.evidence), [bare])


def _beyond_the_lab(at: Fitted, others: Iterable[str]) -> list[str]:
    """A skew, where as much is made of the lab's own as there may be: of larger ones no step from there tells."""
    pinned = not at.free[at.joint.places["lab_skew"]].all()
    return [TimeSkew.id] if pinned and TimeSkew.id in others else []


def _grow(found: Search, depth: int, progress: Progress) -> None:
    beam: list[Names] = [frozenset()]
    for size in range(depth):
        tried: dict[Names, Fitted] = {}
        for place, names in enumerate(beam):
            gains = found.gains(names)
            order = sorted(gains, key=lambda name: -gains[name])
            # What is likely to be part of the answer is tried with all that may join it, the rest with what looks best.
            likely = [name for name in order if size == 0 or gains[name] > 0.0]
            tries = likely if place == 0 and size < _PAIR else likely[:_EXPANSIONS]
            for name in (*tries, *_beyond_the_lab(found.fitted(names), gains)):
                tried.setdefault(names | {name}, found.fitted(names))
        found.fit_all(tried)
        if size == 0:
            _look_round(found)
        progress(f"sets of {size + 1}")
        beam = sorted(tried, key=lambda names: -found.evidence(names))[:_WIDTH]
        # One more of them has to earn its place as well: what this one hardly did, no other does beside it.
        fewer = max(found.evidence(names) for names in found.fits if len(names) <= size)
        if not beam or found.evidence(beam[0]) < max(NATS, fewer + NATS - NEAR):
            break
