"""Which demand effects the flights' power supports: sets of them, each refitted, compared by evidence."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from bhm_service.discrepancy.demand_model import FLIGHT_SDS, Demand, Term
from bhm_service.discrepancy.demand_release import releases
from bhm_service.discrepancy.first_order import Geometry, geometry_of
from bhm_service.discrepancy.fitting import Fitted, bulk, fit
from bhm_service.discrepancy.noise import Noise, doubt_of_alike, estimated
from bhm_service.discrepancy.odds import LEAST_SNR, NATS, NEAR, STRONG, Names
from bhm_service.discrepancy.physical import inside
from bhm_service.discrepancy.significance import exceeded
from bhm_service.prediction.demand_effects import DEMAND_EFFECTS
from bhm_service.units import Array

_START = Noise(0.7, 0.2, 0.03)
FLOOR = 0.002  # of the hover's power: none is measured better than this
_WIDTH, _DEPTH = 2, 4
LEAST = 0.005  # of the hover's power, RMS: what adds less changes nothing that anybody flies by
_LEAST_SHARE = 0.2  # of what the largest member adds
_SIGNIFICANT = 0.02  # over the whole catalogue
_SEEN = 0.25  # of a held-out flight's samples
_FEWEST = 3  # flights, for one to be held out
_NO_WORSE = 1.005  # times the error without the effects, on unseen flights
# What no multirotor is without: the file lacks a law, not a thing that may have happened to the vehicle. That it holds
# needs no long odds, only strong evidence that these flights show it.
LAWS = frozenset({"air-density", "wind-tilt", "translational-lift", "climb-power"})
SOME = "some"  # flights carry the payload, the others none
PAYLOAD, WEAR = "payload-mass", "propulsion-efficiency"
_ORDER = {name: place for place, name in enumerate(DEMAND_EFFECTS)}

Fit = Fitted[Demand]


@dataclass(slots=True)
class DemandSearch:
    """Fits of sets of terms on the same flights and noise, each made once."""

    base: Demand
    terms: tuple[Term, ...]
    noise: Noise
    snr: dict[str, float] = field(default_factory=dict)  # expected of each term at its usual size
    fits: dict[Names, Fit] = field(default_factory=dict)

    def fitted(self, names: Names) -> Fit:
        """The fit of a set."""
        if names not in self.fits:
            self.fits[names] = fit(self.demand(names), self.noise)
        return self.fits[names]

    def demand(self, names: Names) -> Demand:
        """The hypothesis of a set."""
        return self.base.with_terms([t for t in self.terms if t.key in names])

    def ids(self, names: Names) -> Names:
        """The effects of a set, in whichever form."""
        return frozenset(name.partition(":")[0] for name in names)

    def evidence(self, names: Names) -> float:
        """Of a set, against none. [nats]"""
        by = max(1.0, min(f.misfit for f in self.fits.values()))
        price = sum(t.price for t in self.terms if t.key in names)
        return evidence(self.fitted(names), by) - evidence(self.fitted(frozenset()), by) - price

    def earned(self, names: Names) -> dict[str, float]:
        """Evidence that each member adds to the others. [nats]"""
        for m in names:
            self.fitted(names - {m})
        return {m: self.evidence(names) - self.evidence(names - {m}) for m in names}

    def needed(self, name: str) -> float:
        """What a member of a set has to earn; what was let go in flight has earned its place by its steps. [nats]"""
        let_go = any(t.key == name and t.change_points for t in self.terms)
        # Propellers wear on every vehicle. What looks like it is a day that grows warmer, unless the air is known;
        # hovers that only scatter, by whatever it be, earn as much in fewer than one of a hundred sets of flights.
        wear = name == WEAR and all(f.air_told for f in self.base.flights)
        return STRONG if name in LAWS or let_go or wear else NATS

    def ranked(self) -> list[Names]:
        """All sets that were fitted, the best first."""
        return sorted(self.fits, key=lambda names: -self.evidence(names))


def evidence(fitted: Fit, inflation: float) -> float:
    """Laplace's log evidence [nats], over all that the scatter of hovers from flight to flight may be."""
    found = _by_scatter(fitted, inflation)
    return float(logsumexp(found) - np.log(len(found)))


def _by_scatter(fitted: Fit, inflation: float) -> list[float]:
    """The same for each of `FLIGHT_SDS`.

    The fit stands for one scatter. Power is all but linear in what is looked for, so the others follow from it.
    """
    demand = fitted.joint
    at, own = demand.pulls(fitted.x), demand.places["flight"]
    data = fitted.curvature - demand.known
    slope = fitted.back(fitted.weighted[:, None])[:, 0]
    cost = bulk(fitted.rows)
    found = []
    for sd in FLIGHT_SDS:
        known = np.ones(at.size)
        known[own] = (demand.flight_sd / sd) ** 2
        curvature = data + np.diag(known)
        step = np.linalg.solve(curvature, -(slope + known * at))
        there = cost + 2.0 * slope @ step + step @ data @ step + known @ (at + step) ** 2
        found.append(
            -0.5 * there / inflation - 0.5 * np.linalg.slogdet(curvature)[1] + 0.5 * float(np.sum(np.log(known)))
        )
    return found


