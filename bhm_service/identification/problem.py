"""One fit: a family of cells, the recordings that it is to follow, and the residuals of many candidates in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bhm_service.battery.cell import CellModel, Modifiers
from bhm_service.battery.effects.base import Conditions, Effect
from bhm_service.battery.pack import PackModel, Simulation
from bhm_service.identification.closeness import Fitting
from bhm_service.identification.curve import LOW_SOC
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.families import Family
from bhm_service.identification.unknowns import Unknowns, joined, numbers
from bhm_service.units import Array, Flags, Value

SIGMA_V = 0.004  # [V] what a cell model is first expected to follow; the fit finds out how well it really does
_SAMPLES_PER_S = 0.1  # independent voltages: neighbouring residuals say the same thing
_FEWEST, _MOST = 60.0, 400.0
_LOW_WEIGHT = 0.2  # of what is below `LOW_SOC`
_SLOPE_SPAN = np.linspace(0.0, 1.0, 101)
_LEAST_SLOPE_V, _SLOPE_SD_V = 0.02, 0.01  # [V per unit of charge] a curve falls by at least this
_SLOPE_REACH = 0.005  # of charge, to either side, over which a curve's slope is taken
_FAR = 2.0  # times the usual misfit: from here on a sample is doubted
_SHARED = -1  # a number that every recording depends on
STEP = 1e-5  # of finite differences, in the fit's own numbers
FULL_SOC_SD = 0.003  # of a recording that begins rested and full
_MOST_LASTING = 0.98  # correlation of neighbours: what lasts longer than a recording shows is not told from it
_FINEST = 20.0  # times as finely as was expected: no bench knows a cell's voltage to less than 0.2 mV


class _Scale(Effect):
    """A recording's own capacity: cells age between recordings."""

    def __init__(self, log_scale: Array) -> None:
        self._by = Modifiers(capacity=np.exp(log_scale))

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        return self._by


