"""What the recordings that a pack was identified from show of the errors of a cell model's form.

A model follows its own pack's recordings to some millivolts. What it leaves is no noise: it is there again in every
flight. So the same numbers by which a model may be off in flight are found here by linear regression, in the lab, where
no effect of a catalogue can have a part in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bhm_service.battery.battery_file import BatteryFile
from bhm_service.battery.left_open import LeftOpen, left_open
from bhm_service.discrepancy.abreast import sudden
from bhm_service.discrepancy.fitting import weights
from bhm_service.discrepancy.lab import Lab, followed
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.noise import LASTING_DOUBT, MOST_PHI, SUDDEN, Noise, estimated
from bhm_service.discrepancy.readings import bridged
from bhm_service.identification.curve import LOW_SOC
from bhm_service.identification.experiment import Experiment
from bhm_service.identification.identify import ModelResult
from bhm_service.units import Array, Flags

_FLOOR_V = 3e-4  # [V] of a cell: closer no recording's noise is taken to be known
_METERS_PHI = 0.9  # colour of ten samples, ten seconds at one hertz: the most that a bench's meter has
_LOADS_APART = 2.0  # times, from where on a lag is no error of the curve
_START_SD = 0.002  # of the charge that a recording begins with
_STEP = 1e-4  # of charge, over which a curve's slope is taken
_ROUNDS = 3  # in which noise and numbers tell each other


@dataclass(frozen=True, slots=True)
class Followed:
    """How a model of the cell follows one recording of its identification."""

    experiment: Experiment
    misfit_v: Array  # [V] of a cell, measured minus modelled (T,)
    soc: Array  # (T,)


def with_lab_errors(battery: BatteryFile, results: Sequence[ModelResult]) -> BatteryFile:
    """The battery with what the recordings of its identification leave open of each model's form."""
    found: dict[str, LeftOpen] = {}
    for result in results:
        problem = result.solution.problem
        runs = zip(problem.experiments, problem.misfits(result.solution.x), strict=True)
        lab = lab_of(battery, result.model, None, None)
        left = lab_errors(lab, [Followed(e, -over_v, soc) for e, (over_v, soc) in runs])
        found[result.model] = replace(left, error_v=result.error_v, load_error_v=result.load_error_v)
    return replace(battery, left_open=found)


def lab_errors(lab: Lab, runs: Sequence[Followed]) -> LeftOpen:
    """The errors of form that recordings show, nothing being known of them before but what labs leave open at worst.

    The lag has a share of its own at each charge where that makes the recordings the likelier, and where they are of
    loads so far apart that it is told from an error of the curve.
    """
    shown = _Shown.by(lab.at_worst(by_charge=False), runs)
    if shown.loads_apart > _LOADS_APART:
        by_charge = _Shown.by(lab.at_worst(by_charge=True), runs)
        # What lasts longer is no meter's noise: there the model is off, and the question is by which numbers.
        if by_charge.told(_METERS_PHI).nats > shown.told(_METERS_PHI).nats:
            shown = by_charge
    told = shown.told()
    ends = np.cumsum(list(shown.lab.form_sizes.values()))
    found = np.split(told.x[: ends[-1]], ends[:-1])
    open_ = np.asarray(np.linalg.inv(told.curvature))[: ends[-1], : ends[-1]]
    return left_open(dict(zip(shown.lab.form_sizes, found, strict=True)), open_)


@dataclass(frozen=True, slots=True)
class _Told:
    """The likeliest numbers, and how well recordings tell them."""

    x: Array  # (n,)
    curvature: Array  # (n, n)
    nats: float  # log of how likely the recordings are, whatever the numbers, but for what is the same of all forms


