"""From a battery file and the flights that disagree with it to the physics that was left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.battery_file import BatteryFile, ModelName
from bhm_service.battery.effects import EFFECTS, CurrentOffset
from bhm_service.config import Vehicle
from bhm_service.discrepancy import verdict
from bhm_service.discrepancy.advice import advice
from bhm_service.discrepancy.as_flown import as_flown, moved_of
from bhm_service.discrepancy.candidate import Candidate, NotExcited, candidates, known_drivers
from bhm_service.discrepancy.cells import with_cells
from bhm_service.discrepancy.confirm import Unseen, held_out
from bhm_service.discrepancy.courses import courses_of
from bhm_service.discrepancy.crossing import Witness, witness
from bhm_service.discrepancy.decision import Decision, decide
from bhm_service.discrepancy.demand_side import demand_side
from bhm_service.discrepancy.explanation import Explanation
from bhm_service.discrepancy.findings import Findings, Verdict
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.flights import FlightData, LeftOut
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.locate import regime_maps, variables
from bhm_service.discrepancy.odds import LEAST_SNR, Names
from bhm_service.discrepancy.quantities import measured, teller
from bhm_service.discrepancy.repair import flying, patched, repaired
from bhm_service.discrepancy.search import Progress, Search, search
from bhm_service.discrepancy.selection import Selection, taken
from bhm_service.discrepancy.significance import familywise
from bhm_service.discrepancy.summary import findings_of
from bhm_service.discrepancy.timing import by_samples
from bhm_service.discrepancy.words import effect_in_words, left_advice, left_in_words, sentence, values_of
from bhm_service.errors import BadInputError
from bhm_service.units import SECONDS_PER_HOUR

_FEWEST = 2  # flights
_SAMPLES = 800  # of a flight that the search looks at: neighbours say the same thing
_SEED = 1
_CELL_V = 3.7  # [V] for the energy of a pack


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What to explain."""

    battery: BatteryFile
    flights: Sequence[FlightData]
    left_out: Sequence[LeftOut] = ()
    model: ModelName = "circ"
    series: int | None = None
    capacity_c: float | None = None
    vehicle: Vehicle | None = None  # whose demand model the flights' power is held against
    told: Names = frozenset()  # effects to take as given; the catalogue is searched where there are none
    cores: int = 1  # that it may use


def explain(request: Request, progress: Progress = lambda _: None) -> Explanation:
    """Search, choose, confirm and say; what is told is measured only.

    Raises BadInputError with fewer than two usable flights, and where they show nothing of what is told.
    """
    flights = tuple(f.thinned(_SAMPLES) for f in request.flights)
    if len(flights) < _FEWEST:
        why = "; ".join(f"{r.label}: {r.because}" for r in request.left_out)
        raise BadInputError(
            "bhm explain", f"{len(flights)} usable flight{'s' * (len(flights) != 1)}, {_FEWEST} are needed", why
        )
    lab = _lab(request, request.model, flights)
    base = Joint(lab, flights)
    tried, missing = _tried(lab, flights)
    if request.told:
        tried = [c for c in tried if c.id in request.told]
    progress("the battery as it is")
    found = search(base, tried, progress, request.cores)
    progress("which of them stands")
    rng = np.random.default_rng(_SEED)
    second = _witness(request, found, flights)
    unseen = Unseen(found)
    own_rate = Joint(lab, tuple(request.flights), (), found.base.start_sd)
    closer = witness(lab, own_rate, found.candidates, near=found)
    if request.told:
        told = _as_told(found, request.told, missing)
        decision = Decision(chosen=told, p_values=familywise(found, told.names, rng))
    else:
        decision = decide(unseen, second, closer, request.flights, rng)
    chosen = decision.chosen
    models: list[Search | Witness] = [found] if second is None or not chosen.names else [found, second]
    fits = [by_samples(measured(model.fitted(chosen.names)), closer, chosen.names) for model in models]
    fitted = fits[0]
    progress("flights that no fit saw")
    proof = held_out(unseen, chosen.names)
    progress("the course of every flight")
    courses = courses_of(base, fitted)
    judged = verdict.judge(found, chosen, fitted, courses, decision.contests, decision.left)
    described = "" if decision.left is None else left_in_words(decision.left)
    advised = advice(found, chosen, judged.verdict, tried, decision.contests)
    if decision.left is not None:
        advised.append(left_advice(decision.left))
    findings = findings_of(found, decision, fits, courses, proof, judged, advised)
    if request.vehicle is not None:
        progress("the power that was asked for")
    over = variables([c.flight for c in courses], [c.soc for c in courses])
    off = np.concatenate([c.flight.voltage_v - c.before_v for c in courses])
    mended = _battery(request.battery, judged.verdict, fits, findings, lab.series)
    return Explanation(
        lab=lab,
        battery=request.battery,
        repaired=mended,
        courses=courses,
        left_out=tuple(request.left_out),
        search=found,
        selection=chosen,
        held_out=proof,
        maps=regime_maps(off, over),
        contests=decision.contests,
        not_excited=(*missing, *_not_excited(found, tried, chosen.names)),
        flying=flying(fitted.joint, fitted, mended),
        sentence=sentence(
            findings,
            len(flights),
            moved_of(fitted),
            tuned_v=None if proof is None else proof.tuned_v,
            told=bool(request.told),
            left=described,
        ),
        in_words=[
            effect_in_words(e.id, values_of(teller(fits, e.id), e.id), lab, flights, courses) for e in findings.effects
        ],
        findings=findings,
        demand=demand_side(request.vehicle, request.flights, missing_a(fitted)),
    )


