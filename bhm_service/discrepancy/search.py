"""Which sets of effects the flights support: a beam over sets, each refitted in full, compared by evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.fitting import Fitted, fit
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.noise import Noise, estimated
from bhm_service.discrepancy.steps import contact_candidate, episodes
from bhm_service.units import Array, Flags

NATS = 10.0  # that a member of a set has to earn against the best set without it
NEAR = 6.0  # [nats] within which two explanations cannot be told apart
# What a model of a cell gets wrong by its structure looks like these. So they have to earn more before they are
# called physics of this pack.
STRUCTURAL = frozenset(
    {"ocv-shape", "resistance-shape", "slow-diffusion", "charge-transfer", "hysteresis", "rate-capacity"}
)
_STRUCTURAL_NATS = 30.0
LEAST_SNR = 3.0  # below, these recordings cannot show an effect of the usual size
_WIDTH, _DEPTH, _EXPANSIONS = 3, 3, 4
# What a model gets wrong it gets wrong alike in all flights of a kind: they are not independent witnesses of it.
_WITNESSES, _MOST_DOUBT = 1.0 / 3.0, 3.0
_FLOOR_V = 5e-4  # [V] of a cell: no voltage is measured better than this

Progress = Callable[[str], None]
Names = frozenset[str]


def needed(name: str) -> float:
    """What a member has to earn. [nats]"""
    return _STRUCTURAL_NATS if name in STRUCTURAL else NATS


@dataclass(slots=True)
class Search:
    """Fits of sets of candidates on the same flights and noise, each made once."""

    base: Joint
    candidates: tuple[Candidate, ...]
    noise: Noise
    snr: dict[str, float] = field(default_factory=dict)  # expected of each candidate at its usual size
    fits: dict[Names, Fitted] = field(default_factory=dict)

    def fitted(self, names: Names, start: Fitted | None = None) -> Fitted:
        """The fit of a set, begun from a smaller set's where one is given."""
        if names not in self.fits:
            joint = self.joint(names)
            self.fits[names] = fit(joint, self.noise, _carried(joint, start))
        return self.fits[names]

    def joint(self, names: Names) -> Joint:
        """The hypothesis of a set."""
        members = tuple(c for c in self.candidates if c.id in names)
        return Joint(self.base.lab, self.base.flights, members, self.base.start_sd)

    def gains(self, names: Names) -> dict[str, float]:
        """What each other candidate is expected to add to a set's evidence, by one linear step. [nats]"""
        at = self.fitted(names)
        return {c.id: _linear_gain(at, self.joint(names | {c.id}), c) for c in self.candidates if c.id not in names}

    @property
    def inflation(self) -> float:
        """Of the noise's variance, so that the best fit is as good as the noise says."""
        return max(1.0, min(f.misfit for f in self.fits.values()))

    def evidence(self, names: Names) -> float:
        """Of a set, against none. [nats]"""
        by = self.inflation
        price = sum(c.price for c in self.candidates if c.id in names)
        return self.fitted(names).evidence(by) - self.fitted(frozenset()).evidence(by) - price

    def ranked(self) -> list[Names]:
        """All sets, the best first."""
        return sorted(self.fits, key=lambda names: -self.evidence(names))

    def earned(self, names: Names) -> dict[str, float]:
        """Evidence that each member adds to the others. [nats]"""
        whole = self.fitted(names)
        for m in names:
            self.fitted(names - {m}, whole)
        return {m: self.evidence(names) - self.evidence(names - {m}) for m in names}


def _carried(joint: Joint, start: Fitted | None) -> Array:
    """A start for a set: what another set's fit found, where both have it."""
    x = joint.unknowns.start.copy()
    if start is not None:
        known = {b.name: start.x[start.joint.unknowns.slice_of(b.name)] for b in start.joint.unknowns.blocks}
        for block in joint.unknowns.blocks:
            if block.name in known:
                x[joint.unknowns.slice_of(block.name)] = known[block.name]
    return x


def _absent(joint: Joint, start: Fitted, candidate: Candidate) -> Array:
    """The smaller set's fit with the candidate added at no effect."""
    x = _carried(joint, start)
    for u in candidate.amplitudes():
        assert u.declared.absent is not None
        x[joint.unknowns.slice_of(u.name)] = np.log(u.declared.absent) if u.log else u.declared.absent
    return x


@dataclass(frozen=True, slots=True)
class Geometry:
    """A candidate's numbers at no effect, all others free; in standard deviations of its prior."""

    score: Array
    information: Array
    directions: Array  # (rows, numbers) in whitened residuals: the score is these times the residuals


def candidate_geometry(at: Fitted, joint: Joint, candidate: Candidate) -> Geometry:
    """Score and information of a candidate added to a fit."""
    x = _absent(joint, at, candidate)
    rows, slopes = joint.linearised(x, at.noise)
    slope = np.vstack(slopes)
    curvature = slope.T @ slope
    new = _new(joint, candidate)
    old = ~new
    nuisance = curvature[np.ix_(old, old)] + joint.known[np.ix_(old, old)]
    across = np.linalg.solve(nuisance, curvature[np.ix_(old, new)])
    directions = -(slope[:, new] - slope[:, old] @ across)
    information = curvature[np.ix_(new, new)] - curvature[np.ix_(new, old)] @ across
    return Geometry(directions.T @ np.concatenate(rows), information, directions)


def _linear_gain(at: Fitted, joint: Joint, candidate: Candidate) -> float:
    found = candidate_geometry(at, joint, candidate)
    posterior = found.information + np.eye(found.score.size)
    # Effects at their typical size, not at none: the pull of the prior is left out of the expectation.
    gain = 0.5 * found.score @ np.linalg.solve(posterior, found.score)
    return float(gain - 0.5 * np.linalg.slogdet(posterior)[1])


