"""From recordings to a battery: the paper's three stages for a start, then everything together.

Slow discharge: capacity, V_0 and the open-circuit curve. One-C: the surface pair, or kinetics and diffusion. Variable
load: the rest. Then all numbers on all recordings.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from bhm_service.battery.battery_file import MODELS, BatteryFile, Joined, ModelName
from bhm_service.battery.chem import Chem
from bhm_service.battery.circ import Circ
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.identification.assess import Assessment, assess, step_resistance
from bhm_service.identification.choice import Progress, choose
from bhm_service.identification.closeness import closeness
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.families import ChemFamily, CircFamily, Family
from bhm_service.identification.one_pack import contradiction, foreign
from bhm_service.identification.premises import EXACT, Premises, premises_of, problem_for
from bhm_service.identification.problem import Problem, problem_of
from bhm_service.identification.solve import Method, Solution, solve
from bhm_service.identification.spread import Spread, likeliest, not_told, spread
from bhm_service.identification.unseen import foretold
from bhm_service.units import Array

Ocv = Literal["auto", "spline", "cubic"]

_COARSE = 500  # samples of a recording where forms are compared
_STRAINED = 5.0  # times what was known of the charge that a recording begins with
_HELPFUL = {Kind.SLOW: "a slow discharge (--slow)", Kind.PULSES: "pulses (--pulses)"}  # to a model that misses
_MISSED_V = 0.025  # of a recording of the fit itself; cells that are followed are within 15 mV
_STAGES = {"one-C": (Kind.ONE_C, Kind.RATE), "variable": (Kind.VARIABLE, Kind.PULSES)}
_DOUBTS = 2  # rounds in which far samples come to count less
_IN_BOTH_FORMS = {"circ": 20, "chem": 7}  # steps more, for what joins beside that which follows steps of a curve
_VOLTAGE_ERROR = (0.003, 0.1)  # [V] what a battery file may claim
_BENCH_V = 0.001  # [V] of a cell: closer than that no two recordings of one are


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What to identify."""

    experiments: tuple[Experiment, ...]
    held_out: tuple[Experiment, ...] = ()
    oracle: bool = False  # fit the held-out recordings as well, to show the best that a model's structure can do
    series: int
    models: tuple[ModelName, ...] = MODELS
    name: str = "pack"
    method: Method = "trf"
    ocv: Ocv = "auto"
    capacity_ah: float | None = None
    source: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelResult:
    """One model's identification."""

    model: ModelName
    cell: Circ | Chem
    joined: tuple[Joined, ...]
    solution: Solution
    spread: Spread
    assessments: tuple[Assessment, ...]
    not_told: tuple[str, ...]
    remarks: tuple[str, ...]
    unseen_v: float  # [V] error on pieces that a fit did not see; NaN where that was not asked
    flying_v: float  # [V] error on a varying load that a fit saw nothing of; NaN where no recording tells

    @property
    def followed(self) -> bool:
        """Whether it follows every recording that it was fitted to."""
        return not _missed(self.assessments)

    @property
    def error_v(self) -> float | None:
        """Error on unseen pieces, no less than benches repeat to and no more than a file may claim; None: not asked."""
        return _claimed(self.unseen_v)

    @property
    def load_error_v(self) -> float | None:
        """Likewise that on a varying load of which nothing was seen; None where no recording tells. [V]"""
        return _claimed(self.flying_v)


def _claimed(volts: float) -> float | None:
    return float(np.clip(volts, _BENCH_V, _VOLTAGE_ERROR[1])) if np.isfinite(volts) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """A battery, and how it was come by."""

    battery: BatteryFile
    results: tuple[ModelResult, ...]
    step_ohm: tuple[float, float, int] | None
    remarks: tuple[str, ...]


def identify(request: Request, progress: Progress = lambda _: None) -> Identified:
    """Identify every model asked for. Raises BadInputError when the recordings cannot be of one pack."""
    thin = tuple(e.without_onset().thinned() for e in request.experiments)
    progress("capacity and open-circuit curve")
    premises = premises_of(thin, request.capacity_ah)
    stranger = contradiction(thin, premises)
    if stranger is not None:
        raise stranger
    results = tuple(_one(model, request, thin, premises, progress) for model in request.models)
    return Identified(
        battery=_battery(request, results, premises.capacity_sd),
        results=results,
        step_ohm=step_resistance(request.experiments),
        remarks=premises.remarks,
    )


