"""All flights under one hypothesis: the model run along every flight for many candidate vectors at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from bhm_service.battery.effects.base import Effect
from bhm_service.battery.pack import PackModel, Simulation
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.lab import BEND_SOC, Lab, LabError, lagging
from bhm_service.discrepancy.noise import Noise
from bhm_service.identification.unknowns import Block, Unknowns, joined, numbers
from bhm_service.units import Array

FULL_SD, GAUGE_SD, GENERIC_SD = (
    0.01,
    0.02,
    0.05,
)  # of the state of charge at the start: charged full, by a gauge, guessed
_REST_SD_V = 0.002  # of a cell, beside what the open-circuit curve is known to
_STEP = 1e-3  # of finite differences, in standard deviations of what was known before
_STARTS = "start_soc"

Places: TypeAlias = NDArray[np.intp]

# No equation of the catalogue is exact. What a member adds to the voltage may be off by these shares: from flight to
# flight, over the state of charge, in how it grows with the load, and in how fast it follows it. A second effect has
# to beat that.
_FORM_FLIGHT_SD, _FORM_SOC_SD, _FORM_LOAD_SD, _FORM_LAG_SD = 0.08, 0.12, 0.3, 0.2
_FORM_SOC = np.array([0.15, 0.4, 0.65, 0.95])
_FORM_LAG_S = (10.0, 60.0)


@dataclass(frozen=True, slots=True)
class Predicted:
    """One flight under a hypothesis, for some vectors."""

    voltage: Array  # [V] (M, T)
    rested: Array | None  # [V] (M, 1)
    soc: Array  # (T,) of the first vector
    places: Places  # which numbers of the vector only add to the voltage
    added: Array  # [V] what one of each of them adds (numbers, T)


@dataclass(frozen=True)
class Joint:
    """A hypothesis over flights: the lab's errors, each flight's start and the members' unknowns in one vector."""

    lab: Lab
    flights: tuple[FlightData, ...]
    members: tuple[Candidate, ...] = ()
    start_sd: tuple[float, ...] = field(default=())  # per flight; by what is known of its start where not given

    @cached_property
    def unknowns(self) -> Unknowns:
        """Everything that is looked for."""
        mean = np.array([1.0 if f.reading is None else f.reading for f in self.flights])
        sd = np.array(self.start_sd or [self._start_sd(f) for f in self.flights])
        starts = Block(
            name=_STARTS, start=mean, low=np.full(mean.size, 0.02), high=np.full(mean.size, 1.06), prior=mean, sd=sd
        )
        members = [b for c in self.members for b in c.blocks(len(self.flights))]
        forms = [b for c in self.members for b in self._form_blocks(c.id)]
        return joined(self.lab.blocks(), [starts], members, self.lab.additions(), forms)

    @cached_property
    def _adding(self) -> frozenset[str]:
        """Blocks that only add to the voltage: their derivatives need no run."""
        forms = [b.name for c in self.members for b in self._form_blocks(c.id)]
        return frozenset([b.name for b in self.lab.additions()] + forms)

    def _form_blocks(self, name: str) -> list[Block]:
        return [
            _about_zero(f"form_flight.{name}", len(self.flights), _FORM_FLIGHT_SD),
            _about_zero(f"form_soc.{name}", _FORM_SOC.size, _FORM_SOC_SD),
            _about_zero(f"form_load.{name}", 1, _FORM_LOAD_SD),
            _about_zero(f"form_lag.{name}", len(_FORM_LAG_S), _FORM_LAG_SD),
        ]

    def _start_sd(self, flight: FlightData) -> float:
        return FULL_SD if flight.reading is None else GAUGE_SD

    @cached_property
    def per_flight(self) -> frozenset[str]:
        """Blocks that hold one number for every flight."""
        own = {u.name for c in self.members for u in c.unknowns if u.per_flight}
        return frozenset({_STARTS} | own | {f"form_flight.{c.id}" for c in self.members})

    @cached_property
    def _columns(self) -> list[np.ndarray]:
        """For each flight, the numbers of the vector that it depends on."""
        found = []
        for k in range(len(self.flights)):
            used: list[int] = []
            for block in self.unknowns.blocks:
                if block.name in self._adding:
                    continue
                where = self.unknowns.slice_of(block.name)
                used += [where.start + k] if block.name in self.per_flight else range(where.start, where.stop)
            found.append(np.array(used))
        return found

    @cached_property
    def scale(self) -> Array:
        """Standard deviation of what was known before, of every number."""
        return np.concatenate([b.sd for b in self.unknowns.blocks])

    def effects(self, x: Array, flight: int) -> list[Effect]:
        """All effects of one flight for vectors (M, n)."""
        values = self.unknowns.values(x)
        return [
            *self.lab.effects,
            LabError(values),
            *(e for c in self.members for e in c.effects(values, flight)),
        ]

    def pack(self, x: Array, flight: int) -> PackModel:
        """The pack of one flight for vectors (M, n)."""
        return PackModel(self.lab.cell, self.lab.series, self.lab.parallel, self.effects(x, flight))

    def simulated(self, x: Array, flight: int) -> Simulation:
        """One flight for vectors (M, n)."""
        data = self.flights[flight]
        pack = self.pack(x, flight)
        start = self.unknowns.values(x)[_STARTS][:, flight : flight + 1]
        return pack.simulate(data.time_s, data.current_a, start, data.temperature_k)

    def without(self, x: Array, name: str) -> Array:
        """A vector (n,) with one member's effect taken away."""
        bare = x.copy()
        for member in self.members:
            for u in member.amplitudes() if member.id == name else ():
                assert u.declared.absent is not None
                bare[self.unknowns.slice_of(u.name)] = np.log(u.declared.absent) if u.log else u.declared.absent
        return bare

    def shares(self, x: Array) -> list[list[Array]]:
        """What each member adds to the voltage of each flight [V], and by which shapes that may be off (rows, T)."""
        found = []
        for k, data in enumerate(self.flights):
            whole = self.simulated(x[None, :], k)
            own = []
            for member in self.members:
                added = whole.voltage[0] - self.simulated(self.without(x, member.id)[None, :], k).voltage[0]
                place = np.interp(whole.soc[0], _FORM_SOC, np.arange(_FORM_SOC.size, dtype=float))
                hats = np.maximum(1.0 - np.abs(place - np.arange(_FORM_SOC.size)[:, None]), 0.0)
                usual = float(np.mean(np.abs(data.current_a))) + 1e-9
                light = added * np.clip(1.0 - np.abs(data.current_a) / usual, -1.0, 1.0)
                late = [lagging(data.time_s, added, tau) - added for tau in _FORM_LAG_S]
                own.append(np.vstack([added, added * hats, light, *late]))
            found.append(own)
        return found

    def additions(self, x: Array, flight: int, soc: Array, shares: Sequence[Array]) -> tuple[Places, Array]:
        """Which numbers of the vector only add to a flight's voltage, and what one of each adds [V]; (numbers, T)."""
        data = self.flights[flight]
        rows = [self.lab.added(data.time_s, data.current_a, soc)]
        places = [np.arange(*self._span(b.name)) for b in self.lab.additions()]
        for member, shapes in zip(self.members, shares, strict=False):
            for block in self._form_blocks(member.id):
                where = np.arange(*self._span(block.name))
                places.append(where[flight : flight + 1] if block.name in self.per_flight else where)
            rows.append(shapes)
        found = np.concatenate(places)
        return (found, np.concatenate(rows)) if len(shares) else (found[: rows[0].shape[0]], rows[0])

    def _span(self, name: str) -> tuple[int, int]:
        where = self.unknowns.slice_of(name)
        return where.start, where.stop

    def predicted(self, x: Array, flight: int, shares: Sequence[Array] = ()) -> Predicted:
        """One flight's voltages for vectors (M, n), and the voltage rested after it where the sidecar has one.

        What only adds is taken along the first vector's charge: the others differ from it by steps of differences.
        """
        run = self.simulated(x, flight)
        soc = run.soc[0] if run.soc.ndim > 1 else run.soc
        places, rows = self.additions(x[0], flight, soc, shares)
        voltage = run.voltage + x[:, places] @ rows
        notes = self.flights[flight].notes
        rested = None
        if notes.rest_voltage_v is not None:
            bends = x[:, places[: BEND_SOC.size]] @ rows[: BEND_SOC.size, -1:]
            rested = self._rested(x, flight, run, notes.rest_s) + bends
        return Predicted(voltage, rested, soc, places, rows)

    def _rested(self, x: Array, flight: int, run: Simulation, rest_s: float) -> Array:
        """After landing the pack is unplugged: nothing flows, and another meter reads it."""
        data = self.flights[flight]
        effects = self.effects(x, flight)
        plain = self.pack(x, flight)
        kept = [
            e
            for e in effects
            if type(e).true_current is Effect.true_current and type(e).measured_voltage is Effect.measured_voltage
        ]
        pack = PackModel(self.lab.cell, self.lab.series, self.lab.parallel, kept)
        names = dict(zip(plain.state_names, run.states, strict=True))
        columns = np.broadcast_shapes(*(np.shape(names[n])[:-1] for n in pack.state_names))
        ends = np.stack([np.broadcast_to(names[n][..., -1], columns) for n in pack.state_names], axis=-1)
        kelvin = None if data.temperature_k is None else float(data.temperature_k[-1])
        rested = pack.step(ends[:, None, :], rest_s, 0.0, 0.0, kelvin)
        return np.asarray(pack.voltage(rested, 0.0, kelvin))

    def residuals(self, x: Array, flight: int, noise: Noise, shares: Sequence[Array] = ()) -> Array:
        """Whitened measured minus modelled voltages (M, T), the rested one last where there is one."""
        return self._whitened(self.predicted(np.atleast_2d(x), flight, shares), flight, noise)

    def _whitened(self, modelled: Predicted, flight: int, noise: Noise) -> Array:
        data = self.flights[flight]
        misfit = data.voltage_v - modelled.voltage
        known = np.isfinite(data.voltage_v)
        if not known.all():
            places = np.arange(known.size)
            misfit = np.array([np.interp(places, places[known], row[known]) for row in misfit])
        white = noise.whitened(misfit)
        if not known.all():
            white[:, ~known] = 0.0
        if modelled.rested is None:
            return white
        assert data.notes.rest_voltage_v is not None
        return np.concatenate([white, (data.notes.rest_voltage_v - modelled.rested) / self._rest_sd_v], axis=1)

    @property
    def _rest_sd_v(self) -> float:
        return self.lab.series * _REST_SD_V

    def misfits(self, x: Array) -> list[Array]:
        """Measured minus modelled voltage [V] of every flight, NaN where it was not measured; by the equations."""
        return [f.voltage_v - self.predicted(x[None, :], k).voltage[0] for k, f in enumerate(self.flights)]

    def linearised(self, x: Array, noise: Noise, shares: Sequence[Sequence[Array]]) -> tuple[list[Array], list[Array]]:
        """Whitened residuals of every flight, and their derivatives (rows, n) by the vector in standard deviations."""
        rows, slopes = [], []
        for k, used in enumerate(self._columns):
            points = np.tile(x, (used.size + 1, 1))
            steps = self._steps(x)[used]
            points[np.arange(1, used.size + 1), used] += steps
            modelled = self.predicted(points, k, shares[k])
            found = self._whitened(modelled, k, noise)
            slope = np.zeros((found.shape[1], x.size))
            slope[:, used] = ((found[1:] - found[0]) / (steps / self.scale[used])[:, None]).T
            places, added = modelled.places, modelled.added
            slope[: added.shape[1], places] = -noise.whitened(added).T * self.scale[places]
            if found.shape[1] > added.shape[1]:
                bends = places[: BEND_SOC.size]
                slope[-1, bends] = -added[: BEND_SOC.size, -1] * self.scale[bends] / self._rest_sd_v
            unseen = ~np.isfinite(self.flights[k].voltage_v)
            slope[: unseen.size][unseen] = 0.0
            rows.append(found[0])
            slopes.append(slope)
        return rows, slopes

    def _steps(self, x: Array) -> Array:
        """Steps of the differences, turned round at an upper bound."""
        step = _STEP * self.scale
        return np.where(x + step > self.unknowns.high, -step, step)

    def cost(self, x: Array, noise: Noise, shares: Sequence[Sequence[Array]]) -> tuple[list[Array], float]:
        """Residuals alone, and what `fit` minimises."""
        rows = [self.residuals(x[None, :], k, noise, shares[k])[0] for k in range(len(self.flights))]
        return rows, bulk(rows) + float(np.sum(self.pulls(x) ** 2))

    def pulls(self, x: Array) -> Array:
        """How far a vector is from what was known before, number by number and of their sums."""
        single = self.unknowns.pulls(x)[0]
        return np.concatenate([single, self.ties @ single])

    @cached_property
    def ties(self) -> Array:
        """What the lab knows of sums of numbers."""
        return self.lab.ties(self.unknowns)

    @cached_property
    def known(self) -> Array:
        """Curvature of what was known before, by the vector in its standard deviations."""
        return np.asarray(np.eye(self.scale.size) + self.ties.T @ self.ties)


