"""Which of the fitted sets is the explanation, and which others the recordings cannot tell from it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import pearsonr

from bhm_service.battery.effects import EFFECTS, ContactResistance
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.odds import (
    BRIEF,
    COMPANIONS,
    NATS,
    NEAR,
    STRONG,
    STRUCTURAL,
    Names,
    share_asked,
    structural,
)
from bhm_service.discrepancy.physical import physical
from bhm_service.discrepancy.search import Search
from bhm_service.units import Array

# What has to be explained by the equations themselves before anything is said, where nothing tells what the model's
# form is off by: one wrong story in a hundred fleets is too many.
_CLAIM_NATS = 16.0
_RIVALS = 6  # beside its mimics that a member of a set is held against
_RIVALRIES = 3  # times that the chosen set's members are held against their mimics, at most
_MAJORITY = 0.5  # of the evidence of a set that is refuted since an effect of it is absent
LEAST_V = 0.001  # [V] of a cell: what adds less than this to the voltage changes nothing that anybody flies by
_STRUCTURAL_V = 0.004  # [V] of a cell: the same for what looks like an error of the model's structure
_BEYOND = 2.0  # times what the lab leaves open, which bends every curve: less is no other shape
_PASSING = frozenset({"time-skew"})  # shows at steps only
_COMING = BRIEF - _PASSING  # comes and goes within a sample, and stays for a while
_SWIFT = 31  # samples, some minute: no error of a lab's comes as fast
_FULL_V = 0.008  # [V] of a cell: a hundredth of its charge, as closely as a full one is known
_LEAST = {**dict.fromkeys(STRUCTURAL - _PASSING, _STRUCTURAL_V), "partial-charge": _FULL_V}
MUCH = 0.4  # of the misfit's power: what explains less of it by itself has to earn the more for it
_OPPOSED = -0.8  # cosine
_FOLLOWS = 0.01  # probability that sizes of single flights go with their temperatures as they do by chance
_FEWEST = 4  # flights whose sizes tell that
_FELT = 0.1  # of what an effect adds at most
# What any pack meets on its way, then (`_order`) a bad contact, then what is wrong with a sensor or a cell, then what
# stands beside another cause or is an error of a model's structure.
_COMMONEST = frozenset(
    {
        "resistance-temperature", "self-heating", "capacity-fade", "resistance-growth", "partial-charge",
        "self-discharge",
    }
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Selection:
    """The chosen set and its rivals."""

    names: Names
    alternatives: tuple[Names, ...]
    earned: dict[str, float]  # [nats] of evidence that each member adds to the others
    added_v: dict[str, float]  # [V] RMS that each member adds to the pack's voltage


NOTHING = Selection(frozenset(), (), {}, {})


def select(found: Search, refuted: Collection[Names] = (), absent: Names = frozenset()) -> Selection:
    """The best of the sets whose every member earns its place.

    Among equals it is the simplest, then what the flights clearly like better, then the commonest, then the likeliest.

    What the flights like far less than a refuted set is only what that one leaves to be had, unless it is part of it.
    ``absent`` are effects of which it is known that they are not there: no set with one of them is the answer.
    """
    best = _best(found, absent)
    # A member may have no place in it; the beam has not met each of its parts.
    found.fit_all({best - {member}: found.fitted(best) for member in sorted(best)})
    near = _near(found, refuted, absent)
    for _ in range(_RIVALRIES):
        held = near[:1]
        rivalled = near[0] if near else _best(found, absent)
        if not near and not _within_reach(found, rivalled):
            return NOTHING
        _swaps(found, rivalled)
        near = _near(found, refuted, absent)
        if near[:1] == held:
            break
    if not near:
        return NOTHING
    return selected(found, near[0], near[1:])


def selected(found: Search, names: Names, alternatives: Iterable[Names] = ()) -> Selection:
    """A set as the one that is chosen, before its alternatives."""
    return Selection(names, tuple(alternatives), found.earned(names), added(found, names))


def _best(found: Search, absent: Names) -> Names:
    """What the flights like best, whatever else speaks against it."""
    return next(names for names in found.ranked() if not names & absent)


def _within_reach(found: Search, names: Names) -> bool:
    """Whether others in the place of its members could earn the least that so many have to.

    Hardly any outdoes what the flights like best by more than tells two explanations apart. Where nothing is missing
    that best is of what follows nearly anything, and its fits are the longest.
    """
    return found.evidence(names) + NEAR > NATS * len(names)


def taken(found: Search, names: Names) -> Selection:
    """A set at its word: those of it that the flights can show, whatever they earn, against no rival."""
    there = names & {c.id for c in found.candidates}
    found.fitted(there, found.fits[found.ranked()[0]])
    return selected(found, there) if there else NOTHING


def _near(found: Search, refuted: Collection[Names], absent: Names) -> list[Names]:
    """The sets that could be the explanation, first the one that is chosen; empty where none is."""
    valid: list[Names] = []
    best, most = frozenset[str](), 0.0
    imitations = _imitations(found, refuted, absent)
    for names in _open(found, refuted, absent):
        nats = found.evidence(names)
        # One more member has to earn its place against the best set without it, not only against its own remainder.
        better = nats - price(found, names) > most - price(found, best)
        close = len(names) <= len(best) and nats > most - NEAR
        # What is behind the best by less than tells them apart need not have earned that: it is no less its rival.
        if names in imitations or not (better or close) or not _stands(found, names, 0.0 if better else most - nats):
            continue
        valid.append(names)
        if better:
            best, most = names, nats
    near = [names for names in valid if len(names) <= len(best) and found.evidence(names) > most - NEAR]
    if not any(_credit(found, names) > _claim(found, names) for names in near):
        return []
    if _beyond_physics(found, _open(found, refuted, absent), most - price(found, best) + NATS):
        return []
    of = {names: found.evidence(names) for names in near}
    odds = {names: of[names] - price(found, names) for names in near}
    likely = {names: odds[names] > max(odds[n] for n in near if len(n) == len(names)) - STRONG for names in near}
    return sorted(near, key=lambda names: (len(names), not likely[names], _order(names), -of[names]))


def _imitations(found: Search, refuted: Collection[Names], absent: Names) -> set[Names]:
    """The sets that the flights like far less than a refuted one: they explain what that one leaves to be had.

    But for its parts, and, where one of these stands, what is no larger and the flights like better.
    """
    # What an absent effect only seemed to explain is of another kind, unless a set explains the larger part of it.
    liked = max((_liking(found, r) * (_MAJORITY if r & absent else 1.0) for r in refuted), default=0.0) - NATS
    fewer = {names for names in _open(found, refuted, absent) if found.evidence(names) < liked}
    parts = {names for names in fewer if any(names < r for r in refuted)}
    standing = [(len(part), found.evidence(part)) for part in parts if _stands(found, part, 0.0)]
    no_worse = {n for n in fewer if any(len(n) <= size and found.evidence(n) >= nats for size, nats in standing)}
    return fewer - parts - no_worse


def _liking(found: Search, names: Names) -> float:
    """Of a set's evidence, what speaks against others. [nats]

    What a free course or a model's structure earns it has to earn for following nearly anything: that the flights like
    it better than what has only one way to be says nothing against that.
    """
    return found.evidence(names) - price(found, names) + NATS * len(names)


def _open(found: Search, refuted: Collection[Names], absent: Names) -> list[Names]:
    """The sets of which nothing is known that speaks against them, the best first."""
    return [names for names in found.ranked() if names and names not in refuted and not names & absent]


def _swaps(found: Search, names: Names) -> None:
    """Each member against its mimics and against what looks best beside the others: the beam has met few of these."""
    swapped: dict[Names, Fitted] = {}
    for member in sorted(names):
        others = names - {member}
        there = {c.id for c in found.candidates if c.shown_beside(others)}
        rivals = [other for other in EFFECTS[member].mimics if other in there]
        if others:
            gains = found.gains(others)
            rivals += sorted(gains, key=lambda name: -gains[name])[:_RIVALS]
        for other in dict.fromkeys(rivals):
            if other not in names:
                swapped[others | {other}] = found.fitted(names)
    found.fit_all(swapped)
    if len(names) > 1:
        # Those that are hardly behind may be so for the way by which they came; what is alone was looked at before.
        least = found.evidence(names) - NATS
        found.look_across(names, [other for other in swapped if least < found.evidence(other) < least + NATS])


def _stands(found: Search, names: Names, behind: float) -> bool:
    return (
        _separable(found, names)
        and _physical(found.fitted(names))
        and _matters(found, names, behind)
        and _explains(found, names)
        and _by_chance(found.fitted(names))
    )


def _by_chance(fitted: Fitted) -> bool:
    """Whether what is of another size in every flight has nothing to do with how warm the flights were.

    Sizes that nothing ties to each other take up what an equation leaves that is driven by temperature, and what has no
    equation in the set: then they follow the temperature.
    """
    joint = fitted.joint
    inferred = any("temperature" in member.inferred for member in joint.members)
    courses = [
        joint.temperature(fitted.x[None, :], k) if inferred else f.temperature_k for k, f in enumerate(joint.flights)
    ]
    means = [np.nan if course is None else float(np.mean(course)) for course in courses]
    kelvin = np.array(means)[known := np.isfinite(means)]
    if kelvin.size < _FEWEST or _all_alike(kelvin):
        return True
    values = joint.values(fitted.x[None, :])
    own = [values[u.name][0][known] for c in joint.members for u in c.amplitudes() if u.per_flight]
    return all(_all_alike(sizes) or pearsonr(sizes, kelvin).pvalue > _FOLLOWS for sizes in own)


def _all_alike(values: Array) -> bool:
    """Whether numbers differ by their rounding at most, which follows nothing."""
    return bool(np.allclose(values, values[0]))


def _explains(found: Search, names: Names) -> bool:
    """Whether the members by themselves explain enough of the misfit, and each of them its part beside the others.

    A set can earn much by what it lets the lab's errors do, while its equations hardly come near the misfit without
    them: its evidence counts as far as the equations go. What the lab was off by besides may be the larger part.
    Of a pack that no lab has seen there is no telling: what its battery is off by is mostly the lab's error. What is
    measured beside the pack's voltage need not explain much of that, nor a law that flights show clearly.
    """
    if not found.base.lab.identified:
        return True
    whole, *others = _shares(found, names)
    earned = found.earned(names)
    members = [member.id for member in found.joint(names).members]
    beside = {name: found.credit(frozenset({name})) for name in members}
    clear = _clear_laws(found, names)
    each = all(
        name in clear or alone * (earned[name] - beside[name]) + beside[name] > found.heard(name, names)
        for name, alone in zip(members, others, strict=True)
    )
    finer = all(earned[name] >= structural(found.base.lab.form_told) for name in _opposed(found, names))
    enough = whole > MUCH or _credit(found, names) > _CLAIM_NATS or found.measured(names) or names <= clear
    return each and finer and enough


def _clear_laws(found: Search, names: Names) -> Names:
    """The laws in a set that earn what any effect has to.

    A resistance or a capacity that the lab has wrong by a little may hide by itself what they explain. That they hold
    is known, and by about how much.
    """
    earned = found.earned(names)
    return frozenset(name for name in found.lawful(names) if earned[name] >= NATS)


def _opposed(found: Search, names: Names) -> list[str]:
    """The members that do nearly the opposite of another: what they leave of each other is a finer shape than either.

    What a model gets wrong by its structure looks like that as well.
    """
    parts = found.alone(names)
    size = np.sqrt(np.sum(parts**2, axis=1))
    against = np.any(parts @ parts.T < _OPPOSED * np.outer(size, size), axis=1)
    members = found.joint(names).members
    return [member.id for member, is_so in zip(members, against, strict=True) if is_so]


def _credit(found: Search, names: Names) -> float:
    """Of a set's evidence, what its equations have by themselves, and what is measured beside them. [nats]

    All of it, of laws that flights show clearly.
    """
    if names <= _clear_laws(found, names):
        return found.evidence(names)
    beside = found.credit(names)
    by_voltage = found.evidence(names) - beside
    return beside + by_voltage * (share(found, names) if found.base.lab.identified else 1.0)


def _claim(found: Search, names: Names) -> float:
    """What the equations of a set have to explain by themselves before anything is said. [nats]

    Where the lab told its model's form, what is left for chance is noise: no more than a member has to earn.
    """
    if found.base.lab.form_told and names <= found.lawful(names):
        return STRONG
    if found.base.lab.form_told and not names & COMPANIONS:
        return min(max(found.needed(name, names) for name in names), _CLAIM_NATS)
    return _CLAIM_NATS


def share(found: Search, names: Names) -> float:
    """Of the misfit's power where a set is felt, what its equations explain at best, no error of the lab bent."""
    return _shares(found, names)[0]