def steps(request: Request) -> int:
    """How often `identify` will report progress, at most."""
    per_model = 18 if request.method == "trf" else 5
    return 1 + sum(per_model + bool(request.held_out) + _IN_BOTH_FORMS[model] for model in request.models)


def _one(
    model: ModelName,
    request: Request,
    experiments: tuple[Experiment, ...],
    premises: Premises,
    progress: Progress,
) -> ModelResult:
    start = _family(model, request, premises)
    coarse = tuple(e.thinned(_COARSE) for e in experiments)
    remarks: list[str] = []
    if request.method == "nelder-mead":
        family, unseen, flying = start, float("nan"), float("nan")
        solution = _staged(problem_for(family, experiments, premises), request.method, progress)
    else:
        family, unseen, remarks = choose(start, coarse, premises, any_curve=request.ocv == "auto", progress=progress)
        progress(f"{model}: recordings by the others")
        flying = _flying_v(problem_for(family, coarse, premises))
        first = _staged(problem_for(family, coarse, premises), request.method, progress)
        problem = problem_for(family, experiments, premises)
        progress(f"{model}: from other starts")
        starts = [first.x, *family.elsewhere(problem.unknowns, first.x)]
        rivals = [family.labelled(problem.unknowns, solve(first.problem, starts=[x]).x) for x in starts]
        progress(f"{model}: all together")
        solution = solve(problem, starts=[likeliest(first.problem, rivals)])
        shares = closeness(problem.fitting(solution.x))
        for _ in range(_DOUBTS):
            solution = solve(problem.doubting(solution.x, shares).as_followed(solution.x), starts=[solution.x])
        # Whose time constant is whose is told by little: by all samples, counted as closely as they are followed.
        rivals = [solution.x, *family.exchanged(problem.unknowns, solution.x)]
        solution = min((_named(solution.problem, x) for x in rivals), key=lambda s: s.cost)
    progress(f"{model}: what is left open")
    spread_ = spread(solution)
    assessments = [
        assess(e, misfit, soc)
        for e, (misfit, soc) in zip(solution.problem.experiments, solution.problem.misfits(solution.x), strict=True)
    ]
    stranger = foreign(assessments)
    if stranger is not None:
        raise stranger
    if request.held_out:
        progress(f"{model}: held-out recordings")
        assessments += [
            _held_out(solution, e.without_onset().thinned(6000), premises, request) for e in request.held_out
        ]
    cell = family.finished(solution.values)
    assert isinstance(cell, Circ | Chem)
    remarks += [*_strained(solution, premises), *remarked(model, assessments, {e.kind for e in request.experiments})]
    return ModelResult(
        model=model,
        cell=cell,
        joined=_joined(model, solution, spread_),
        solution=solution,
        spread=spread_,
        assessments=tuple(assessments),
        not_told=tuple(not_told(spread_)),
        remarks=tuple(remarks),
        unseen_v=unseen,
        flying_v=flying,
    )


def _named(problem: Problem, x: Array) -> Solution:
    """Where a fit from ``x`` comes to rest, under the names that are usual."""
    found = solve(problem, starts=[x])
    named = problem.family.labelled(problem.unknowns, found.x)
    return found if named is found.x else solve(problem, starts=[named])


def _flying_v(problem: Problem) -> float:
    """Error on the varying loads, each foretold by the other recordings; NaN where none is or none can be. [V]"""
    varying = [v for k, v in foretold(problem).items() if problem.experiments[k].kind is Kind.VARIABLE]
    return float(np.sqrt(np.mean(np.square(varying)))) if varying else float("nan")


def _family(model: ModelName, request: Request, premises: Premises) -> Family:
    if model == "chem":
        return ChemFamily(capacity_c=premises.capacity_c, curve=premises.curve, curve_sd=premises.curve_sd)
    return CircFamily(
        capacity_c=premises.capacity_c,
        curve=premises.curve,
        curve_sd=premises.curve_sd,
        ocv="cubic" if request.ocv == "cubic" else "spline",
    )


def _staged(problem: Problem, method: Method, progress: Progress) -> Solution:
    """The paper's order: stage by stage on the recordings made for it, the others held."""
    x = problem.unknowns.start
    name = problem.family.name
    for stage, free in problem.family.stages():
        chosen = [e.kind in _STAGES[stage] for e in problem.experiments]
        if any(chosen):
            progress(f"{name}: {stage}")
            used = tuple(u & c for u, c in zip(problem.used, chosen, strict=True))
            x = solve(replace(problem, used=used), method, [x], free=free, evaluations=25).x
    progress(f"{name}: joint")
    return solve(problem, method, [x], evaluations=40)