@dataclass(frozen=True, slots=True)
class Chosen:
    """The set that stands and what speaks for it."""

    names: Names
    alternatives: tuple[Names, ...]
    earned: dict[str, float]
    p_familywise: dict[str, float]
    added: dict[str, float]  # RMS, as shares of the hover's power


def terms_of(demand: Demand) -> list[Term]:
    """The catalogue as it may act on these flights, but for what the vehicle's own demand model has."""
    count = len(demand.flights)
    one, known = np.ones(1), {k.effect.id for k in demand.craft.known}
    found = []
    for name in DEMAND_EFFECTS:
        if name == PAYLOAD:
            found.append(Term(id=name, per_flight=True, shapes=(one,) * count))
        elif name == WEAR:
            # Wear has an order: none on the first flight, all of it on the last. A loss from the first flight on is
            # the level of the hover, which nobody knows so well.
            found.append(Term(id=name, shapes=tuple(np.full(1, k / max(count - 1, 1)) for k in range(count))))
        elif name not in known and (name != "air-density" or all(f.weighed for f in demand.flights)):
            found.append(Term(id=name, shapes=(one,) * count))
    return found


def search(base: Demand) -> DemandSearch:
    """All sets worth comparing, fitted."""
    terms = terms_of(base)
    for _ in range(2):  # a payload let go stands in the first noise
        everything = fit(base.with_terms(terms), _START)
        misfits = everything.joint.misfits(everything.x)
        noise = estimated(misfits, FLOOR)
        terms = _released(terms, misfits_without(everything, PAYLOAD), base, noise)
    terms += _carried(everything, terms)
    # What one flight's hover takes by itself is no scatter where a payload may take all of it.
    shared = fit(base.with_terms([t for t in terms if not t.per_flight]), noise)
    base = replace(base, flight_sd=FLIGHT_SDS[int(np.argmax(_by_scatter(shared, 1.0)))])
    found = DemandSearch(base, tuple(terms), replace(noise, doubt=doubt_of_alike(len(base.flights))))
    bare = found.fitted(frozenset())
    found.snr = {t.key: _expected_snr(_geometry(found, bare, t), t) for t in terms}
    found.terms = tuple(t for t in terms if found.snr[t.key] > LEAST_SNR)
    beam: list[Names] = [frozenset()]
    for _ in range(_DEPTH):
        wider = {names | {t.key} for names in beam for t in found.terms if t.id not in found.ids(names)}
        for names in wider:
            found.fitted(names)
        beam = sorted(wider, key=lambda names: -found.evidence(names))[:_WIDTH]
        if (
            not beam
            or found.evidence(beam[0]) < max(map(found.evidence, found.fits))
            or found.evidence(beam[0]) < STRONG
        ):
            break
    return found


def misfits_without(fitted: Fit, name: str) -> list[Array]:
    """What is left of a fit's flights when one term is taken out of it."""
    kept = [t for t in fitted.joint.terms if t.key != name]
    smaller = fitted.joint.with_terms(kept)
    x = np.concatenate([fitted.x[fitted.joint.places[b.name]] for b in smaller.unknowns.blocks])
    return smaller.misfits(x)


def _released(terms: Sequence[Term], misfits: Sequence[Array], base: Demand, noise: Noise) -> list[Term]:
    """The terms, the payload with the times at which it was let go."""
    steps = {r.flight: r for r in releases(misfits, base.flights, noise)}
    shapes = tuple(
        (f.time_s < steps[k].time_s).astype(float) if k in steps else np.ones(1) for k, f in enumerate(base.flights)
    )
    payload = Term(
        id=PAYLOAD,
        per_flight=True,
        shapes=shapes,
        price=sum(r.price for r in steps.values()),
        change_points=tuple((base.flights[k].label, r.time_s) for k, r in steps.items()),
    )
    return [payload if t.id == PAYLOAD else t for t in terms]


def _carried(everything: Fit, terms: Sequence[Term]) -> list[Term]:
    """One payload on some of the flights: on those above the widest gap between what they weigh."""
    own = next(t for t in terms if t.id == PAYLOAD)
    mass = everything.x[everything.joint.places[PAYLOAD]]
    order = np.argsort(mass)
    if order.size < 2:
        return []
    above = mass > mass[order[int(np.argmax(np.diff(mass[order])))]]
    aboard = [above[k] or own.shapes[k].size > 1 for k in range(order.size)]
    shapes = tuple(s if on else np.zeros(1) for s, on in zip(own.shapes, aboard, strict=True))
    # A flight on which one was let go carried it, so there is nothing to choose.
    price = own.price + sum(s.size == 1 for s in own.shapes) * float(np.log(2.0))
    return [replace(own, form=SOME, per_flight=False, shapes=shapes, price=price)]


