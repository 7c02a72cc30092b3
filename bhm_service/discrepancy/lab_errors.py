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
from bhm_service.discrepancy.lab import FORM, Lab, followed, lab_of
from bhm_service.discrepancy.noise import SUDDEN, Noise, estimated
from bhm_service.discrepancy.readings import bridged
from bhm_service.identification.curve import LOW_SOC
from bhm_service.identification.experiment import Experiment
from bhm_service.identification.identify import ModelResult
from bhm_service.units import Array, Flags

_FLOOR_V = 3e-4  # [V] of a cell: closer no recording's noise is taken to be known
_DOUBT = 8.0  # times a variance: what a model leaves lasts longer than any colour that its noise is given
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
        found[result.model] = lab_errors(lab, [Followed(e, -over_v, soc) for e, (over_v, soc) in runs])
    return replace(battery, left_open=found)


def lab_errors(lab: Lab, runs: Sequence[Followed]) -> LeftOpen:
    """The errors of form that recordings show, nothing being known of them before but what labs leave open at worst."""
    lab = lab.at_worst()
    mean, covariance = lab.form
    recordings = _recordings(lab, runs, mean.size)
    # After the form come the charges that the recordings begin with.
    before = np.eye(mean.size + len(runs))
    before[: mean.size, : mean.size] = np.linalg.inv(covariance)
    expected = np.zeros(len(before))
    expected[: mean.size] = mean
    noise, x, curvature = Noise(0.98, 0.8, lab.series * 0.002), expected, before
    for _ in range(_ROUNDS if recordings else 0):
        doubted = replace(noise, doubt=_DOUBT, sudden=SUDDEN)
        curvature, score = before.copy(), before @ expected
        for recording in recordings:
            off, slopes = recording.whitened(x, doubted)
            weighted = slopes * weights(off)
            curvature += weighted @ slopes.T
            score += weighted @ (off + x @ slopes)
        x = np.asarray(np.linalg.solve(curvature, score))
        noise = estimated([r.left(x)[r.known] for r in recordings], lab.series * _FLOOR_V)
    found = np.split(x[: mean.size], np.cumsum(list(FORM.values()))[:-1])
    open_ = np.asarray(np.linalg.inv(curvature))[: mean.size, : mean.size]
    return left_open(dict(zip(FORM, found, strict=True)), open_)


@dataclass(frozen=True, slots=True)
class _Recording:
    """What the model leaves of one recording's voltage [V], and what one of each number would add to the model's."""

    misfit: Array  # (T,)
    shapes: Array  # (numbers, T)
    known: Flags  # samples that are looked at
    sudden_v: Array  # (T,)

    def left(self, x: Array) -> Array:
        """What numbers (n,) leave."""
        return np.asarray(self.misfit - x @ self.shapes)

    def whitened(self, x: Array, noise: Noise) -> tuple[Array, Array]:
        """That in standard deviations of the noise, and the shapes likewise, where it is looked at."""
        white = noise.whitened(np.vstack([self.left(x), self.shapes]), noise.beside(self.sudden_v))[:, self.known]
        return white[0], white[1:]


def _recordings(lab: Lab, runs: Sequence[Followed], form: int) -> list[_Recording]:
    found = []
    for k, run in enumerate(runs):
        known = run.experiment.measured & (run.soc >= LOW_SOC)
        if not known.any():
            continue
        time_s, current_a = run.experiment.time_s, run.experiment.current_a
        shapes = np.zeros((form + len(runs), time_s.size))
        shapes[:form] = lab.added(followed(time_s, current_a), current_a, run.soc)[:form]
        shapes[form + k] = lab.series * _START_SD * _slope(lab, run.soc)
        misfit = bridged(lab.series * run.misfit_v, known)
        # Of the whole drop: what a double layer has within a second comes at once to a recording of one hertz.
        found.append(_Recording(misfit, shapes, known, lab.ohm * lab.series * sudden(current_a)))
    return found


def _slope(lab: Lab, soc: Array) -> Array:
    """Of the open-circuit curve. [V]"""
    ends = [np.asarray(lab.cell.open_circuit(np.clip(soc + step, 0.0, 1.0))) for step in (-_STEP, _STEP)]
    return np.asarray((ends[1] - ends[0]) / (2.0 * _STEP))