_FAR = 3.0  # standard deviations: beyond, an innovation counts by its size, not by its square


def bulk(rows: Sequence[Array]) -> float:
    """Huber's sum over innovations: squares near zero, straight lines beyond."""
    total = 0.0
    for row in rows:
        size = np.abs(row)
        total += float(np.sum(np.where(size <= _FAR, size**2, 2.0 * _FAR * size - _FAR**2)))
    return total


def weights(row: Array) -> Array:
    """Weight of each innovation in the normal equations."""
    return np.asarray(np.minimum(1.0, _FAR / np.maximum(np.abs(row), 1e-12)))


@dataclass(frozen=True)
class Fitted:
    """A hypothesis at its best."""

    joint: Joint
    noise: Noise
    x: Array
    cost: float
    rows: list[Array]
    slopes: list[Array]
    curvature: Array  # of half the cost, by the vector in standard deviations of the prior

    @property
    def size(self) -> int:
        """Number of residuals."""
        return sum(r.size for r in self.rows)

    @property
    def misfit(self) -> float:
        """Mean squared innovation, far ones by their size: one where the noise explains all."""
        return bulk(self.rows) / self.size

    def evidence(self, inflation: float) -> float:
        """Laplace's approximation of the log evidence, but for what all hypotheses on these flights share. [nats]

        ``inflation`` of the noise's variance has to be the same for all that are compared.
        """
        return float(-0.5 * self.cost / inflation - 0.5 * np.linalg.slogdet(self.curvature)[1])

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