@dataclass(frozen=True)
class Problem:
    """Recordings and a family; ``used`` tells, for each recording, the samples that the fit may look at."""

    family: Family
    experiments: tuple[Experiment, ...]
    used: tuple[Flags, ...]
    soc_prior: tuple[tuple[float, float], ...]  # of each recording's first sample: mean and standard deviation
    scale_sd: tuple[float, ...]  # how far each recording's capacity may be from the family's, as a logarithm
    trust: tuple[Array, ...] = ()  # in each sample, where a fit found that no cell model follows some of them

    @cached_property
    def unknowns(self) -> Unknowns:
        """The cell's, its effects', and the state of charge that each recording begins with."""
        starts = [
            numbers(f"soc[{k}]", np.array([mean]), sd, min(10.0 * sd, 0.5))
            for k, (mean, sd) in enumerate(self.soc_prior)
        ]
        scales = [numbers(f"scale[{k}]", np.array([0.0]), sd, 8.0 * sd) for k, sd in enumerate(self.scale_sd)]
        return joined(self.family.blocks(), self.family.extras.blocks(self.family.ohm), starts, scales)

    def residuals(self, x: Array) -> Array:
        """Weighted residuals and pulls (M, R) of candidates (M, n), in standard deviations."""
        unknowns = self.unknowns
        values = unknowns.values(x)
        parts = [self._weighted(k, self._run(k, values)) for k in range(len(self.experiments))]
        return np.concatenate([*parts, unknowns.pulls(x), _monotone(self.family.cell(values))], axis=1)

    def linearised(self, x: Array, columns: np.ndarray) -> tuple[Array, Array]:
        """Residuals (R,) of one candidate (n,) and their derivatives (R, C) by the numbers ``columns`` (C,).

        By differences. Numbers that shape the curve alone are not simulated: the curve is read where the run reads
        it. What a recording begins with moves no other recording.
        """
        unknowns = self.unknowns
        owner, shaping = self._owners[columns], self._shaping[columns]
        points = x + STEP * np.eye(x.size)[columns]
        shapes = self.family.cell(unknowns.values(np.vstack([x, points[shaping]])))
        rows, slopes = [], []
        for k, (used, weight) in enumerate(zip(self.used, self.weights, strict=True)):
            slope = np.zeros((columns.size, int(used.sum())))
            if not slope.shape[1]:
                rows.append(slope[0])
                slopes.append(slope)
                continue
            simulated = ~shaping & ((owner == _SHARED) | (owner == k))
            run = self._run(k, unknowns.values(np.vstack([x, points[simulated]])))
            off = self._weighted(k, run)
            slope[simulated] = (off[1:] - off[0]) / STEP
            place = self.family.read_at(tuple(state[:1] for state in run.states))[..., used]
            bent = _open_circuit(shapes, place)
            slope[shaping] = (bent[1:] - bent[0]) / STEP * (_trusted(run.soc[0]) * weight)[used]
            rows.append(off[0])
            slopes.append(slope)
        short = _monotone(shapes)
        slope = np.zeros((columns.size, short.shape[1]))
        slope[shaping] = (short[1:] - short[0]) / STEP
        pulls = unknowns.pulls(np.vstack([x, points]))
        slopes += [(pulls[1:] - pulls[0]) / STEP, slope]
        return np.concatenate([*rows, pulls[0], short[0]]), np.concatenate(slopes, axis=1).T

    @cached_property
    def _owners(self) -> np.ndarray:
        """The recording that each number belongs to alone."""
        return np.concatenate([np.full(b.size, _owner(b.name)) for b in self.unknowns.blocks])

    @cached_property
    def _shaping(self) -> Flags:
        """Which numbers shape the curve alone."""
        return np.array([b.name in self.family.shaping for b in self.unknowns.blocks for _ in range(b.size)])

    def _weighted(self, k: int, run: Simulation) -> Array:
        """Residuals (M, used) of one recording's run."""
        off = (run.voltage - self.experiments[k].voltage_v) * _trusted(run.soc) * self.weights[k]
        return np.asarray(off[:, self.used[k]])

    def misfits(self, x: Array) -> list[tuple[Array, Array]]:
        """Modelled minus measured voltage [V] and state of charge along every recording, for one candidate (n,)."""
        values = self.unknowns.values(x)
        runs = [self._run(k, values) for k in range(len(self.experiments))]
        return [(run.voltage[0] - e.voltage_v, run.soc[0]) for run, e in zip(runs, self.experiments, strict=True)]

    def _run(self, k: int, values: dict[str, Array]) -> Simulation:
        """One recording simulated, (M, T)."""
        experiment = self.experiments[k]
        effects = [*self.family.extras.effects(values), _Scale(values[f"scale[{k}]"])]
        pack = PackModel(self.family.cell(values), 1, 1.0, effects)
        run = pack.simulate(experiment.time_s, experiment.current_a, values[f"soc[{k}]"], experiment.temperature_k)
        shape = (next(iter(values.values())).shape[0], experiment.time_s.size)
        return replace(run, voltage=np.broadcast_to(run.voltage, shape), soc=np.broadcast_to(run.soc, shape))

    @cached_property
    def weights(self) -> list[Array]:
        """Of every sample's residual: what it counts, over what it is expected to be. [1/V]"""
        found = []
        trust = self.trust or (1.0,) * len(self.experiments)
        for experiment, used, trusted in zip(self.experiments, self.used, trust, strict=True):
            count = independent(experiment)
            share = experiment.weights() * used
            total = float(share.sum())
            each = np.sqrt(share / max(total, 1e-300) * count * float(used.mean()) ** 0.5) / SIGMA_V
            found.append(np.asarray(each * trusted))
        return found

    def fitting(self, x: Array) -> list[Fitting]:
        """How the candidate ``x`` (n,) fits the samples that the fit looks at, recording by recording."""
        values = self.unknowns.values(x)
        cell = self.family.cell(values)
        found = []
        for k, (experiment, used) in enumerate(zip(self.experiments, self.used, strict=True)):
            run = self._run(k, values)
            around = run.soc + np.array([[-_SLOPE_REACH], [0.0], [_SLOPE_REACH]])
            below, here, above = (_open_circuit(cell, soc[None, :])[0] for soc in around)
            found.append(
                Fitting(
                    misfit_v=run.voltage[0] - experiment.voltage_v,
                    drop_v=here - run.voltage[0],
                    slope_v=(above - below) / (2.0 * _SLOPE_REACH),
                    weight=experiment.weights() * used,
                )
            )
        return found

    def doubting(self, x: Array, shares: Sequence[Array] = ()) -> Problem:
        """The same with less trust in samples that the candidate ``x`` is far from, by the spread of the others.

        Spikes, and pulses beyond what the model's structure can follow, would otherwise bend all numbers. ``shares``:
        how closely each sample can be followed, relative to the closest.
        """
        trust = []
        close = shares or tuple(np.ones(e.time_s.size) for e in self.experiments)
        for (misfit, _), share in zip(self.misfits(x), close, strict=True):
            off = np.abs(misfit * share)
            usual = max(1.48 * float(np.nanmedian(off)), SIGMA_V)
            trust.append(np.asarray(share / np.sqrt(1.0 + (np.nan_to_num(off) / (_FAR * usual)) ** 2)))
        return replace(self, trust=tuple(trust))

    def as_followed(self, x: Array) -> Problem:
        """The same with recordings counted as closely as the candidate ``x`` follows them all, at least as expected.

        Counted as expected only, priors would pull harder than they are known: by standard deviations of the result.
        That a slow discharge begins full keeps its say: it tells where on the charge the curve lies, and nothing else
        does.
        """
        ends = np.cumsum([int(used.sum()) for used in self.used])
        own = np.split(self.residuals(x)[0], ends)[:-1]
        common = sum(power(residual) * residual.size for residual in own) / ends[-1]
        finer = float(np.clip(common**-0.5, 1.0, _FINEST))
        trust = self.trust or tuple(np.ones(e.time_s.size) for e in self.experiments)
        begins = tuple(
            (mean, sd / finer if e.kind is Kind.SLOW else sd)
            for (mean, sd), e in zip(self.soc_prior, self.experiments, strict=True)
        )
        return replace(self, trust=tuple(finer * t for t in trust), soc_prior=begins)

    @property
    def data_rows(self) -> int:
        """How many of the residuals are of recordings; pulls follow them."""
        return int(sum(used.sum() for used in self.used))


