"""Steps in a flight's resistance: when a contact goes bad and when it is good again.

Every pair of times is tried as an extra resistance between them, against the whitened residuals of a fit of which all
numbers are free; what is found has to pay for having been looked for everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.candidate import Candidate, Unknown
from bhm_service.discrepancy.first_order import Beside
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.noise import doubt_of_alike
from bhm_service.discrepancy.odds import NEAR
from bhm_service.units import Array, Flags

_ID = "intermittent-contact"
_GRID_S = 4.0  # between the times that are tried first
# Between changes, and their samples: two or three of an averaged recording are one peak.
_SHORTEST_S, _FEWEST = 20.0, 5
_EPISODES = 3  # in one flight, at most
_NATS = 12.0  # that an episode has to earn beyond the price of the search


@dataclass(frozen=True, slots=True)
class Episode:
    """A stretch of a flight with more resistance."""

    flight: int
    begin_s: float
    end_s: float
    ohm: float
    price: float  # [nats] of having been looked for everywhere
    open_end: bool  # lasts to the end of the recording


@dataclass(slots=True)
class _Sought:
    """One flight in which episodes are looked for, among these times."""

    times: Array  # [s] at which one may begin, and one after the end (begins + 1,)
    score: Array  # (begins,) of an ohm that begins then and lasts; without what was found
    gram: Array  # (begins, begins) their information
    across: Array  # (begins, n) how they go with the numbers of the fit
    shortest_s: float
    near: Flags  # times too near to a change that was found, which none is at itself (begins + 1,)
    taken: int = 0  # episodes, and what comes and goes too slowly for one

    @property
    def price(self) -> float:
        """Of having been looked for everywhere. [nats]"""
        return float(2.0 * np.log(self.score.size))

    def best(self) -> tuple[float, int, int]:
        """Gain [nats], its price not yet paid, of the best episode, and its begin and end."""
        gains = _pairs(self.score, self.gram, self.times, self.shortest_s)
        gains[self.near[:-1]] = 0.0
        gains[:, self.near] = 0.0
        first, last = np.unravel_index(int(np.argmax(gains)), gains.shape)
        return float(gains[first, last]), int(first), int(last)

    def episode(self, first: int, last: int, over_s: float) -> Array:
        """One of one ohm as what begins and lasts (begins,); it comes, and goes, over so many seconds."""

        def change(at: int) -> Array:
            within = np.abs(self.times[:-1] - self.times[at]) <= 0.5 * over_s
            return np.asarray(within / max(np.count_nonzero(within), 1))

        return np.asarray(change(first) - (change(last) if last < self.score.size else 0.0))

    def gain(self, shape: Array) -> tuple[float, float]:
        """What an episode gains [nats], its price not yet paid, and its size [Ohm]."""
        ohm = float(shape @ self.score / (shape @ self.gram @ shape))
        return 0.5 * ohm * float(shape @ self.score), ohm


def episodes(fitted: Fitted) -> list[Episode]:
    """All episodes that stand out of a fit's residuals.

    The largest goes first. To a large one the whole fit is bent, in the other flights as well: what it leaves is looked
    at without it.
    """
    sought = {k: own for k in range(len(fitted.joint.flights)) if (own := _sought(fitted, k)) is not None}
    # One flight's: what a model gets wrong alike in all of them is in all of them.
    alike = doubt_of_alike(len(fitted.joint.flights))
    found: list[Episode] = []
    while True:
        best = {k: own.best() for k, own in sought.items() if own.taken < _EPISODES}
        nats = {k: alike * gain - sought[k].price for k, (gain, _, _) in best.items()}
        flight = max(nats, key=lambda k: nats[k], default=None)
        if flight is None or nats[flight] < _NATS:
            return sorted(found, key=lambda e: e.flight)
        own, (gain, first, last) = sought[flight], best[flight]
        swift, slow = (own.episode(first, last, over_s) for over_s in (0.0, own.shortest_s))
        # A contact has no slopes: what is clearly likelier with them is taken for what it is, and is no episode.
        comes_slowly = alike * (own.gain(slow)[0] - gain) > NEAR
        shape = slow if comes_slowly else swift
        ohm = own.gain(shape)[1]
        bent = np.linalg.solve(fitted.curvature, own.across.T @ shape)
        for k, other in sought.items():
            other.score += ohm * (other.across @ bent if k != flight else -own.gram @ shape)
        begin_s, end_s = float(own.times[first]), float(own.times[last])
        for at_s in (begin_s, end_s):
            own.near |= (own.times != at_s) & (np.abs(own.times - at_s) < 0.999 * own.shortest_s)
        own.taken += 1
        if not comes_slowly:
            found.append(Episode(flight, begin_s, end_s, ohm, own.price, open_end=last == own.score.size))


def _sought(fitted: Fitted, flight: int) -> _Sought | None:
    data = fitted.joint.flights[flight]
    step_s = float(np.median(np.diff(data.time_s)))
    starts = np.flatnonzero(data.airborne)[:: max(round(_GRID_S / step_s), 1)]
    if starts.size < 4:
        return None
    lasting = np.where(np.arange(data.time_s.size) >= starts[:, None], -data.current_a, 0.0)
    beside = Beside.of(fitted, flight, lasting)
    score, gram = beside.freed(fitted)
    times = np.append(data.time_s[starts], data.time_s[-1] + 1.0)
    near = np.zeros(times.size, dtype=bool)
    return _Sought(times, score, gram, beside.across, max(_SHORTEST_S, _FEWEST * step_s), near)


def _pairs(score: Array, gram: Array, times: Array, shortest_s: float) -> Array:
    """Gain [nats] of every episode (begin, end); the last end is 'to the end of the recording'."""
    count = score.size
    ends = np.append(score, 0.0)
    wide = np.zeros((count + 1, count + 1))
    wide[:count, :count] = gram
    numerator = score[:, None] - ends[None, :]
    power = np.diag(gram)[:, None] + np.diag(wide)[None, :] - 2.0 * wide[:count, :]
    long_enough = times[None, :] - times[:count, None] >= 0.999 * shortest_s
    power = np.where(long_enough & (power > 1e-9) & (numerator > 0.0), power, np.inf)
    return np.asarray(0.5 * numerator**2 / power)


def contact_candidate(found: Sequence[Episode], flights: int) -> Candidate:
    """Episodes of all flights as one candidate: one resistance for each, its times as they were found."""
    kind = EFFECTS[_ID]
    declared = next(p for p in kind.parameters() if p.absent is not None)
    prior = declared.prior or (0.0, 10.0)
    parts, unknowns, fixed = [], [], {}
    for number, episode in enumerate(found, start=1):
        key = f"{_ID}#{number}"
        parts.append((key, kind))
        unknowns.append(Unknown(key, declared, (prior[0], 2.0 * prior[1]), log=False, per_flight=False))
        for name, value in (("begin", episode.begin_s), ("end", 1e6 if episode.open_end else episode.end_s)):
            fixed[f"{key}.{name}"] = [value if k == episode.flight else 0.0 for k in range(flights)]
    return Candidate(_ID, tuple(parts), tuple(unknowns), fixed, price=sum(e.price for e in found))