@dataclass(frozen=True, slots=True)
class _Shown:
    """Recordings under a form: its numbers, then the charges that the recordings begin with."""

    lab: Lab
    recordings: list[_Recording]
    expected: Array  # (n,)
    before: Array  # (n, n), curvature of what was known

    @property
    def loads_apart(self) -> float:
        """How many times the load of the gentlest recording the hardest is of; of those that are of any."""
        loads = [r.load_a for r in self.recordings if r.load_a > 0.0]
        return max(loads) / min(loads) if loads else 1.0

    @classmethod
    def by(cls, lab: Lab, runs: Sequence[Followed]) -> _Shown:
        """The recordings that show anything, under the form of ``lab``."""
        mean, covariance = lab.form
        before = np.eye(mean.size + len(runs))
        before[: mean.size, : mean.size] = np.linalg.inv(covariance)
        expected = np.zeros(len(before))
        expected[: mean.size] = mean
        return cls(lab, _recordings(lab, runs, mean.size), expected, before)

    def told(self, most_phi: float = MOST_PHI) -> _Told:
        """What they tell, where their noise is coloured by ``most_phi`` at most."""
        noise, x, curvature, nats = Noise.at_first(self.lab.series), self.expected, self.before, 0.0
        for _ in range(_ROUNDS if self.recordings else 0):
            doubted = replace(noise, doubt=LASTING_DOUBT, sudden=SUDDEN)
            curvature, score, nats = self.before.copy(), np.zeros(x.size), 0.0
            for recording in self.recordings:
                off, slopes = recording.whitened(x, doubted)
                counted = weights(off)
                off = off + (x - self.expected) @ slopes
                curvature += (slopes * counted) @ slopes.T
                score += (slopes * counted) @ off
                nats -= 0.5 * float(counted @ off**2) + recording.log_scale(doubted) / LASTING_DOUBT
            moved = np.asarray(np.linalg.solve(curvature, score))
            nats += 0.5 * float(score @ moved) - 0.5 * float(_log_det(curvature) - _log_det(self.before))
            x = self.expected + moved
            noise = estimated([r.left(x)[r.known] for r in self.recordings], self.lab.series * _FLOOR_V, most_phi)
        return _Told(x, curvature, nats)


def _log_det(matrix: Array) -> float:
    return float(np.linalg.slogdet(matrix)[1])


@dataclass(frozen=True, slots=True)
class _Recording:
    """What the model leaves of one recording's voltage [V], and what one of each number would add to the model's."""

    misfit: Array  # (T,)
    shapes: Array  # (numbers, T)
    known: Flags  # samples that are looked at
    sudden_v: Array  # (T,)
    load_a: float  # [A] as charge goes out, by the charge

    def left(self, x: Array) -> Array:
        """What numbers (n,) leave."""
        return np.asarray(self.misfit - x @ self.shapes)

    def whitened(self, x: Array, noise: Noise) -> tuple[Array, Array]:
        """That in standard deviations of the noise, and the shapes likewise, where it is looked at."""
        white = noise.whitened(np.vstack([self.left(x), self.shapes]), noise.beside(self.sudden_v))[:, self.known]
        return white[0], white[1:]

    def log_scale(self, noise: Noise) -> float:
        """Sum over samples of the log of the volts that a whitened one stands for."""
        return float(np.sum(np.log(noise.scale_v * noise.beside(self.sudden_v))[self.known]))


def _recordings(lab: Lab, runs: Sequence[Followed], form: int) -> list[_Recording]:
    found = []
    for k, run in enumerate(runs):
        known = run.experiment.measured & (run.soc >= LOW_SOC)
        if not known.any():
            continue
        time_s, current_a = run.experiment.time_s, run.experiment.current_a
        shapes = np.zeros((form + len(runs), time_s.size))
        shapes[:form] = lab.added(followed(time_s, current_a), current_a, run.soc)[:form]
        shapes[form + k] = lab.series * _START_SD * lab.slope_v(run.soc, _STEP)
        misfit = bridged(lab.series * run.misfit_v, known)
        # Of the whole drop: what a double layer has within a second comes at once to a recording of one hertz.
        found.append(
            _Recording(misfit, shapes, known, lab.ohm * lab.series * sudden(current_a), _load_a(run.experiment))
        )
    return found


def _load_a(experiment: Experiment) -> float:
    """The mean over the charge that goes out: rests count for nothing. [A]"""
    out = np.clip(experiment.current_a[1:], 0.0, None)
    charge = out * np.diff(experiment.time_s)
    return float(charge @ out / max(float(charge.sum()), 1e-300))