def _shares(found: Search, names: Names) -> list[float]:
    """That of a set, then what each member explains where it is felt beside the others."""
    known = np.isfinite(np.concatenate([f.voltage_v for f in found.base.flights]))
    parts = found.alone(names)[:, known]
    misfit = np.concatenate(found.base.misfits)[known]
    whole = parts.sum(axis=0)

    def explained(part: Array, left: Array, noise_v2: float) -> float:
        felt = np.abs(part) >= _FELT * np.max(np.abs(part))
        claimed, before, after = (float(np.mean(v[felt] ** 2)) for v in (part, left, left - part))
        # No noise is taken for less than its floor: what lies below that is there as far as the equation says.
        return (before - after) / max(before - noise_v2, claimed, 1e-12)

    def of(part: Array, left: Array, own: Names) -> float:
        # What a skew adds is taken back by the next samples, and a contact shows where it comes and goes: a slow misfit
        # beside them is not theirs to explain.
        if own <= _PASSING:
            return explained(np.diff(part), np.diff(left), 2.0 * power)
        if own <= _COMING:
            return explained(_swift(part), _swift(left), power)
        return explained(part, left, power)

    power = found.noise.sigma_v**2
    each = zip(found.joint(names).members, parts, strict=True)
    return [of(whole, misfit, names), *(of(part, misfit - whole + part, frozenset({m.id})) for m, part in each)]


