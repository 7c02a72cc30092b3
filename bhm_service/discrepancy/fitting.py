"""Fitting a hypothesis to its flights: maximum a posteriori, and the evidence for it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Generic, Protocol

import numpy as np
from typing_extensions import TypeVar

from bhm_service.discrepancy.exactness import Exactness, exactness
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.slopes import Slopes, parted
from bhm_service.identification.unknowns import Unknowns
from bhm_service.units import Array, Flags

_CLOSE, _CLOSE_SHARE = 0.1, 0.03  # of the cost, and of what it is beyond its aim: smaller gains end a fit
_DAMPING, _EASED, _LEAST_DAMPING = 1e-3, 1e-4, 1e-6  # at first, before it is raised, and at last; of the curvature
_POOR = 0.25  # of what a step was expected to gain
_TRIES = 6  # of a step, each shorter than the one before
_FAR = 3.0  # standard deviations: beyond, an innovation counts by its size, not by its square


class Problem(Protocol):
    """What a hypothesis has to say for a fit: `Joint` of the battery, and the demand's own."""

    @property
    def unknowns(self) -> Unknowns:
        """Everything that is looked for."""
        ...

    @property
    def scale(self) -> Array:
        """Standard deviation of what was known before, of every number."""
        ...

    @property
    def known(self) -> Array:
        """Curvature of half the cost by what was known before, in those standard deviations."""
        ...

    def pulls(self, x: Array) -> Array:
        """What the vector costs by what was known before; its square is the cost."""
        ...

    def leaning(self, x: Array) -> tuple[float, Array]:
        """Half of what the vector costs besides, and the slopes of that in those standard deviations."""
        ...

    def residuals(self, x: Array, noise: Noise) -> list[Array]:
        """For each flight whitened residuals (N,)."""
        ...

    def linearised(self, x: Array, noise: Noise) -> tuple[list[Array], list[Slopes]]:
        """For each flight whitened residuals (N,) and their slopes by the vector in standard deviations."""
        ...


ProblemT = TypeVar("ProblemT", bound=Problem, default=Joint)


@dataclass(frozen=True, slots=True)
class Bare:
    """What a fit of flights found without the flights: little enough to go from one process to another."""

    lean: Mapping[str, float]
    x: Array
    cost: float
    rows: list[Array]
    curvature: Array
    gradient: Array

    def on(self, joint: Joint, noise: Noise) -> Fitted:
        """The fit, of the hypothesis that was fitted with this noise."""
        joint = replace(joint, lean=self.lean)
        return Fitted(joint, noise, self.x, self.cost, self.rows, self.curvature, self.gradient)


def bulk(rows: Sequence[Array]) -> float:
    """Huber's sum over innovations: squares near zero, straight lines beyond."""
    return sum(float(np.sum(huber(row))) for row in rows)


def huber(row: Array) -> Array:
    """What each innovation of a row counts there."""
    size = np.abs(row)
    return np.asarray(np.where(size <= _FAR, size**2, 2.0 * _FAR * size - _FAR**2))


def weights(row: Array, far: float = _FAR) -> Array:
    """Weight of each innovation in the normal equations; from ``far`` standard deviations on it counts by its size."""
    return np.asarray(np.minimum(1.0, far / np.maximum(np.abs(row), 1e-12)))


