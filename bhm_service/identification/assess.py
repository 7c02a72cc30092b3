"""How good an identified cell is: its voltage error, where it lies, and the resistance that a step shows by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bhm_service.identification.experiment import Experiment
from bhm_service.units import Array, Flags

ABOVE_SOC = 0.10  # what is quoted: below, no two cells are alike
_SOC_EDGES = (0.0, 0.1, 0.25, 0.5, 0.75, 1.01)
_STEP_SHARE = 0.3  # of the largest current: a change this large within two samples is a step
_STEP_S = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Error:
    """A voltage error over some samples. [V]"""

    rmse: float
    bias: float  # modelled minus measured
    samples: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Assessment:
    """One recording against a model."""

    label: str
    kind: str
    held_out: bool
    whole: Error  # above SoC 0.1
    oracle: Error | None  # the same after a fit to this recording alone: the best that the model's structure can do
    by_soc: tuple[tuple[str, Error], ...]
    by_current: tuple[tuple[str, Error], ...]
    experiment: Experiment
    modelled_v: Array
    soc: Array


def assess(
    experiment: Experiment, misfit: Array, soc: Array, *, held_out: bool = False, oracle: Array | None = None
) -> Assessment:
    """Errors of a modelled recording, ``misfit`` being modelled minus measured [V], ``oracle`` that of the best fit."""
    good = experiment.measured
    above = good & (soc > ABOVE_SOC)
    amps = np.abs(experiment.current_a)
    most = float(amps.max())
    bands = [("rest", ~experiment.loaded), ("to half", experiment.loaded & (amps <= 0.5 * most))]
    bands.append(("above half", amps > 0.5 * most))
    return Assessment(
        label=experiment.label,
        kind=experiment.kind.value,
        held_out=held_out,
        whole=error(misfit, above),
        oracle=None if oracle is None else error(oracle, above),
        by_soc=tuple(
            (f"SoC {low:.0%}-{min(high, 1.0):.0%}", error(misfit, good & (soc >= low) & (soc < high)))
            for low, high in pairwise(_SOC_EDGES)
        ),
        by_current=tuple((name, error(misfit, above & where)) for name, where in bands),
        experiment=experiment,
        modelled_v=experiment.voltage_v + misfit,
        soc=soc,
    )


def error(misfit: Array, where: Flags) -> Error:
    """RMSE and bias where asked; NaN where there is nothing."""
    chosen = misfit[where]
    if chosen.size == 0:
        return Error(rmse=float("nan"), bias=float("nan"), samples=0)
    return Error(rmse=float(np.sqrt(np.mean(chosen**2))), bias=float(np.mean(chosen)), samples=int(chosen.size))


def step_resistance(experiments: Sequence[Experiment]) -> tuple[float, float, int] | None:
    """Resistance that the steps of the current show: median, spread [Ohm] and how many there were.

    The drop within a few seconds of a step over the step itself: no model in it. The paper names it as future work
    (section 6.1): an independent check of the identified resistance.
    """
    found: list[float] = []
    for experiment in experiments:
        t, i, v = experiment.time_s, experiment.current_a, experiment.voltage_v
        most = float(np.max(np.abs(i)))
        for k in np.flatnonzero(np.abs(np.diff(i)) > _STEP_SHARE * most):
            if t[k + 1] - t[k] > _STEP_S or not (np.isfinite(v[k]) and np.isfinite(v[k + 1])):
                continue
            found.append(float(-(v[k + 1] - v[k]) / (i[k + 1] - i[k])))
    positive = [r for r in found if r > 0.0]
    if not positive:
        return None
    quartiles = np.quantile(positive, (0.25, 0.75))
    return float(np.median(positive)), float(quartiles[1] - quartiles[0]) / 1.35, len(positive)