def _swift(series: Array) -> Array:
    """What of a series (T,) is not slow."""
    return np.asarray(series - uniform_filter1d(series, _SWIFT, mode="nearest"))


def _matters(found: Search, names: Names, behind: float = 0.0) -> bool:
    """Whether every member earns its place but for some nats, and moves the voltage by what anybody could care for."""
    # What comes and goes matters while it is there, however much has been flown without it.
    volts = {name: _rms(own[own != 0.0] if name in _COMING else own) for name, own in found.added_by(names).items()}
    series = found.base.lab.series
    told = found.base.lab.form_told
    # What is measured cell by cell is of one of them.
    cells = {name: 1 if found.measured(frozenset({name})) else series for name in volts}
    if any(v < cells[name] * _LEAST.get(name, LEAST_V) * share_asked(name, told) for name, v in volts.items()):
        return False
    if volts.get("ocv-shape", np.inf) < _BEYOND * series * found.base.lab.bend_sd_v:
        return False
    return all(earned >= found.needed(name, names) - behind for name, earned in found.earned(names).items())


def price(found: Search, names: Names) -> float:
    """What a set has to earn. [nats]"""
    return sum(found.needed(name, names) for name in names)


def _beyond_physics(found: Search, tried: Collection[Names], nats: float) -> bool:
    """Whether only a number beyond what is physical keeps a set from being the answer that has more than that to spare.

    That is evidence beyond what its members have to earn: with two more of them a set follows nearly anything better.
    What stands behind such a set only imitates a cause that the catalogue does not hold.
    """
    return any(
        not _physical(found.fitted(names)) and _separable(found, names) and _matters(found, names)
        for names in tried
        if found.evidence(names) - price(found, names) > nats
    )


def _separable(found: Search, names: Names) -> bool:
    """Where a driver was not measured, no mimic of what it drives can stand beside it, nor a second such effect."""
    hidden = {c.id for c in found.candidates if c.id in names and c.inferred}
    return len(hidden) <= 1 and not any(set(EFFECTS[h].mimics) & names for h in hidden)


def added(found: Search, names: Names) -> dict[str, float]:
    """RMS of what each member adds to the pack's voltage over all flights. [V]"""
    return {name: _rms(own) for name, own in found.added_by(names).items()}


def _rms(series: Array) -> float:
    return float(np.sqrt(np.mean(series**2))) if series.size else 0.0


def _physical(fitted: Fitted) -> bool:
    """No number of an effect that makes it vanish stands at the end of its physical range."""
    return all(physical(fitted, member) for member in fitted.joint.members)


def _order(names: Names) -> tuple[int, ...]:
    """How common a set's members are, the commonest first."""

    def rank(name: str) -> int:
        usual = 0 if name in _COMMONEST else 1 if name == ContactResistance.id else 2
        return usual + (name in STRUCTURAL | COMPANIONS)

    return tuple(sorted(map(rank, names)))