@dataclass(frozen=True)
class Fitted(Generic[ProblemT]):
    """A hypothesis at its best."""

    joint: ProblemT
    noise: Noise
    x: Array
    cost: float  # without what its sizes lean by: that is no part of the evidence
    rows: list[Array]
    curvature: Array  # of half the cost, by the vector in standard deviations of the prior
    gradient: Array  # likewise, and of what its sizes lean by

    @cached_property
    def slopes(self) -> list[Slopes]:
        """Of every flight; made when they are asked for, since most fits are only compared by their evidence."""
        return self.joint.linearised(self.x, self.noise)[1]

    @cached_property
    def known_curvature(self) -> Array:
        """The curvature with every residual at its full weight."""
        total = self.joint.known.copy()
        for slope in self.slopes:
            slope.add_square(total)
        return total

    @cached_property
    def free(self) -> Flags:
        """Which numbers of the vector do not stand at a bound beyond which the flights would have them; (n,)."""
        return ~_at_bound(self.joint.unknowns, self.x, self.gradient)

    def back(self, series: Array) -> Array:
        """The slopes of all flights, transposed, times series of residuals (N, k); (n, k)."""
        parts = zip(parted(series, self.slopes), self.slopes, strict=True)
        return np.asarray(sum(slope.back(own.T) for own, slope in parts)).T

    def along(self, steps: Array) -> Array:
        """What steps of the vector (n, k) do to the residuals of all flights; (N, k)."""
        return np.concatenate([slope.along(steps) for slope in self.slopes])

    @cached_property
    def weighted(self) -> Array:
        """The innovations of all flights, each times its weight."""
        row = np.concatenate(self.rows)
        return np.asarray(weights(row) * row)

    @property
    def size(self) -> int:
        """Number of residuals."""
        return sum(r.size for r in self.rows)

    @cached_property
    def misfit(self) -> float:
        """Mean squared innovation, far ones by their size: one where the noise explains all."""
        return bulk(self.rows) / self.size

    @property
    def bare(self: Fitted[Joint]) -> Bare:
        """What it found, without its flights."""
        return Bare(self.joint.lean, self.x, self.cost, self.rows, self.curvature, self.gradient)

    def into(self: Fitted[Joint], joint: Joint, names: Iterable[str]) -> Array:
        """A hypothesis's vector (n,): as found of these blocks, where both have them, all else as known before."""
        x = joint.unknowns.start.copy()
        for name in names:
            if name in joint.places and name in self.joint.places:
                x[joint.places[name]] = self.x[self.joint.places[name]]
        return x

    def evidence(self: Fitted[Joint], inflation: float) -> float:
        """Laplace's approximation of the log evidence, but for what all hypotheses on these flights share. [nats]

        Each member may be off as usual or hardly at all. ``inflation`` of the noise's variance has to be the same for
        all that are compared.
        """
        return -0.5 * self.cost / inflation - 0.5 * self._volume + self._exactness.nats(inflation)

    @cached_property
    def _exactness(self: Fitted[Joint]) -> Exactness:
        found = self.joint.unknowns.pulls(self.x)[0]
        return exactness(self.curvature, self.joint.known, found, self.joint.forms)

    @cached_property
    def _volume(self) -> float:
        """Twice the log of what was known before over what is known now."""
        return float(np.linalg.slogdet(self.curvature)[1] - np.linalg.slogdet(self.joint.known)[1])

    @property
    def covariance(self) -> Array:
        """Of the vector, in its own numbers."""
        scale = self.joint.scale
        inverse = np.linalg.inv(self.curvature)
        return np.asarray(inverse * np.outer(scale, scale))

    def sd(self, name: str) -> Array:
        """Standard deviations of a block."""
        where = self.joint.unknowns.slice_of(name)
        return np.asarray(np.sqrt(np.diag(self.covariance)[where]))


def one_step(information: Array, score: Array) -> tuple[Array, float]:
    """Sizes (n,) of numbers with a prior of one and their evidence [nats], by one linear step from none of them.

    ``information`` (n, n) and ``score`` (n,) are those of the residuals, all else free.
    """
    posterior = information + np.eye(score.size)
    sizes = np.linalg.solve(posterior, score)
    return np.asarray(sizes), float(0.5 * score @ sizes - 0.5 * np.linalg.slogdet(posterior)[1])


def fit(
    joint: ProblemT,
    noise: Noise,
    start: Array | None = None,
    rounds: int = 30,
    moving: Collection[str] | None = None,
    aim: float | None = None,
) -> Fitted[ProblemT]:
    """Maximum a posteriori by damped Gauss-Newton inside the bounds.

    The damping follows how much of what a step was expected to gain it does gain (Nielsen 1999, IMM-REP-1999-05).
    ``moving`` names the blocks that move. What is far from the cost ``aim``, by default that of noise alone, is not
    looked at closely: it will not be the answer.
    """
    return _descended(joint, noise, start, rounds, moving, aim, partial(joint.linearised, noise=noise))


def moved(joint: Joint, noise: Noise, start: Array, moving: Collection[str], rounds: int = 30) -> Array:
    """The vector (n,) of such a `fit`, sooner: nothing is learnt of the blocks that stand still."""
    linearised = partial(joint.linearised, noise=noise, moving=moving)
    return _descended(joint, noise, start, rounds, moving, None, linearised).x


