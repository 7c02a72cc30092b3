"""What recordings say of a pack before anything is fitted: its capacity, its open-circuit curve, where each begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bhm_service.battery.ocv import MonotoneSpline
from bhm_service.errors import BadInputError
from bhm_service.identification.assess import step_resistance
from bhm_service.identification.curve import LASTING, LASTING_S, built_up, from_rates, from_slow
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.extras import OHM_C, Extras
from bhm_service.identification.families import ChemFamily, CircFamily, Family
from bhm_service.identification.problem import FULL_SOC_SD, Problem, problem_of
from bhm_service.identification.solve import solve
from bhm_service.identification.unseen import BETTER, unseen_error
from bhm_service.units import SECONDS_PER_HOUR

EXACT = 1e-5  # logarithm of a capacity that a recording shares with the model
_EMPTY_V = 3.0  # [V] a cell that a slow discharge left above this was not empty
_NEAR_RATED = 0.9  # a one-C current below this share of the slow charge is not the rated one
_AGED = 0.015  # capacities that differ by more than this were not taken at the same age
_DEEP = 0.5  # of the capacity: a recording that takes out less does not tell it
_SLOW_SCALE_SD, _LOADED_SCALE_SD = 0.05, 0.02
_UNKNOWN_SOC_SD = 0.01  # of a recording that begins under load
_SLOW_CURVE_SD, _RATES_CURVE_SD = 0.004, 0.02  # [V]
_COARSE = 500  # samples of a recording are enough here


@dataclass(frozen=True, slots=True, kw_only=True)
class Premises:
    """What all fits of a pack start from."""

    capacity_c: float
    capacity_sd: float  # as a logarithm
    curve: MonotoneSpline
    curve_sd: float  # [V]
    scale_sd: tuple[float, ...]  # of each recording's own capacity, as a logarithm
    by_loads: bool  # whether from full to empty is what the deepest recording under load took out
    full_v: float | None  # that this one rested at before
    remarks: tuple[str, ...]

    def soc(self, experiment: Experiment) -> tuple[float, float]:
        """State of charge that a recording begins with: mean and standard deviation."""
        rested = experiment.rest_before
        if experiment.kind is Kind.SLOW or self._from_full_to_empty(experiment):
            return 1.0, FULL_SOC_SD
        if rested is None:
            return 1.0, FULL_SOC_SD if experiment.full_at_start else _UNKNOWN_SOC_SD
        grid = np.linspace(0.0, 1.03, 1031)
        volts = np.asarray(self.curve.voltage(grid))
        if self.full_v is not None:  # a curve that loads tell is off by more than two rests are
            volts += self.full_v - float(np.asarray(self.curve.voltage(1.0)))
        return float(np.interp(rested, volts, grid)), FULL_SOC_SD

    def _from_full_to_empty(self, experiment: Experiment) -> bool:
        """Whether it took out the charge that full and empty are apart by definition."""
        return self.by_loads and float(np.max(experiment.charge_c)) > self.capacity_c * (1.0 - EXACT)


def premises_of(experiments: Sequence[Experiment], capacity_ah: float | None) -> Premises:
    """Capacity (paper 7.1: the charge of the slow discharge) and open-circuit curve; ``capacity_ah`` overrules."""
    capacity_c, why = _capacity(experiments, capacity_ah)
    curve, curve_sd, how = _curve(experiments, capacity_c)
    by_loads = capacity_ah is None and not any(e.kind is Kind.SLOW for e in experiments)
    begins = Premises(
        capacity_c=capacity_c,
        capacity_sd=_capacity_sd(experiments, capacity_ah),
        curve=curve,
        curve_sd=curve_sd,
        scale_sd=(EXACT,) * len(experiments),
        by_loads=by_loads,
        full_v=max(experiments, key=lambda e: float(np.max(e.charge_c))).rest_before if by_loads else None,
        remarks=(why, *how),
    )
    return begins if capacity_ah is not None else _of_their_age(begins, experiments)


def _capacity(experiments: Sequence[Experiment], told_ah: float | None) -> tuple[float, str]:
    if told_ah is not None:
        return told_ah * SECONDS_PER_HOUR, f"capacity {told_ah:g} Ah, as told"
    slow = [e for e in experiments if e.kind is Kind.SLOW]
    if not slow:
        most = max(float(np.max(e.charge_c)) for e in experiments)
        return most, (
            f"no slow discharge: state of charge 0 is where {most / SECONDS_PER_HOUR:.3g} Ah have gone out, the most "
            "of any recording"
        )
    out = float(np.max(slow[0].charge_c))
    end_v = float(np.nanmin(slow[0].voltage_v))
    one_c = [float(np.median(e.current_a[e.loaded])) for e in experiments if e.kind is Kind.ONE_C]
    rated = one_c[0] * SECONDS_PER_HOUR if one_c else 0.0
    if end_v > _EMPTY_V and _NEAR_RATED * out < rated < 0.995 * out:
        return rated, (
            f"capacity {rated / SECONDS_PER_HOUR:.4g} Ah, the one-C current for an hour: the slow discharge took out "
            f"{out / SECONDS_PER_HOUR:.4g} Ah but ended at {end_v:.2f} V a cell, which is no agreed end "
            "(--capacity-ah to differ)"
        )
    return out, f"capacity {out / SECONDS_PER_HOUR:.4g} Ah, the charge of the slow discharge (to {end_v:.2f} V a cell)"


def _capacity_sd(experiments: Sequence[Experiment], told_ah: float | None) -> float:
    """How full a full pack is and how empty an empty one; how far rates take it, where nothing is slow."""
    if told_ah is not None:
        return 0.0
    return 2.0**0.5 * FULL_SOC_SD if any(e.kind is Kind.SLOW for e in experiments) else _LOADED_SCALE_SD


def _curve(experiments: Sequence[Experiment], capacity_c: float) -> tuple[MonotoneSpline, float, list[str]]:
    slow = [e for e in experiments if e.kind is Kind.SLOW]
    if slow:
        return from_slow(slow[0], capacity_c), _SLOW_CURVE_SD, []
    if all(e.kind in (Kind.PULSES, Kind.FLIGHT) for e in experiments):
        raise BadInputError(
            experiments[0].label,
            "pulses alone do not tell the open-circuit curve",
            "add a discharge from full to empty: --slow, --one-c or --rate",
        )
    said = "open-circuit curve from discharges under load, carried on to no current: known to some 20 mV a cell"
    return from_rates(experiments, capacity_c, _lasting_ohm(experiments, capacity_c)), _RATES_CURVE_SD, [said]


def _lasting_ohm(experiments: Sequence[Experiment], capacity_c: float) -> float:
    """What a load of minutes drops by, for every ampere [Ohm]: half as much again as it does at once.

    By steps of the current; by what has built up at a recording's first sample under load, where it is logged too
    slowly for steps; by what cells usually have, where none begins at rest.
    """
    found = step_resistance(experiments)
    if found is not None:
        return (1.0 + LASTING) * found[0]
    begun = [ohm for e in experiments if (ohm := _begun_ohm(e)) is not None]
    return float(np.median(begun)) if begun else (1.0 + LASTING) * OHM_C * SECONDS_PER_HOUR / capacity_c


def _begun_ohm(experiment: Experiment) -> float | None:
    """The same by the drop from the rest before a load to its first sample; None where there is none."""
    rested, under = experiment.rest_before, np.flatnonzero(experiment.loaded & experiment.measured)
    if rested is None or not under.size:
        return None
    first = int(under[0])
    drop = (rested - float(experiment.voltage_v[first])) / float(experiment.current_a[first])
    since = float(experiment.time_s[first] - experiment.time_s[first - 1])
    if since > LASTING_S:  # by then a cell has less charge, too
        return None
    return drop / float(built_up(since)) if drop > 0.0 else None


def _of_their_age(begins: Premises, experiments: Sequence[Experiment]) -> Premises:
    """The capacity that the recordings under load have, where it is not that of the slow discharge.

    Cells age between experiments: what is identified is the cell of the later ones. One recording alone cannot tell a
    smaller capacity from slow diffusion, and of several the other capacity has to predict unseen pieces better. More
    than the slow discharge gave is believed where a recording under load took out more: a fit that wants it otherwise
    only makes up for what the model lacks.
    """
    slow = [e.kind is Kind.SLOW for e in experiments]
    if not any(slow):
        free = [EXACT if k == 0 else _LOADED_SCALE_SD for k in range(len(experiments))]
        return replace(begins, scale_sd=tuple(free))
    most = [float(np.max(e.charge_c)) for e in experiments]
    deep = [k for k, out in enumerate(most) if not slow[k] and out > _DEEP * begins.capacity_c]
    if len(deep) < 2:
        return begins
    coarse = tuple(e.thinned(_COARSE) for e in experiments)
    free_scales = replace(begins, scale_sd=tuple(EXACT if is_slow else _LOADED_SCALE_SD for is_slow in slow))
    # A model that does not follow the recordings bends the capacity instead: the one that follows them best is asked.
    fits = [(make, solve(problem_for(make(begins), coarse, free_scales), evaluations=25)) for make in (_circ, _chem)]
    asked, best = min(fits, key=lambda fit: fit[1].cost)
    found = best.values
    scales = np.array([found[f"scale[{k}]"][0, 0] for k in deep])
    shift = float(np.mean(scales))
    if abs(shift) < _AGED or not (np.all(scales > 0.0) or np.all(scales < 0.0)):
        return begins
    if shift > 0.0 and max(most[k] for k in deep) <= max(most[k] for k, is_slow in enumerate(slow) if is_slow):
        return begins
    capacity_c = begins.capacity_c * float(np.exp(shift))
    less = "less" if shift < 0.0 else "more"
    aged = replace(
        begins,
        capacity_c=capacity_c,
        capacity_sd=float(np.hypot(begins.capacity_sd, np.std(scales))),
        scale_sd=tuple(_SLOW_SCALE_SD if is_slow else EXACT for is_slow in slow),
        remarks=(
            *begins.remarks,
            f"{len(deep)} recordings under load fit with {100 * abs(shift):.1f} % {less} capacity than the slow "
            f"discharge gave (another age of the cell?): {capacity_c / SECONDS_PER_HOUR:.4g} Ah is used",
        ),
    )
    before, after = (unseen_error(problem_for(asked(p), coarse, p)).typical for p in (begins, aged))
    return aged if after < BETTER * before else begins


def _circ(premises: Premises) -> Family:
    return CircFamily(
        capacity_c=premises.capacity_c, curve=premises.curve, curve_sd=premises.curve_sd, extras=Extras(slow=True)
    )


def _chem(premises: Premises) -> Family:
    return ChemFamily(capacity_c=premises.capacity_c, curve=premises.curve, curve_sd=premises.curve_sd)


def problem_for(family: Family, experiments: Sequence[Experiment], premises: Premises) -> Problem:
    """The fit of a family to recordings, with what is known of each before."""
    return problem_of(family, experiments, [premises.soc(e) for e in experiments], premises.scale_sd)