def missing_a(fitted: Fitted) -> float:
    """What a set, and the battery file, have the current sensor read too little at all times. [A]"""
    values = fitted.joint.values(fitted.x[None, :])
    found = [e for member in fitted.joint.members for e in member.effects(values, np.arange(1))]
    known = fitted.joint.lab.effects
    return float(sum(np.ravel(e.offset)[0] for e in (*known, *found) if isinstance(e, CurrentOffset)))


def _lab(request: Request, model: ModelName, flights: Sequence[FlightData]) -> Lab:
    """The pack as its file has it, without effects of which no flight tells what drives them: they do nothing here.

    So the search may try them, and find what drives them. A file of another pack has the law of all cells from no
    bench: what it leaves open is more than a temperature that nobody recorded could be told from.
    """
    lab = lab_of(request.battery, model, request.series, request.capacity_c)
    told = {driver for flight in flights for driver in known_drivers([flight])}
    return lab.driven(told) if lab.identified else lab


def _tried(lab: Lab, flights: Sequence[FlightData]) -> tuple[list[Candidate], list[NotExcited]]:
    energy_wh = _CELL_V * lab.series * lab.capacity_c / SECONDS_PER_HOUR
    joined = [e.id for e in lab.effects]
    tried, missing = candidates(flights, lab.model, energy_wh, lab.identified, joined, lab.capacity_c, lab.series)
    told, alike = with_cells(tried, lab, flights)
    return told, missing + alike


def _not_excited(found: Search, tried: Sequence[Candidate], chosen: Names) -> list[NotExcited]:
    """Which of the candidates these flights cannot show at their usual size, and why; ``chosen`` showed at theirs."""
    dull = [
        NotExcited(c.id, f"of its usual size it would stand {found.snr[c.id]:.1f} sigma out of noise and lab errors")
        for c in tried
        if not c.inferred and c.id not in chosen and found.snr.get(c.id, LEAST_SNR) < LEAST_SNR
    ]
    unshown = [c.id for c in tried if c.id not in found.snr]
    return dull + [NotExcited(name, f"shows only beside {' or '.join(EFFECTS[name].shown_by)}") for name in unshown]


def _battery(
    battery: BatteryFile, said: Verdict, fits: Sequence[Fitted], findings: Findings, series: int
) -> BatteryFile | None:
    """The battery file that goes with a verdict; None where it stays as it is."""
    if findings.effects:
        return repaired(battery, fits, f"repaired by bhm explain: {', '.join(sorted(e.id for e in findings.effects))}")
    if said == "parameter":
        return as_flown(battery, fits)
    return patched(battery, findings.fit.rmse_before_V / series) if said == "unknown" else None


def _as_told(found: Search, told: Names, missing: Sequence[NotExcited]) -> Selection:
    """What is told, whether it earns its place or not. Raises BadInputError where the flights show none of it."""
    chosen = taken(found, told)
    if not chosen.names:
        why = "; ".join(f"{m.id}: {m.because}" for m in missing if m.id in told) or "too small for these flights"
        raise BadInputError("bhm explain --told", f"nothing of {'+'.join(sorted(told))} can be measured", why)
    return chosen


def _witness(request: Request, found: Search, flights: tuple[FlightData, ...]) -> Witness | None:
    """The file's other cell model on the same flights; None where it has only one."""
    other: ModelName = "chem" if request.model == "circ" else "circ"
    if (request.battery.chem if other == "chem" else request.battery.circ) is None:
        return None
    lab = _lab(request, other, flights)
    tried, _ = _tried(lab, flights)
    by_name = {c.id: c for c in tried} | {c.id: c for c in found.candidates if c.price > 0.0}
    return witness(lab, found.base, list(by_name.values()), other=found)