def _descended(
    joint: ProblemT,
    noise: Noise,
    start: Array | None,
    rounds: int,
    moving: Collection[str] | None,
    aim: float | None,
    linearised: Callable[[Array], tuple[list[Array], list[Slopes]]],
) -> Fitted[ProblemT]:
    """As `fit`, by the slopes that ``linearised`` makes."""
    unknowns = joint.unknowns
    still = np.zeros(unknowns.start.size, dtype=bool)
    for block in unknowns.blocks if moving is not None else ():
        still[unknowns.slice_of(block.name)] = block.name not in (moving or ())
    low, high, scale = unknowns.low, unknowns.high, joint.scale
    x = np.clip(unknowns.start if start is None else start, low, high)
    rows, slopes = linearised(x)
    cost = _cost(joint, x, rows)
    curvature, gradient = _curvature(joint, rows, slopes), _gradient(joint, x, rows, slopes)
    damping, slow = _DAMPING, False
    for taken in range(rounds):
        held = still | _at_bound(unknowns, x, gradient)
        enough = _CLOSE + _CLOSE_SHARE * max(cost - (sum(r.size for r in rows) if aim is None else aim), 0.0)
        gain, harder = -1.0, 2.0
        for _ in range(_TRIES):
            matrix = curvature + damping * np.diag(np.diag(curvature))
            step = _boxed_step(matrix, gradient, (low - x) / scale, (high - x) / scale, held)
            trial = np.clip(x + scale * step, low, high)
            expected = -float(2.0 * gradient @ step + step @ curvature @ step)
            gain = cost - cost_of(joint, trial, noise)
            if gain > 0.0 or expected < enough:
                break
            damping, harder = max(damping, _EASED) * harder, 2.0 * harder
        if gain <= 0.0:
            break
        x, cost = trial, cost - gain
        rows, slopes = linearised(x)
        curvature, gradient = _curvature(joint, rows, slopes), _gradient(joint, x, rows, slopes)
        share = gain / max(expected, gain * _LEAST_DAMPING)
        damping = max(damping * max(0.2, 1.0 - (2.0 * share - 1.0) ** 3), _LEAST_DAMPING)
        # One poor step, after which the next is shorter, is no end. Nor is the first: what joins at no effect has no
        # form by which it may be off until it is there.
        if gain < enough and taken and (slow or share > _POOR):
            break
        slow = gain < enough
    cost -= 2.0 * joint.leaning(x)[0]
    return Fitted(joint=joint, noise=noise, x=x, cost=cost, rows=rows, curvature=curvature, gradient=gradient)


def _at_bound(unknowns: Unknowns, x: Array, gradient: Array) -> Flags:
    """Which numbers stand at a bound and would go on beyond it."""
    return np.asarray(((x <= unknowns.low) & (gradient > 0.0)) | ((x >= unknowns.high) & (gradient < 0.0)))


def _boxed_step(matrix: Array, gradient: Array, low: Array, high: Array, held: Flags) -> Array:
    """The least of step.gradient + step.matrix.step / 2 from ``low`` to ``high``, those that are held at none.

    What meets its bound first on the way stops there, and the others make up for it.
    """
    step, free = np.zeros(gradient.size), ~held
    while free.any():
        pull = gradient[free] + matrix[np.ix_(free, ~free)] @ step[~free]
        own = -np.linalg.solve(matrix[np.ix_(free, free)], pull)
        at = np.flatnonzero(free)
        bound = np.where(own > 0.0, high[at], low[at])
        beyond = np.flatnonzero(np.abs(own) > np.abs(bound))
        step[at] = own
        if not beyond.size:
            break
        first = beyond[np.argmin(np.abs(bound[beyond] / own[beyond]))]
        step[at[first]] = bound[first]
        free[at[first]] = False
    return step


def cost_of(joint: Problem, x: Array, noise: Noise) -> float:
    """What a fit makes as small as it can: Huber's sum over the flights, and what was known before."""
    return _cost(joint, x, joint.residuals(x, noise))


def nearest(joint: Joint, tried: Sequence[Array], noise: Noise) -> Array:
    """The vector that costs least of some that may be far from each other."""
    rows = joint.each_residuals(np.stack(tried), noise)
    return tried[int(np.argmin([_cost(joint, x, own) for x, own in zip(tried, rows, strict=True)]))]


def _cost(joint: Problem, x: Array, rows: Sequence[Array]) -> float:
    return bulk(rows) + float(np.sum(joint.pulls(x) ** 2)) + 2.0 * joint.leaning(x)[0]


def _gradient(joint: Problem, x: Array, rows: Sequence[Array], slopes: Sequence[Slopes]) -> Array:
    total = joint.known @ joint.unknowns.pulls(x)[0] + joint.leaning(x)[1]
    for row, slope in zip(rows, slopes, strict=True):
        total = total + slope.back(weights(row) * row)
    return np.asarray(total)


def _curvature(joint: Problem, rows: Sequence[Array], slopes: Sequence[Slopes]) -> Array:
    total = joint.known.copy()
    for row, slope in zip(rows, slopes, strict=True):
        slope.add_square(total, weights(row))
    return total
