"""Steps in a flight's resistance: when a contact goes bad and when it is good again.

Every pair of times is tried as an extra resistance between them, against the whitened residuals of a fit; what is
found has to pay for having been looked for everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.candidate import Candidate, Unknown
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.noise import doubt_of_alike
from bhm_service.units import Array

_ID = "intermittent-contact"
_GRID_S = 4.0  # between the times that are tried first
_SHORTEST_S, _FEWEST = 20.0, 5  # of an episode, and its samples: two or three of an averaged recording are one peak
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


def episodes(fitted: Fitted) -> list[Episode]:
    """All episodes that stand out of a fit's residuals."""
    return [e for k in range(len(fitted.joint.flights)) for e in _in_flight(fitted, k)]


def _in_flight(fitted: Fitted, flight: int) -> list[Episode]:
    data = fitted.joint.flights[flight]
    count = data.time_s.size
    e = np.clip(fitted.rows[flight][:count], -6.0, 6.0).copy()
    step_s = float(np.median(np.diff(data.time_s)))
    step, shortest_s = max(round(_GRID_S / step_s), 1), max(_SHORTEST_S, _FEWEST * step_s)
    starts = np.flatnonzero(data.airborne)[::step]
    if starts.size < 4:
        return []
    # What a resistance that begins at each start and lasts would do to the whitened residual.
    lasting = np.where(np.arange(count) >= starts[:, None], -data.current_a, 0.0)
    shapes = fitted.joint.whitened(lasting, flight, fitted.noise)
    nuisance = _nuisance(fitted, flight, count)
    shapes = shapes - (shapes @ nuisance.T) @ nuisance
    gram = shapes @ shapes.T
    times = np.append(data.time_s[starts], data.time_s[-1] + 1.0)
    found: list[Episode] = []
    price, alike = 2.0 * np.log(starts.size), doubt_of_alike(len(fitted.joint.flights))
    for _ in range(_EPISODES):
        score = shapes @ e
        gains, sizes = _pairs(score, gram, times, shortest_s)
        # One flight's: what a model gets wrong alike in all of them is in all of them.
        gains *= alike
        first, last = np.unravel_index(int(np.argmax(gains)), gains.shape)
        nats = float(gains[first, last]) - price
        if nats < _NATS:
            break
        shape = shapes[first] - (shapes[last] if last < starts.size else 0.0)
        ohm = float(sizes[first, last])
        e -= ohm * shape
        found.append(
            Episode(flight, float(times[first]), float(times[last]), ohm, price, open_end=bool(last == starts.size))
        )
    return found


def _nuisance(fitted: Fitted, flight: int, count: int) -> Array:
    """Directions that the other unknowns can take in this flight, orthonormal, the well known ones shrunk away."""
    slope = fitted.slopes[flight].by[:count]
    values, vectors = np.linalg.eigh(slope.T @ slope)
    strong = values > 1.0
    return np.asarray((slope @ vectors[:, strong] / np.sqrt(values[strong])).T)


def _pairs(score: Array, gram: Array, times: Array, shortest_s: float) -> tuple[Array, Array]:
    """Gain [nats] and size of every episode (begin, end); the last end is 'to the end of the recording'."""
    count = score.size
    ends = np.append(score, 0.0)
    wide = np.zeros((count + 1, count + 1))
    wide[:count, :count] = gram
    numerator = score[:, None] - ends[None, :]
    power = np.diag(gram)[:, None] + np.diag(wide)[None, :] - 2.0 * wide[:count, :]
    long_enough = times[None, :] - times[:count, None] >= 0.999 * shortest_s
    power = np.where(long_enough & (power > 1e-9) & (numerator > 0.0), power, np.inf)
    return 0.5 * numerator**2 / power, numerator / power


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
