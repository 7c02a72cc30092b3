"""Flights alone: a known kind of cell, scaled and bent until it follows them, as far as they tell.

No flight begins and ends at a known state of charge. So the cell starts from the battery file that ships, with the
spreads of its [uncertainty], and what the flights do not tell stays as wide as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from bhm_service.battery.battery_file import BatteryFile, ModelName
from bhm_service.battery.cell import CellModel
from bhm_service.battery.chem import Chem
from bhm_service.battery.circ import Circ
from bhm_service.battery.ocv import MonotoneSpline
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.errors import BadInputError
from bhm_service.identification.assess import Assessment, assess, step_resistance
from bhm_service.identification.choice import Progress
from bhm_service.identification.curve import KNOTS, carried_on, rising
from bhm_service.identification.experiment import Experiment
from bhm_service.identification.identify import Identified, ModelResult, Request, parameter_sd
from bhm_service.identification.one_pack import FOREIGN_V, foreign
from bhm_service.identification.premises import EXACT
from bhm_service.identification.problem import SIGMA_V, Problem, independent, problem_of
from bhm_service.identification.scaled import Known, ScaledChem, ScaledCirc, ScaledFamily
from bhm_service.identification.solve import Solution, solve
from bhm_service.identification.spread import not_told, spread
from bhm_service.units import SECONDS_PER_HOUR, Array

_RESTED_SOC_SD, _UNKNOWN_SOC = 0.05, (0.8, 0.2)
_OVERFULL = 1.03  # a known curve that a rested pack is beyond by more is another chemistry's
_MOST_FULL = 1.3  # times the charge of a known curve, that a pack may be full at
_SPOILS = 0.6  # of the others' error without it: a flight that spoils the fit of the others more is of another pack
_FEWEST_TO_JUDGE = 4  # flights: of fewer, which one is the stranger is not known
_DOUBTS = 2
_STRAINED = 3.0  # times what is known of the curve
_LASTING = 12.0  # independent voltages in a flight: some stretches of its curve, at rest and under load
_SPREAD = (0.05, 0.5)  # what a battery file says of its scales: the next flight is never just like these


def identify_flights(
    request: Request, known: BatteryFile, capacity_sd: float, progress: Progress = lambda _: None
) -> Identified:
    """Adapt a known battery to flights.

    ``request.capacity_ah`` is what is known of the capacity before, ``capacity_sd`` how well (of its logarithm).
    """
    if request.capacity_ah is None:
        raise BadInputError("flights", "some capacity has to be known before", "answer with --capacity-ah")
    thin = tuple(e.thinned() for e in request.experiments)
    results = tuple(_one(model, request, known, capacity_sd, thin, progress) for model in request.models)
    return Identified(
        battery=_battery(request, known, results),
        results=results,
        step_ohm=step_resistance(request.experiments),
        remarks=tuple(_remarks(request, known, capacity_sd, results)),
    )


def _one(
    model: ModelName,
    request: Request,
    known: BatteryFile,
    capacity_sd: float,
    experiments: tuple[Experiment, ...],
    progress: Progress,
) -> ModelResult:
    assert request.capacity_ah is not None
    cell = known.cell(model)
    joined = tuple(j for j in known.joined if j.model in (None, model))
    curve = _reaching(cell, experiments)
    make: Callable[..., ScaledFamily] = ScaledCirc if model == "circ" else ScaledChem
    family = make(
        known=cell,
        capacity_c=request.capacity_ah * SECONDS_PER_HOUR,
        capacity_sd=capacity_sd,
        curve=curve,
        curve_sd=known.uncertainty.voltage_error_v,
        uncertainty=known.uncertainty,
        extras=Known(effects_known=joined),
    )

    def followed(flights: Sequence[Experiment]) -> tuple[Solution, tuple[Assessment, ...]]:
        progress(f"{model}: {len(flights)} flights together")
        begins = [_begin(e, np.asarray(curve.voltage(_SOC))) for e in flights]
        problem = problem_of(family, flights, begins, [EXACT] * len(flights))
        solution = _solved(problem, known.uncertainty.voltage_error_v)
        misfits = problem.misfits(solution.x)
        return solution, tuple(assess(e, misfit, soc) for e, (misfit, soc) in zip(flights, misfits, strict=True))

    remarks: list[str] = []
    solution, assessments = followed(experiments)
    while (worst := _worst(assessments)) is not None:
        if len(experiments) < _FEWEST_TO_JUDGE:
            stranger = foreign(assessments)
            if stranger is not None:
                raise stranger
            break
        others = tuple(e for k, e in enumerate(experiments) if k != worst)
        without = followed(others)
        before = np.median([a.whole.rmse for k, a in enumerate(assessments) if k != worst])
        if np.median([a.whole.rmse for a in without[1]]) > _SPOILS * before and foreign(assessments) is None:
            remarks.append(
                f"{experiments[worst].label} is followed to {1e3 * assessments[worst].whole.rmse:.0f} mV a cell only: "
                "is it of another pack?"
            )
            break
        remarks.append(
            f"left out {experiments[worst].label}: it does not fit the pack of the others, off by "
            f"{1e3 * assessments[worst].whole.rmse:.0f} mV a cell"
        )
        experiments, (solution, assessments) = others, without
    progress(f"{model}: what is left open")
    spread_ = spread(solution, as_expected=True)
    found = family.finished(solution.values)
    assert isinstance(found, Circ | Chem)
    return ModelResult(
        model=model,
        cell=found,
        joined=joined,
        solution=solution,
        spread=spread_,
        assessments=assessments,
        not_told=tuple(not_told(spread_)),
        remarks=tuple(remarks),
        unseen_v=float("nan"),
        flying_v=float("nan"),
    )


def _worst(assessments: Sequence[Assessment]) -> int | None:
    errors = np.array([a.whole.rmse for a in assessments])
    return int(np.nanargmax(errors)) if np.nanmax(errors, initial=0.0) > FOREIGN_V else None


def _solved(problem: Problem, error_v: float) -> Solution:
    """A scaled cell is off by ``error_v`` for long: a flight is worth few independent voltages."""
    shares = [_LASTING**0.5 * SIGMA_V / (error_v * independent(e) ** 0.5) for e in problem.experiments]

    def weighed(these: Problem) -> Problem:
        trust = these.trust or tuple(np.ones(e.time_s.size) for e in these.experiments)
        return replace(these, trust=tuple(share * t for share, t in zip(shares, trust, strict=True)))

    solution = solve(weighed(problem))
    for _ in range(_DOUBTS):
        solution = solve(weighed(problem.doubting(solution.x)), starts=[solution.x])
    return solution


_SOC = np.linspace(0.0, 1.03, 1031)


def _reaching(cell: CellModel, experiments: Sequence[Experiment]) -> MonotoneSpline:
    """The known cell's curve; carried on where a rested pack was fuller than full (a LiPo charged to 4.35 V)."""
    curve = rising(KNOTS, np.asarray(cell.open_circuit(KNOTS)))
    most = max((e.rest_before or 0.0 for e in experiments), default=0.0)
    beyond = np.linspace(1.0, _MOST_FULL, 301)
    full = float(np.interp(most, carried_on(curve, beyond), beyond))
    return curve if full < _OVERFULL else rising(KNOTS, carried_on(curve, KNOTS * full))


