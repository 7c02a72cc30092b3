"""Does an explanation hold on flights that no fit saw? Each flight is left out in turn.

What all flights share comes from the others; the flight's own start, what differs from flight to flight, and the size
of what shows in no other (the one worn pack among new ones), from its first quarter; the rest of it is predicted.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from bhm_service.battery.effects.contact import IntermittentContact
from bhm_service.discrepancy.candidate import Candidate, Unknown
from bhm_service.discrepancy.cores import on_cores
from bhm_service.discrepancy.fitting import Fitted, fit, moved
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.forms import of_start
from bhm_service.discrepancy.hypothesis import STARTS
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.odds import BRIEF, NATS, Names
from bhm_service.discrepancy.search import Search
from bhm_service.units import Array

_SEEN = 0.25  # of a flight's samples
_UNTOLD = 0.7  # of what was known before: flights that leave a size no better known do not tell it
_FEWEST = 3  # flights
# Times the error of the battery as it is, on unseen flights: what an explanation has to reach, as what is identified.
_IMPROVED = 0.95
# The same of what lasts for seconds or begins when nobody can know, and of what is measured beside the pack's voltage.
_NO_WORSE = 1.005
_FAINT = 3.0  # times what a member has to earn
_BETTER = 0.1  # of the error on unseen flights: a member whose removal brings this is no explanation


@dataclass(frozen=True, slots=True)
class LeftOutFlight:
    """One flight predicted from the others: modelled voltages along it, and which samples were not seen."""

    label: str
    before_v: Array  # by the battery as it is
    tuned_v: Array  # by the same within what the lab leaves open
    after_v: Array  # with the effects
    measured_v: Array
    begin: int  # first sample that was not seen

    def rmse(self, modelled: Array) -> float:
        """Over the samples that were not seen. [V]"""
        off = (self.measured_v - modelled)[self.begin :]
        return float(np.sqrt(np.nanmean(off**2)))


@dataclass(frozen=True, slots=True)
class HeldOut:
    """All flights, each predicted from the others."""

    flights: tuple[LeftOutFlight, ...]
    from_assumed: bool = False  # whether the battery as it is began them with the charge that is assumed

    @property
    def before_v(self) -> float:
        """Pooled error of the model without the effects. [V]"""
        return _pooled([(f.rmse(f.before_v), f.before_v.size - f.begin) for f in self.flights])

    @property
    def tuned_v(self) -> float:
        """Pooled error of that model within what the lab leaves open. [V]"""
        return _pooled([(f.rmse(f.tuned_v), f.tuned_v.size - f.begin) for f in self.flights])

    @property
    def after_v(self) -> float:
        """Pooled error with them. [V]"""
        return _pooled([(f.rmse(f.after_v), f.after_v.size - f.begin) for f in self.flights])


def _pooled(parts: list[tuple[float, int]]) -> float:
    total = sum(n for _, n in parts)
    return float(np.sqrt(sum(n * e**2 for e, n in parts) / total))


@dataclass(slots=True)
class Unseen:
    """Voltages of flights that no fit saw, from the others; each made once of a fit."""

    found: Search
    _sets: dict[Names, list[Array]] = field(default_factory=dict)
    _of: dict[Names, Fitted] = field(default_factory=dict, init=False)  # a look may have found a better one since
    _bare: dict[bool, list[Array]] = field(default_factory=dict, init=False)

    def by(self, names: Names) -> list[Array]:
        """With a set of effects. [V]"""
        fitted = self.found.fitted(names)  # before they part: all of them need it
        if names not in self._sets or self._of.get(names, fitted) is not fitted:
            self._of[names] = fitted
            tasks = [partial(_predicted, self.found, names, k) for k in range(len(self.found.base.flights))]
            self._sets[names] = on_cores(tasks, self.found.cores)
        return self._sets[names]

    def from_assumed(self, names: Names) -> bool:
        """Whether it is the charge assumed that the battery as it is begins with where a set is looked at.

        With another it has effects on nothing but that charge. Of a pack that no lab has seen none is assumed.
        """
        return bool(names) and self.found.base.lab.identified and all(map(of_start, names))

    def as_it_is(self, names: Names) -> list[Array]:
        """By the battery as it is, as far as it has nothing of a set of effects. [V]

        From the charge that a flight's first quarter shows, or that is assumed (`from_assumed`).
        """
        base, noise = self.found.base, self.found.noise
        assumed = self.from_assumed(names)
        if assumed not in self._bare:
            held = frozenset({STARTS} if assumed else ())
            tasks = [partial(predicted_from_quarter, base, None, k, noise, held) for k in range(len(base.flights))]
            self._bare[assumed] = on_cores(tasks, self.found.cores)
        return self._bare[assumed]


def harmful(unseen: Unseen, names: Names) -> bool:
    """Whether the set predicts unseen flights no better than the battery as it is, or worse than without a member.

    At the charges that other flights show: what a lab is off by beyond them nothing has learnt, effect or none.
    """
    found = unseen.found
    if not names or len(found.base.flights) < _FEWEST:
        return False
    measured_v = _at_charges_of_others(found, names)

    def flights(modelled: list[Array]) -> tuple[LeftOutFlight, ...]:
        ways = zip(found.base.flights, modelled, measured_v, strict=True)
        return tuple(LeftOutFlight(f.label, v, v, v, known, _unseen_from(f)) for f, v, known in ways)

    own, bare = flights(unseen.by(names)), flights(unseen.as_it_is(names))
    whole = HeldOut(own).after_v
    brief = names <= BRIEF
    little = brief or found.measured(names)
    worse = whole > (_NO_WORSE if little else _IMPROVED) * HeldOut(bare).after_v
    if worse and not (brief and _no_worse_as_a_rule(own, bare)):
        return True
    earned = found.earned(names)
    # Without a member that the flights ask for loudly, the lab's errors are bent far out to take its place.
    faint = [m for m in names if earned[m] < _FAINT * NATS]
    return len(names) > 1 and any(
        HeldOut(flights(unseen.by(names - {m}))).after_v < (1.0 - _BETTER) * whole for m in faint
    )


def _at_charges_of_others(found: Search, names: Names) -> list[Array]:
    """The measured voltages of each flight where another one comes to that charge as well, else NaN. [V]

    All of them of a flight that others share no charge with after its first quarter. The charges are of the fit to
    all flights: they say what is compared, and have no part in what is predicted.
    """
    at = found.fitted(names)
    courses = [flight.soc for flight in at.joint.all_predicted(at.x[None, :])]
    lowest, highest = np.array([(soc.min(), soc.max()) for soc in courses]).T
    kept = []
    for k, (data, soc) in enumerate(zip(found.base.flights, courses, strict=True)):
        low, high = np.delete(lowest, k).min(), np.delete(highest, k).max()
        shared = np.where((soc >= low) & (soc <= high), data.voltage_v, np.nan)
        kept.append(shared if np.isfinite(shared[_unseen_from(data) :]).any() else data.voltage_v)
    return kept


def _no_worse_as_a_rule(by_them: Sequence[LeftOutFlight], as_it_is: Sequence[LeftOutFlight]) -> bool:
    """Whether flights are predicted as well on the whole, be it that a few are not.

    A flight in which what is brief happens is predicted by nothing, and outweighs all others.
    """
    ratios = [own.rmse(own.after_v) / bare.rmse(bare.after_v) for own, bare in zip(by_them, as_it_is, strict=True)]
    return float(np.exp(np.mean(np.log(ratios)))) <= _NO_WORSE


def held_out(unseen: Unseen, names: Names) -> HeldOut | None:
    """Predict every flight from the others, without and with a set of effects; None with fewer than three flights."""
    found = unseen.found
    if len(found.base.flights) < _FEWEST:
        return None
    ways = zip(unseen.as_it_is(names), unseen.by(frozenset()), unseen.by(names), strict=True)
    return HeldOut(
        tuple(
            LeftOutFlight(f.label, *modelled, f.voltage_v, _unseen_from(f))
            for f, modelled in zip(found.base.flights, ways, strict=True)
        ),
        unseen.from_assumed(names),
    )


def _unseen_from(data: FlightData) -> int:
    """First sample of a flight that is not seen before it is predicted.

    A pack that spends a quarter of the recording on the ground has shown little but its charge: then it is a quarter of
    what follows the take-off.
    """
    size = data.time_s.size
    takeoff = int(np.argmax(data.airborne)) if data.airborne.any() else 0
    quarter = int(np.ceil(_SEEN * size))
    return quarter if takeoff < quarter else takeoff + int(np.ceil(_SEEN * (size - takeoff)))


def _predicted(found: Search, names: Names, left: int) -> Array:
    whole = found.fitted(names)
    others = [k for k in range(len(found.base.flights)) if k != left]
    joint = replace(whole.joint, members=tuple(_without(found, m, left) for m in whole.joint.members))
    rest = subset(joint, others)
    learnt = fit(rest, found.noise, restricted(whole, rest, others), rounds=8)
    return predicted_from_quarter(joint, learnt, left, found.noise)


def _without(found: Search, member: Candidate, left: int) -> Candidate:
    """A member with flights expected as far apart as the others say."""
    return found.spreads[member.id].told(left) if member.id in found.spreads else member


def subset(joint: Joint, flights: list[int]) -> Joint:
    """A hypothesis over some of its flights; what sizes lean by is of all of them, and left behind."""
    return Joint(
        joint.lab,
        tuple(joint.flights[k] for k in flights),
        tuple(c.on(flights) for c in joint.members),
        tuple(joint.start_sd[k] for k in flights) if joint.start_sd else (),
    )


def restricted(whole: Fitted, part: Joint, flights: list[int]) -> Array:
    """A fit's vector, for some of its flights."""
    x = part.unknowns.start.copy()
    per_flight = whole.joint.per_flight
    for block in whole.joint.unknowns.blocks:
        values = whole.x[whole.joint.unknowns.slice_of(block.name)]
        x[part.unknowns.slice_of(block.name)] = values[flights] if block.name in per_flight else values
    return x


