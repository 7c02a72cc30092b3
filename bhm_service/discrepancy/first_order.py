"""What candidates would do to a fit, to first order: what each is expected to add, and the noise that all leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.fitting import Fitted, ProblemT, one_step, weights
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.noise import MOST_DOUBT, SUDDEN, Noise, doubt_of_alike, estimated
from bhm_service.discrepancy.slopes import Slopes
from bhm_service.discrepancy.starts import absent
from bhm_service.units import Array

# The more a model gets wrong in the lab, the more of what it leaves in flight is its own.
_USUAL_V = 0.012  # [V] of a cell: what a model that follows its cell is off by on recordings that no fit saw, at most
_FLOOR_V = 1e-3  # [V] of a cell: no voltage is measured and modelled better than this


@dataclass(frozen=True, slots=True)
class Geometry:
    """A candidate's numbers at no effect, all others free; in standard deviations of its prior."""

    information: Array
    directions: Array  # (rows, numbers) in whitened residuals: the score is these times the residuals


def candidate_geometry(at: Fitted, joint: Joint, candidate: Candidate) -> Geometry:
    """What the residuals of a fit say of a candidate added to it."""
    return geometry_of(at, _slope(at, joint, candidate))[0]


def _slope(at: Fitted, joint: Joint, candidate: Candidate) -> Array:
    return np.vstack(joint.slopes_of(candidate, absent(joint, at, candidate), at.noise))


def geometry_of(at: Fitted[ProblemT], own: Array) -> tuple[Geometry, Array]:
    """Numbers of these slopes (rows, numbers) added to a fit, and their score."""
    both = at.back(own)
    # What stands at its bound makes up for nothing that goes on beyond it: that is for the candidate to explain.
    free = at.free
    across = np.zeros(both.shape)
    across[free] = np.linalg.solve(at.known_curvature[np.ix_(free, free)], both[free])
    # Where the fit stands, what is known before of its own numbers pulls as hard as the residuals do: the residuals
    # along those numbers are not for the candidate to lose.
    score = across.T @ at.gradient - own.T @ at.weighted
    return Geometry(own.T @ own - both.T @ across, at.along(across) - own), score


class Beside(NamedTuple):
    """What would only add to a voltage, beside all numbers of a fit (n,); of so many shapes (k,)."""

    score: Array  # (k,)
    across: Array  # (k, n) of the curvature
    own: Array  # (k, k)

    @classmethod
    def of(cls, at: Fitted, flight: int, shapes: Array) -> Beside:
        """Of shapes in one flight's voltage [V] (k, T)."""
        white = at.joint.whitened(shapes, flight, at.noise)
        white[:, ~np.isfinite(at.joint.flights[flight].voltage_v)] = 0.0
        row = at.rows[flight][: white.shape[1]]
        weighted = white * weights(row)
        return cls(weighted @ row, at.slopes[flight].until(row.size).back(weighted), weighted @ white.T)

    def freed(self, at: Fitted) -> tuple[Array, Array]:
        """Score (k,) and information (k, k), all that was fitted free."""
        # A fit that stopped a little before its end, or at a bound, must not look like something that is missing.
        score = self.score - self.across @ np.linalg.solve(at.curvature, at.gradient)
        return score, self.own - self.across @ np.linalg.solve(at.curvature, self.across.T)


def linear_gain(at: Fitted, joint: Joint, candidate: Candidate) -> float:
    """What the candidate is expected to add to a fit's evidence. [nats]"""
    found, score = geometry_of(at, _slope(at, joint, candidate))
    # Effects at their typical size, not at none: the pull of the prior is left out of the expectation.
    return one_step(found.information, score)[1]


def expected_snr(at: Fitted, joint: Joint, candidate: Candidate) -> float:
    """Standard deviations by which the candidate at its usual size would stand out of noise and lab errors."""
    found, _ = geometry_of(at, _usual(at, joint, candidate))
    return float(np.sqrt(max(float(found.information[0, 0]), 0.0)))


def _usual(at: Fitted, joint: Joint, candidate: Candidate) -> Array:
    """By what the whitened residuals change (rows, 1) when the candidate joins a fit at its usual size."""
    without = absent(joint, at, candidate)
    usual = without.copy()
    for u in candidate.amplitudes():
        usual[joint.unknowns.slice_of(u.name)] = u.usual
    with_it, without_it = (np.concatenate(joint.residuals(x, at.noise)) for x in (usual, without))
    return (with_it - without_it)[:, None]


def saturated_noise(at: Fitted, candidates: Sequence[Candidate]) -> Noise:
    """Noise of what is left when everything that any candidate could explain is taken out of a fit's residuals."""
    joint = at.joint
    plain = Noise(0.0, 0.0, 1.0)
    rows, slopes = joint.linearised(at.x, plain)
    parts = [[s.by] for s in slopes]
    places = [[s.at] for s in slopes]
    held, numbers = at.x.size, at.x.size
    there = {member.id for member in joint.members}
    for candidate in (c for c in candidates if c.id not in there):
        wider = Joint(joint.lab, joint.flights, (*joint.members, candidate))
        numbers += wider.unknowns.start.size - at.x.size
        added = wider.slopes_of(candidate, absent(wider, at, candidate), plain)
        for k, slope in enumerate(added):
            felt = np.flatnonzero(slope.any(axis=0))
            parts[k].append(slope[:, felt])
            places[k].append(held + felt)
        held += added[0].shape[1]
    design = [Slopes(np.hstack(by), np.concatenate(where), held) for by, where in zip(parts, places, strict=True)]
    # The mean over all numbers: those by which a candidate's form may be off do nothing at no effect.
    ridge = 1e-6 * sum(float(np.sum(d.by**2)) for d in design) / numbers
    square, score = ridge * np.eye(held), np.zeros(held)
    # The rested voltage, where there is one, comes after a flight's samples and is no noise of them.
    flown = [
        (own.until(f.time_s.size), row[: f.time_s.size])
        for own, row, f in zip(design, rows, joint.flights, strict=True)
    ]
    for own, row in flown:
        own.add_square(square)
        score += own.back(row)
    sizes = np.asarray(np.linalg.solve(square, score), dtype=float)
    left = [row - own.along(sizes) for own, row in flown]
    noise = estimated(left, joint.lab.series * _FLOOR_V)
    poor = float(np.clip(joint.lab.voltage_error_v / _USUAL_V, 1.0, MOST_DOUBT)) if joint.lab.identified else 1.0
    return replace(noise, sudden=SUDDEN, doubt=doubt_of_alike(len(left)) * poor)