def _begin(experiment: Experiment, volts: Array) -> tuple[float, float]:
    rested = experiment.rest_before
    return _UNKNOWN_SOC if rested is None else (float(np.interp(rested, volts, _SOC)), _RESTED_SOC_SD)


def _log_sd(result: ModelResult, name: str) -> float:
    return result.spread.sd(result.solution.problem.unknowns.slice_of(name).start)


def _capacity(solution: Solution) -> float:
    return float(solution.values["capacity"][0, 0]) / SECONDS_PER_HOUR


def _remarks(request: Request, known: BatteryFile, capacity_sd: float, results: Sequence[ModelResult]) -> list[str]:
    said = [f"before the flights: {request.capacity_ah:.3g} Ah, known to {capacity_sd:.0%}"]
    for r in results:
        deepest = min(float(np.min(a.soc)) for a in r.assessments)
        ends = ", ".join(f"{a.soc[0]:.0%} to {a.soc[-1]:.0%}" for a in r.assessments[:6])
        more = f" and {len(r.assessments) - 6} more" if len(r.assessments) > 6 else ""
        bent = float(np.max(np.abs(_bent(r))))
        if bent > _STRAINED * known.uncertainty.voltage_error_v:
            said.append(
                f"{r.model}: the curve had to be bent by {1e3 * bent:.0f} mV, more than cells of one kind differ: are "
                "these flights of one pack? Do not trust this capacity"
            )
        said.append(
            f"{r.model}: {_capacity(r.solution):.3g} Ah, known to {_log_sd(r, 'capacity'):.0%}; state of charge {ends}"
            f"{more}; below {deepest:.0%} the curve is that of the cell it began from"
        )
    return said


def _battery(request: Request, known: BatteryFile, results: Sequence[ModelResult]) -> BatteryFile:
    cells = {r.model: r.cell for r in results}
    circ, chem = cells.get("circ"), cells.get("chem")
    assert circ is None or isinstance(circ, Circ)
    assert chem is None or isinstance(chem, Chem)

    def widest(*names: str) -> float:
        return max(_log_sd(r, n) for r in results for n in names if _has(r, n))

    # Where the models disagree, neither knows.
    apart = float(np.std([np.log(_capacity(r.solution)) for r in results]))
    scales = {
        "resistance": widest("r_s", "r_o"),
        "polarisation": widest("polarisation", "kinetics", "diffusion"),
        "capacity": float(np.hypot(widest("capacity"), apart)),
    }

    errors = [a.whole.rmse for r in results for a in r.assessments if np.isfinite(a.whole.rmse)]
    return replace(
        known,
        name=request.name,
        source=f"{request.source}; began from {known.name}",
        series=request.series,
        bench=False,
        circ=circ,
        chem=chem,
        uncertainty=Uncertainty(
            voltage_error_v=float(np.clip(np.sqrt(np.mean(np.square(errors or [0.0]))), 0.005, 0.1)),
            **{name: float(np.clip(sd, *_SPREAD)) for name, sd in scales.items()},
        ),
        sd={r.model: parameter_sd(r.solution, r.spread) for r in results},
    )


def _bent(result: ModelResult) -> Array:
    family = result.solution.problem.family
    assert isinstance(family, ScaledFamily)
    return np.asarray(family.bends(result.solution.values)[0])


def _has(result: ModelResult, name: str) -> bool:
    return any(b.name == name for b in result.solution.problem.unknowns.blocks)
