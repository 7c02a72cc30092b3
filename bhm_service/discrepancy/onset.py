"""From which flight on: what was not there in the first flights, and nobody noted when it came."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bhm_service.discrepancy.candidate import Candidate

ONSET = "onset"  # the driver of a number that says whether something is there in a flight
_FEWEST = 3  # flights


def begun(candidate: Candidate, flights: int, gain: Callable[[Candidate], float], least: float) -> Candidate:
    """The candidate from its likeliest flight on, where it may begin with one and the flights pay for asking which.

    ``gain`` is what a candidate adds to an explanation of the others, ``least`` what a beginning has to earn beyond
    having been there from the first flight. [nats]
    """
    tried = later(candidate, flights)
    if not tried:
        return candidate
    gains = [gain(c) - c.price + candidate.price for c in tried]
    best = int(np.argmax(gains))
    return tried[best] if gains[best] > gain(candidate) + least else candidate


def later(candidate: Candidate, flights: int) -> list[Candidate]:
    """The candidate from each flight on but the first, having paid for the choice; none of what cannot begin."""
    names = onsets_of(candidate)
    if not names or flights < _FEWEST:
        return []
    price = float(np.log(flights - 1))
    return [_from(candidate, names, first, flights, price) for first in range(1, flights)]


def onsets_of(candidate: Candidate) -> list[str]:
    """The numbers of a candidate that say whether it is there in a flight."""
    return [f"{key}.{p.name}" for key, kind in candidate.parts for p in kind.parameters() if p.driver == ONSET]


def first_flight(candidate: Candidate) -> int:
    """The flight from which on it is there."""
    told = [candidate.fixed[name] for name in onsets_of(candidate) if name in candidate.fixed]
    return int(np.argmax(np.asarray(told[0]) > 0.0)) if told else 0


def _from(candidate: Candidate, names: list[str], first: int, flights: int, price: float) -> Candidate:
    there = [float(k >= first) for k in range(flights)]
    return replace(candidate, fixed={**candidate.fixed, **dict.fromkeys(names, there)}, price=candidate.price + price)