def _held_out(solution: Solution, experiment: Experiment, premises: Premises, request: Request) -> Assessment:
    """A recording that was not fitted; only the charge that it begins with comes from its own rest."""
    problem = problem_of(solution.problem.family, [experiment], [premises.soc(experiment)], [EXACT])
    x = problem.unknowns.start
    for block in problem.unknowns.blocks:
        if "[" not in block.name:
            x[problem.unknowns.slice_of(block.name)] = solution.x[solution.problem.unknowns.slice_of(block.name)]
    ((misfit, soc),) = problem.misfits(x)
    oracle = solve(problem, starts=[x]).x if request.oracle else None
    best = problem.misfits(oracle)[0][0] if oracle is not None else None
    return assess(experiment, misfit, soc, held_out=True, oracle=best)


def _strained(solution: Solution, premises: Premises) -> list[str]:
    """Recordings that fit only from another charge than their own rest says."""
    unknowns = solution.problem.unknowns
    said = []
    for k, experiment in enumerate(solution.problem.experiments):
        mean, sd = premises.soc(experiment)
        found = float(solution.x[unknowns.slice_of(f"soc[{k}]")][0])
        if abs(found - mean) > _STRAINED * sd:
            said.append(
                f"{experiment.label} fits only as if it had begun at {found:.1%} of charge, not at {mean:.1%}: are all "
                "recordings of one pack, and of one age?"
            )
    return said


def _missed(assessments: Sequence[Assessment]) -> list[Assessment]:
    """Recordings of the fit that it does not follow."""
    return [a for a in assessments if not a.held_out and a.whole.rmse > _MISSED_V]


def remarked(model: ModelName, assessments: Sequence[Assessment], kinds: Set[Kind]) -> list[str]:
    """Those in words, and what of `_HELPFUL` was not among the recordings of these ``kinds``."""
    lacking = [said for kind, said in _HELPFUL.items() if kind not in kinds]
    advice = f"; what helps most: {' and '.join(lacking)}" if lacking else ""
    return [
        f"{model} misses {a.label} by {1e3 * a.whole.rmse:.0f} mV a cell, though it was fitted to it, and is off by as "
        f"much in flight{advice}"
        for a in _missed(assessments)
    ]


# ---- the file -------------------------------------------------------------------------------------------------------


def _battery(request: Request, results: Sequence[ModelResult], capacity_sd: float) -> BatteryFile:
    by_model = {r.model: r for r in results}
    known = [r.error_v for r in results if r.error_v is not None]
    circ, chem = (by_model[m].cell if m in by_model else None for m in MODELS)
    assert circ is None or isinstance(circ, Circ)
    assert chem is None or isinstance(chem, Chem)
    return BatteryFile(
        name=request.name,
        source=request.source,
        series=request.series,
        circ=circ,
        chem=chem,
        joined=tuple(j for r in results for j in r.joined),
        uncertainty=Uncertainty(voltage_error_v=float(np.clip(max(known, default=0.01), *_VOLTAGE_ERROR))),
        sd={r.model: {**parameter_sd(r.solution, r.spread), **_charge_sd(r.cell, capacity_sd)} for r in results},
    )


def _charge_sd(cell: Circ | Chem, capacity_sd: float) -> dict[str, float]:
    """What is known of the capacity, which no fit moves. [C]"""
    if capacity_sd == 0.0:
        return {}
    name, charge = ("c_max", cell.c_max) if isinstance(cell, Circ) else ("q_max", cell.q_max)
    return {name: capacity_sd * float(np.asarray(charge))}


def parameter_sd(solution: Solution, spread_: Spread) -> dict[str, float]:
    """Standard deviations in SI; of what a fit found as a logarithm, times the number."""
    unknowns = solution.problem.unknowns
    found: dict[str, float] = {}
    for block in unknowns.blocks:
        if block.size == 1 and "[" not in block.name:
            k = unknowns.slice_of(block.name).start
            value = float(block.outer(solution.x[k]))
            found[block.name] = spread_.sd(k) * (value if block.log else 1.0)
    return solution.problem.family.parameter_sd(solution.values, found)


def _joined(model: ModelName, solution: Solution, spread_: Spread) -> tuple[Joined, ...]:
    return solution.problem.family.extras.joined(model, solution.values, parameter_sd(solution, spread_))