def _new(joint: Joint, candidate: Candidate) -> Flags:
    """The numbers of a vector that a candidate brings."""
    own = {u.name for u in candidate.unknowns}
    new = np.zeros(joint.unknowns.start.size, dtype=bool)
    for block in joint.unknowns.blocks:
        if block.name in own or (block.name.startswith("form_") and block.name.endswith(f".{candidate.id}")):
            new[joint.unknowns.slice_of(block.name)] = True
    return new


def expected_snr(at: Fitted, joint: Joint, candidate: Candidate) -> float:
    """Standard deviations by which the candidate at its usual size would stand out of noise and lab errors."""
    information = candidate_geometry(at, joint, candidate).information
    names = [n for n, new in zip(joint.unknowns.names, _new(joint, candidate), strict=True) if new]
    size = np.zeros(len(names))
    for u in candidate.amplitudes():
        assert u.declared.absent is not None
        mean, sd = u.prior
        usual = (mean - u.declared.absent) / sd if mean != u.declared.absent else 1.0
        size[[k for k, name in enumerate(names) if name.split("[")[0] == u.name]] = usual
    return float(np.sqrt(max(float(size @ information @ size), 0.0)))


def saturated_noise(at: Fitted, candidates: Sequence[Candidate]) -> Noise:
    """Noise of what is left when everything that any candidate could explain is taken out of a fit's residuals."""
    joint = at.joint
    plain = Noise(0.0, 0.0, 1.0)
    columns: list[list[Array]] = [[] for _ in joint.flights]
    rows: list[Array] = []
    for candidate in (None, *(c for c in candidates if c not in joint.members)):
        wider = joint if candidate is None else Joint(joint.lab, joint.flights, (*joint.members, candidate))
        x = at.x if candidate is None else _absent(wider, at, candidate)
        found, slopes = wider.linearised(x, plain)
        if candidate is None:
            rows = found
        for k, slope in enumerate(slopes):
            columns[k].append(slope if candidate is None else slope[:, _new(wider, candidate)])
    design = np.vstack([np.hstack(c) for c in columns])
    weight = np.concatenate([np.full(r.size, 1.0) for r in rows])
    lengths = [f.time_s.size for f in joint.flights]
    for k, row in enumerate(rows):
        if row.size > lengths[k]:
            weight[sum(r.size for r in rows[:k]) + lengths[k]] = 0.0
    ridge = np.full(design.shape[1], 1e-6 * float(np.trace(design.T @ design)) / design.shape[1])
    left = np.concatenate(rows) - design @ np.linalg.solve(
        design.T @ (weight[:, None] * design) + np.diag(ridge), design.T @ (weight * np.concatenate(rows))
    )
    at_row = np.cumsum([0, *(r.size for r in rows)])
    parts = [left[at_row[k] : at_row[k] + lengths[k]] for k in range(len(rows))]
    noise = estimated(parts, joint.lab.series * _FLOOR_V)
    return replace(noise, doubt=float(np.clip(_WITNESSES * len(parts), 1.0, _MOST_DOUBT)))


def search(base: Joint, candidates: Sequence[Candidate], progress: Progress = lambda _: None) -> Search:
    """All sets worth comparing, fitted; the noise is taken again once the largest effects are known."""
    start = fit(base, Noise(0.98, 0.8, base.lab.series * 0.002))
    noise = saturated_noise(start, candidates)
    progress("one effect at a time")
    found = Search(base, tuple(candidates), noise)
    at = found.fitted(frozenset(), start)
    found.snr = {c.id: expected_snr(at, found.joint(frozenset({c.id})), c) for c in candidates}
    found.candidates = tuple(c for c in candidates if found.snr[c.id] > LEAST_SNR or c.inferred)
    _grow(found, depth=1, progress=progress)
    best = found.fits[found.ranked()[0]]
    steps = episodes(best)
    contacts = [contact_candidate(steps, len(base.flights))] if steps else []
    everything = (*found.candidates, *contacts)
    noise = saturated_noise(best, everything)
    progress("sets of effects")
    # An effect that is part of the answer is in the fit already; what is still pulled is the model's own error.
    pulls = best.joint.unknowns.pulls(best.x)[0]
    wider = replace(base, lab=base.lab.widened(lambda name: pulls[best.joint.places[name]]))
    again = Search(wider, everything, noise, found.snr)
    again.fitted(frozenset(), found.fits[frozenset()])
    for names in found.ranked()[: 2 * _WIDTH]:
        again.fitted(names, found.fits[names])
    _grow(again, depth=_DEPTH, progress=progress)
    return again


def _grow(found: Search, depth: int, progress: Progress) -> None:
    beam: list[Names] = [frozenset()]
    for size in range(depth):
        tried: set[Names] = set()
        for place, names in enumerate(beam):
            gains = found.gains(names)
            order = sorted(gains, key=lambda name: -gains[name])
            # What is likely to be part of the answer is tried with everything, the rest with what looks best.
            for name in order if place == 0 and size < _DEPTH - 1 else order[:_EXPANSIONS]:
                tried.add(names | {name})
                found.fitted(names | {name}, found.fitted(names))
        progress(f"sets of {size + 1}")
        beam = sorted(tried, key=lambda names: -found.evidence(names))[:_WIDTH]
        if not beam or found.evidence(beam[0]) < max(map(found.evidence, found.fits)) or found.evidence(beam[0]) < NATS:
            break