def predicted_from_quarter(
    joint: Joint, learnt: Fitted | None, index: int, noise: Noise, held: Set[str] = frozenset()
) -> Array:
    """Voltages of a whole flight, with its own numbers from its first quarter and all others as learnt. [V]

    Where nothing was learnt the battery is taken as it is. ``held`` names blocks that stay where they were expected.
    """
    data = joint.flights[index]
    quarter = data.part(slice(0, _unseen_from(data)))
    seen = subset(replace(joint, flights=_put(joint.flights, index, _alone(quarter))), [index])
    shared = [] if learnt is None else [name for name in learnt.joint.places if name not in joint.per_flight]
    x = seen.unknowns.start if learnt is None else learnt.into(seen, shared)
    moving = [*(seen.per_flight - held), *([] if learnt is None else _untold(learnt))]
    own = moved(seen, noise, x, moving, rounds=6)
    full = subset(replace(joint, flights=_put(joint.flights, index, _alone(data))), [index])
    foreseen = own.copy()
    for u in _not_begun(full.members, float(quarter.time_s[-1])):
        foreseen[full.unknowns.slice_of(u.name)] = u.declared.absent
    return np.asarray(full.predicted(foreseen[None, :], 0).voltage[0])


def _not_begun(members: Sequence[Candidate], until_s: float) -> list[Unknown]:
    """The sizes of what begins later in the one flight: that it will is known from having seen it only."""
    late = {
        key
        for member in members
        for key, kind in member.parts
        if kind is IntermittentContact and member.fixed[f"{key}.begin"][0] > until_s
    }
    return [u for member in members for u in member.amplitudes() if u.effect in late]


def _untold(learnt: Fitted) -> list[str]:
    """The members' sizes, the same in all flights, that these leave where they were expected and no better known."""
    sd = np.sqrt(np.diag(learnt.covariance)) / learnt.joint.scale
    pulled = np.abs(learnt.joint.unknowns.pulls(learnt.x)[0])
    open_ = (sd > _UNTOLD) & (pulled < 1.0)
    shared = [u.name for member in learnt.joint.members for u in member.amplitudes() if not u.per_flight]
    return [name for name in shared if np.all(open_[learnt.joint.places[name]])]


def _put(flights: tuple[FlightData, ...], index: int, data: FlightData) -> tuple[FlightData, ...]:
    return (*flights[:index], data, *flights[index + 1 :])


def _alone(data: FlightData) -> FlightData:
    """Without the voltage rested after landing: it is not known before."""
    return replace(data, notes=replace(data.notes, rest_voltage_v=None))
