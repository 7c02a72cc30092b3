"""Which set of effects stands: it beats noise and phantoms, harms on no unseen flight, earns its place with the other
model of the cell as well, and outweighs what it leaves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.effects import CurrentOffset, TimeSkew, UnseenLoad
from bhm_service.discrepancy import verdict
from bhm_service.discrepancy.before_load import begins_as_read, unloaded_a
from bhm_service.discrepancy.bent_curve import bent_curve, bumped_curve
from bhm_service.discrepancy.bent_lab import BentLab, bent_lab
from bhm_service.discrepancy.changed_lag import ChangedLag, changed_lag
from bhm_service.discrepancy.confirm import Unseen, harmful
from bhm_service.discrepancy.crossing import Witness
from bhm_service.discrepancy.decoys import contests
from bhm_service.discrepancy.explanation import Contest, Left
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.odds import BRIEF, NATS, NEAR, STRUCTURAL, Names
from bhm_service.discrepancy.patterns import BOARD, Pattern, telling
from bhm_service.discrepancy.recurring import Recurring, recurring
from bhm_service.discrepancy.search import Search
from bhm_service.discrepancy.selection import MUCH, NOTHING, Selection, price, select, selected, share
from bhm_service.discrepancy.significance import familywise
from bhm_service.discrepancy.timing import timed

_MOST_REFUTED = 8  # sets that are put to the test, the best first
_DEAF = 2.0  # times the error that a model is off by in the lab: a witness beyond hears its own errors only
_MOST = 0.5  # of a current
_SIGNIFICANT = 0.02  # over the whole catalogue


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """The set that stands, and what it was held against."""

    chosen: Selection
    p_values: Mapping[str, float]  # of its members, over the whole catalogue
    contests: Sequence[Contest] = ()  # with phantoms of what drives it
    left: Left | None = None  # what it leaves that no effect has


def decide(
    unseen: Unseen, second: Witness | None, closer: Witness, logs: Sequence[FlightData], rng: np.random.Generator
) -> Decision:
    """The best set that beats all it is held against, or none.

    ``second`` is the other model of the cell, ``closer`` this one on the flights at their own rate, ``logs``.
    """
    standing = _significant(unseen, second, closer, rng)
    chosen = standing.chosen if told_from_lab(unseen.found, standing.chosen.names) else NOTHING
    chosen, left = outweighed(unseen.found, chosen, closer.lab, logs)
    likelier = with_the_load if isinstance(left, Recurring) else with_the_zero
    first = likelier(unseen.found, chosen)
    other = None if first is chosen else _standing(unseen, second, first, rng)
    if other is not None and timed(closer, first.names):
        standing, chosen = other, first
    kept = standing.contests if chosen.names else ()
    return Decision(chosen=chosen, p_values=standing.p_values, contests=kept, left=left)


def _significant(unseen: Unseen, second: Witness | None, closer: Witness, rng: np.random.Generator) -> Decision:
    """The best set that beats noise, is beaten by no phantom, harms on no unseen flight and has the other model's word.

    A skew has to stand on the logs' own samples (``closer``) as well: over averaged ones it is not told from what a
    cell relaxes within a second, of which the samples themselves show that part comes at once. One that does not is
    part of no set. Sets are dropped one by one; a catalogue of which the best are all refuted has nothing to say.
    """
    refuted: list[Names] = []
    absent: Names = frozenset()
    for _ in range(_MOST_REFUTED):
        chosen = select(unseen.found, refuted, absent)
        if not chosen.names:
            return Decision(chosen=chosen, p_values={})
        standing = _standing(unseen, second, chosen, rng)
        if standing is not None:
            if timed(closer, chosen.names):
                return standing
            absent = frozenset({TimeSkew.id})
        refuted.append(chosen.names)
    return Decision(chosen=NOTHING, p_values={})


def _standing(unseen: Unseen, second: Witness | None, chosen: Selection, rng: np.random.Generator) -> Decision | None:
    """The decision for a set that beats noise and phantoms, harms no unseen flight and has the other model's word.

    And that flights do not deny by what they read before their load.
    """
    found, names = unseen.found, chosen.names
    if not begins_as_read(found.fitted(names), found.added_by(names)):
        return None
    p_values = familywise(found, names, rng)
    if any(p > _SIGNIFICANT for p in p_values.values()) or harmful(unseen, names):
        return None
    rivals = contests(found, names, rng)
    if any(c.nats < -NEAR for c in rivals) or not (second is None or _witnessed(found, second, names)):
        return None
    return Decision(chosen=chosen, p_values=p_values, contests=rivals)


def told_from_lab(found: Search, names: Names) -> bool:
    """Whether what a set explains is more than the battery is off by in the lab, or of another kind.

    What a model leaves of the lab's own recordings it leaves in flight as well, and to what it leaves some effect of
    a catalogue is always near. Where the lab told where it is off, and how far, an effect has beaten that already. And
    it lasts: what is there for seconds only is none of it, however little. Nor is what is measured beside the voltage
    of the pack.
    """
    told = found.base.lab.form_told or verdict.beyond_lab(found)
    return told or bool(names & BRIEF) or found.measured(names)


def _witnessed(found: Search, second: Witness, chosen: Names) -> bool:
    """Whether every member earns something with the other cell model, and what looks like structure all it has to.

    With either model it has to do the same: what both like the flights better with, the one turned round from the
    other, mends the structure of both. Of a model that follows the pack's own lab far less well nothing else is asked.
    """
    earned = second.earned(chosen)
    names = frozenset(earned)
    if any(earned[name] >= found.heard(name, chosen) for name in second.turned_round(found, chosen)):
        return False
    if second.lab.own_error_v > _DEAF * found.base.lab.own_error_v:
        return True
    least = {name: found.needed(name, names) if name in STRUCTURAL else found.heard(name, names) for name in earned}
    return all(nats >= least[name] for name, nats in earned.items())


def outweighed(found: Search, chosen: Selection, lab: Lab, logs: Sequence[FlightData]) -> tuple[Selection, Left | None]:
    """The selection and what it leaves; nothing is selected where what is left tells more than it does.

    What by itself explains much of the misfit stays, with an unexplained rest, unless what no battery has to do with
    says more in its place. What looks like a model's structure is no physics of this pack where something without a
    name does as well. ``logs`` are the flights at their own rate.
    """
    fitted = found.fitted(chosen.names)
    # Neither is an error of the lab, however small: no model of a cell keeps time, or changes within a second.
    left = recurring(fitted) or changed_lag(fitted, logs) or _pattern(found, chosen.names)
    if not chosen.names:
        bent = bent_curve(fitted, lab) or bumped_curve(fitted, lab)
        return chosen, left or bent or _everywhere(found, fitted, lab)
    if left is not None and left.nats > found.evidence(chosen.names) and share(found, chosen.names) < MUCH:
        return NOTHING, left
    foreign = _foreign(found, chosen.names, left)
    if foreign is not None:
        return NOTHING, foreign
    if chosen.names <= STRUCTURAL:
        bare = telling(found.fitted(frozenset()))
        if bare is not None and bare.nats > found.evidence(chosen.names) - NATS:
            return NOTHING, bare
    return chosen, left


def with_the_load(found: Search, chosen: Selection) -> Selection:
    """The selection where something switches by itself: of equals, what has a load past the sensor comes first.

    What is on by turns, and in no current that was read, takes charge in the mean as well.
    """
    equals = (chosen.names, *chosen.alternatives)
    loaded = next((names for names in equals if UnseenLoad.id in names), chosen.names)
    if loaded == chosen.names:
        return chosen
    return selected(found, loaded, (names for names in equals if names != loaded))


def with_the_zero(found: Search, chosen: Selection) -> Selection:
    """The selection where the sensor reads less than nothing before the load: it has its zero off in a load's place.

    Nothing charges a pack on the ground. Where most of what a load past the sensor would draw is in that reading, there
    is no such load, however much more usual its size would be than the zero's.
    """
    equals = (chosen.names, *chosen.alternatives)
    loaded = next((names for names in equals if UnseenLoad.id in names), None)
    read_a = unloaded_a(found.base.flights)
    if loaded is None or read_a is None or all(c.id != CurrentOffset.id for c in found.candidates):
        return chosen
    at = found.fitted(loaded)
    drawn_a = float(at.x[at.joint.places[f"{UnseenLoad.id}.current"]][0])
    if -read_a <= _MOST * drawn_a:
        return chosen
    zeroed = loaded - {UnseenLoad.id} | {CurrentOffset.id}
    found.fitted(zeroed, at)
    return selected(found, zeroed, (names for names in equals if names != zeroed and UnseenLoad.id not in names))


def _foreign(found: Search, names: Names, left: Recurring | ChangedLag | Pattern | None) -> Pattern | None:
    """A line over what no battery has to do with that is likelier than a set with what it leaves, each with its odds.

    What follows the autopilot's own temperature, an offset and a gain follow by halves. Where an autopilot is warm a
    pack is: what a pack's warmth drives is never put out by it.
    """
    line = telling(found.fitted(frozenset()), lines_only=True)
    if line is None or (line.variable == BOARD and any(m.driven_by_temperature for m in found.joint(names).members)):
        return None
    beside = 0.0 if left is None else left.nats - NATS
    return line if line.nats - NATS > found.evidence(names) - price(found, names) + beside + NEAR else None


def _everywhere(found: Search, fitted: Fitted, lab: Lab) -> BentLab | None:
    """What a fit of no effect lays on all that the lab leaves open; a number that moved far is a verdict by itself."""
    return bent_lab(fitted, lab) if verdict.beyond_lab(found) and not verdict.moved(fitted) else None


def _pattern(found: Search, names: Names) -> Pattern | None:
    """The pattern that a set leaves; what is within the lab's own errors, and may be one, is one of those."""
    return telling(found.fitted(names), lines_only=not names and not verdict.beyond_lab(found))