def _open_circuit(cells: CellModel, soc: Array) -> Array:
    """Open-circuit voltages of every candidate (M, T)."""
    return np.atleast_2d(np.asarray(cells.open_circuit(soc)))


def _monotone(cells: CellModel) -> Array:
    """What a curve that does not fall is punished with (M, rows)."""
    slope = np.diff(_open_circuit(cells, _SLOPE_SPAN), axis=1) * (_SLOPE_SPAN.size - 1)
    short: Array = np.minimum(slope - _LEAST_SLOPE_V, 0.0) / _SLOPE_SD_V
    return short


def _trusted(soc: Array) -> Array:
    """How much a cell model is trusted at a state of charge."""
    return np.where(soc < LOW_SOC, _LOW_WEIGHT, 1.0)


def _owner(name: str) -> int:
    """The recording that a block belongs to alone."""
    return int(name[name.index("[") + 1 : -1]) if "[" in name else _SHARED


def independent(experiment: Experiment) -> float:
    """How many independent voltages a recording is worth in a fit."""
    span = float(experiment.time_s[-1] - experiment.time_s[0])
    return min(max(span * _SAMPLES_PER_S, _FEWEST), _MOST)


def power(residual: Array) -> float:
    """Mean square of residuals, times how many of them say the same thing: one where they are as was expected."""
    return max(float(np.mean(residual**2)) * lasting(residual), 1e-300)


def lasting(residual: Array) -> float:
    """By how much the variance of a mean of these is larger than if they were independent."""
    centred = residual - residual.mean()
    whole = float(centred @ centred)
    if whole <= 0.0 or residual.size < 10:
        return 1.0
    lag_one = float(centred[1:] @ centred[:-1]) / whole
    lag_one = min(max(lag_one, 0.0), _MOST_LASTING)
    return (1.0 + lag_one) / (1.0 - lag_one)


def problem_of(
    family: Family,
    experiments: Sequence[Experiment],
    soc_prior: Sequence[tuple[float, float]],
    scale_sd: Sequence[float],
) -> Problem:
    """All samples with a voltage are looked at."""
    measured = tuple(e.measured for e in experiments)
    return Problem(family, tuple(experiments), measured, tuple(soc_prior), tuple(scale_sd))