def fit(
    joint: Joint, noise: Noise, start: Array | None = None, rounds: int = 12, moving: Sequence[str] | None = None
) -> Fitted:
    """Maximum a posteriori by damped Gauss-Newton inside the bounds; ``moving`` names the blocks that move."""
    unknowns = joint.unknowns
    still = np.zeros(unknowns.start.size, dtype=bool)
    for block in unknowns.blocks if moving is not None else ():
        still[unknowns.slice_of(block.name)] = block.name not in (moving or ())
    low, high, scale = unknowns.low, unknowns.high, joint.scale
    x = np.clip(unknowns.start if start is None else start, low, high)
    shares = joint.shares(x)
    rows, slopes = joint.linearised(x, noise, shares)
    cost = bulk(rows) + float(np.sum(joint.pulls(x) ** 2))
    damping = 1e-3
    curvature = _curvature(joint, rows, slopes)
    for _ in range(rounds):
        gradient = sum(s.T @ (weights(r) * r) for s, r in zip(slopes, rows, strict=True))
        gradient = gradient + joint.known @ unknowns.pulls(x)[0]
        held = still | ((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0))
        accepted = False
        for _ in range(6):
            matrix = curvature + damping * np.diag(np.diag(curvature))
            free = ~held
            step = np.zeros(x.size)
            step[free] = -np.linalg.solve(matrix[np.ix_(free, free)], gradient[free])
            trial = np.clip(x + scale * step, low, high)
            _, trial_cost = joint.cost(trial, noise, shares)
            if trial_cost < cost:
                accepted = True
                break
            damping = max(damping, 1e-4) * 10.0
        if not accepted:
            break
        gain = cost - trial_cost
        x = trial
        damping = max(damping * 0.2, 1e-6)
        shares = joint.shares(x)
        rows, slopes = joint.linearised(x, noise, shares)
        cost = bulk(rows) + float(np.sum(joint.pulls(x) ** 2))
        curvature = _curvature(joint, rows, slopes)
        if gain < 0.02 + 1e-5 * cost:
            break
    return Fitted(joint=joint, noise=noise, x=x, cost=cost, rows=rows, slopes=slopes, curvature=curvature)


def _curvature(joint: Joint, rows: Sequence[Array], slopes: Sequence[Array]) -> Array:
    total = joint.known.copy()
    for row, slope in zip(rows, slopes, strict=True):
        total += slope.T @ (weights(row)[:, None] * slope)
    return np.asarray(total)


def _about_zero(name: str, size: int, sd: float) -> Block:
    return numbers(name, np.zeros(size), sd, 5.0 * sd)