def _geometry(found: DemandSearch, bare: Fit, term: Term) -> Geometry:
    """What the residuals of the fit of none say of a term added to it, all others free."""
    demand = found.base.with_terms([term])
    (declared,) = term.kind.parameters()
    assert declared.absent is not None
    x = np.concatenate([bare.x, np.full(term.block().size, declared.absent)])
    _, slopes = demand.linearised(x, found.noise)
    return geometry_of(bare, np.vstack([s.full()[:, bare.x.size :] for s in slopes]))[0]


def _expected_snr(geometry: Geometry, term: Term) -> float:
    """Standard deviations by which the term at its usual size would stand out."""
    (declared,) = term.kind.parameters()
    assert declared.prior is not None and declared.absent is not None
    mean, sd = declared.prior
    usual = (mean - declared.absent) / sd if mean != declared.absent else 1.0
    # What differs from flight to flight is shown by one flight that is unlike the others.
    size = np.zeros(geometry.information.shape[0])
    size[0] = usual
    return float(np.sqrt(max(float(size @ geometry.information @ size), 0.0)))


def choose(found: DemandSearch, rng: np.random.Generator) -> Chosen:
    """The best set whose every member earns its place, is no noise and harms on no unseen flight."""
    refuted: list[Names] = []
    while True:
        chosen = _selected(found, refuted)
        if not chosen.names:
            return chosen
        p_values = _familywise(found, chosen, rng)
        if all(p <= _SIGNIFICANT for p in p_values.values()) and not _harmful(found, chosen.names):
            return replace(chosen, p_familywise=p_values)
        refuted.append(chosen.names)


def _selected(found: DemandSearch, refuted: Collection[Names]) -> Chosen:
    for names in found.ranked()[:2]:  # each member against its mimics
        for member in names:
            rest = names - {member}
            mimics = set(DEMAND_EFFECTS[member.partition(":")[0]].mimics) - found.ids(rest)
            for other in (t.key for t in found.terms if t.id in mimics):
                found.fitted(rest | {other})
    valid = [names for names in found.ranked() if names and names not in refuted and _stands(found, names)]
    if not valid:
        return Chosen(frozenset(), (), {}, {}, {})
    best = max(found.evidence(names) for names in valid)
    near = [names for names in valid if found.evidence(names) > best - NEAR]
    chosen = min(near, key=lambda names: (found.fitted(names).x.size, sorted(_ORDER[n] for n in found.ids(names))))
    same = found.ids(chosen)
    others = tuple(names for names in near if found.ids(names) != same and len(names) <= len(chosen))
    return Chosen(chosen, others, found.earned(chosen), {}, added(found.fitted(chosen)))


def _stands(found: DemandSearch, names: Names) -> bool:
    fitted = found.fitted(names)
    sizes = added(fitted)
    if min(sizes.values()) < max(LEAST, _LEAST_SHARE * max(sizes.values())) or not _physical(fitted):
        return False
    return all(earned >= found.needed(name) for name, earned in found.earned(names).items())


def added(fitted: Fit) -> dict[str, float]:
    """RMS of what each member changes in the power over all flights, as a share of the hover's."""
    whole = np.concatenate(fitted.joint.misfits(fitted.x))
    return {
        t.key: float(np.sqrt(np.mean((np.concatenate(misfits_without(fitted, t.key)) - whole) ** 2)))
        for t in fitted.joint.terms
    }


def _physical(fitted: Fit) -> bool:
    """No number of an effect stands at the end of its physical range, but where it vanishes."""
    for term in fitted.joint.terms:
        block, x = term.block(), fitted.x[fitted.joint.places[term.key]]
        (declared,) = term.kind.parameters()
        if not inside(x, block.low, block.high, declared.absent or 0.0):
            return False
    return True


def _familywise(found: DemandSearch, chosen: Chosen, rng: np.random.Generator) -> dict[str, float]:
    bare = found.fitted(frozenset())
    geometries = (_geometry(found, bare, t) for t in found.terms)
    return exceeded(chosen.earned, found.fitted(chosen.names).rows, geometries, rng)


def unseen(found: DemandSearch, names: Names, share: float = _SEEN) -> list[Array] | None:
    """Misfits on the part of each flight that its prediction did not see; None with fewer than three flights.

    What a flight shares with others comes from them, what is its own from the first ``share`` of it.
    """
    flights = found.base.flights
    if len(flights) < _FEWEST:
        return None
    demand, left = found.demand(names), []
    for k, data in enumerate(flights):
        seen = max(int(np.ceil(share * data.time_s.size)), 1)
        learnt = fit(demand.with_part(k, seen), found.noise, found.fitted(names).x, rounds=6)
        left.append(demand.misfits(learnt.x)[k][seen:])
    return left


def _harmful(found: DemandSearch, names: Names) -> bool:
    # A part of a flight tells its level by itself, and so hides what a law that all flights share gets wrong or right.
    share = _SEEN if PAYLOAD in found.ids(names) else 0.0
    after, before = (unseen(found, one, share) for one in (names, frozenset[str]()))
    return after is not None and before is not None and rms(after) > _NO_WORSE * rms(before)


def rms(parts: Sequence[Array]) -> float:
    """Root mean square over flights."""
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
