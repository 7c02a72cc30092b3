"""From a battery file and the flights that disagree with it to the physics that was left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.battery_file import BatteryFile, ModelName
from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.config import Vehicle
from bhm_service.discrepancy import verdict
from bhm_service.discrepancy.advice import advice
from bhm_service.discrepancy.bent_curve import bent_curve
from bhm_service.discrepancy.candidate import Candidate, NotExcited, candidates
from bhm_service.discrepancy.changed_lag import ChangedLag, changed_lag
from bhm_service.discrepancy.confirm import HeldOut, Unseen, harmful, held_out
from bhm_service.discrepancy.crossing import Witness, witness
from bhm_service.discrepancy.decoys import contests
from bhm_service.discrepancy.demand_side import demand_side
from bhm_service.discrepancy.explanation import Contest, Course, Explanation, Left
from bhm_service.discrepancy.findings import ChangePoint, EffectFound, Findings, Fit, Inferred, Region
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.flights import FlightData, LeftOut
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import Lab, lab_of
from bhm_service.discrepancy.locate import locate, regime_maps, variables
from bhm_service.discrepancy.onset import first_flight
from bhm_service.discrepancy.patterns import Pattern, telling
from bhm_service.discrepancy.quantities import measured, parameters
from bhm_service.discrepancy.recurring import recurring
from bhm_service.discrepancy.repair import flying, patched, repaired, retuned
from bhm_service.discrepancy.search import LEAST_SNR, NATS, NEAR, STRUCTURAL, Names, Progress, Search, needed, search
from bhm_service.discrepancy.selection import MUCH, NOTHING, Selection, select, share, taken
from bhm_service.discrepancy.significance import familywise
from bhm_service.discrepancy.timing import by_samples, timed
from bhm_service.discrepancy.words import effect_in_words, left_in_words, moved_of, sentence, values_of
from bhm_service.errors import BadInputError
from bhm_service.units import SECONDS_PER_HOUR, Array

_FEWEST = 2  # flights
_SAMPLES = 800  # of a flight that the search looks at: neighbours say the same thing
_SEED = 1
_MOST_REFUTED = 8  # sets that are put to the test, the best first
_SIGNIFICANT = 0.02  # over the whole catalogue
_DRAWS = 24  # of the posterior, for the band of a hidden state
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
    lab = lab_of(request.battery, request.model, request.series, request.capacity_c)
    base = Joint(lab, flights)
    tried, missing = _tried(lab, flights)
    if request.told:
        tried = [c for c in tried if c.id in request.told]
    progress("the battery as it is")
    found = search(base, tried, progress)
    progress("which of them stands")
    rng = np.random.default_rng(_SEED)
    second = _witness(request, found, flights)
    unseen = Unseen(found)
    closer = witness(lab, Joint(lab, tuple(request.flights), (), found.base.start_sd), found.candidates)
    leftover: Left | None = None
    if request.told:
        chosen = _as_told(found, request.told, missing)
        p_values, rivals = familywise(found, chosen.names, rng), list[Contest]()
    else:
        chosen, p_values, rivals = _significant(unseen, second, closer, rng)
        chosen, leftover = _outweighed(found, chosen, lab, request.flights)
    models: list[Search | Witness] = [found] if second is None or not chosen.names else [found, second]
    fits = [by_samples(measured(model.fitted(chosen.names)), closer, chosen.names) for model in models]
    fitted = fits[0]
    progress("flights that no fit saw")
    proof = held_out(unseen, chosen.names)
    progress("the course of every flight")
    courses = courses_of(base, fitted)
    dull = [
        NotExcited(c.id, f"of its usual size it would stand {found.snr[c.id]:.1f} sigma out of noise and lab errors")
        for c in tried
        if not c.inferred and found.snr.get(c.id, LEAST_SNR) < LEAST_SNR
    ]
    unshown = [c.id for c in tried if c.id not in found.snr]
    dull += [NotExcited(name, f"shows only beside {' or '.join(EFFECTS[name].shown_by)}") for name in unshown]
    rivals = rivals if chosen.names else []
    judged = verdict.judge(found, chosen, fitted, courses, rivals, leftover)
    findings = _findings(found, chosen, fits, courses, proof, rivals, p_values, judged)
    battery = None
    if chosen.names:
        battery = repaired(request.battery, fits, f"repaired by bhm explain: {', '.join(sorted(chosen.names))}")
    elif judged.verdict == "parameter":
        battery = retuned(request.battery, fitted)
    elif judged.verdict == "unknown":
        battery = patched(request.battery, findings.fit.rmse_before_V / lab.series)
    described = "" if leftover is None else left_in_words(leftover)
    said = sentence(findings, len(flights), moved_of(fitted), told=bool(request.told), left=described)
    advised = advice(found, chosen, judged.verdict)
    changes = findings.change_points
    if isinstance(leftover, ChangedLag):
        changes = _in_order([ChangePoint(flight=leftover.flight, time_s=0.0), *changes])
    if described:
        advised.append(f"Look for a cause that goes with it: {described}.")
    if request.vehicle is not None:
        progress("the power that was asked for")
    over = variables([c.flight for c in courses], [c.soc for c in courses])
    off = np.concatenate([c.flight.voltage_v - c.before_v for c in courses])
    return Explanation(
        lab=lab,
        battery=request.battery,
        repaired=battery,
        courses=courses,
        left_out=tuple(request.left_out),
        search=found,
        selection=chosen,
        held_out=proof,
        maps=regime_maps(off, over),
        contests=rivals,
        not_excited=(*missing, *dull),
        flying=flying(fitted.joint, fitted),
        sentence=said,
        in_words=[effect_in_words(e.id, values_of(fitted, e.id), lab, flights, courses) for e in findings.effects],
        findings=findings.model_copy(update={"advice": advised, "change_points": changes}),
        demand=demand_side(request.vehicle, request.flights),
    )


def _tried(lab: Lab, flights: Sequence[FlightData]) -> tuple[list[Candidate], list[NotExcited]]:
    energy_wh = _CELL_V * lab.series * lab.capacity_c / SECONDS_PER_HOUR
    joined = [e.id for e in lab.effects]
    return candidates(flights, lab.model, energy_wh, lab.identified, joined, lab.capacity_c, lab.series)


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
    lab = lab_of(request.battery, other, request.series, request.capacity_c)
    tried, _ = _tried(lab, flights)
    by_name = {c.id: c for c in tried} | {c.id: c for c in found.candidates if c.price > 0.0}
    return witness(lab, found.base, list(by_name.values()))


def _significant(
    unseen: Unseen, second: Witness | None, closer: Witness, rng: np.random.Generator
) -> tuple[Selection, dict[str, float], list[Contest]]:
    """The best set that beats noise, is beaten by no phantom, harms on no unseen flight and has the other model's word.

    A skew has to stand on the logs' own samples (``closer``) as well: over averaged ones it is not told from what a
    cell relaxes within a second, of which the samples themselves show that part comes at once. One that does not is
    part of no set. With the set its members' odds in noise, and its contests with phantoms. Sets are dropped one by
    one; a catalogue of which the best are all refuted has nothing to say.
    """
    found = unseen.found
    refuted: list[Names] = []
    absent: Names = frozenset()
    for _ in range(_MOST_REFUTED):
        chosen = select(found, refuted, absent)
        p_values = familywise(found, chosen.names, rng)
        if not chosen.names:
            return chosen, p_values, []
        if all(p <= _SIGNIFICANT for p in p_values.values()) and not harmful(unseen, chosen.names):
            rivals = contests(found, chosen.names, rng)
            beaten = any(c.nats < -NEAR for c in rivals)
            if not beaten and (second is None or _witnessed(second.earned(chosen.names))):
                if timed(closer, chosen.names):
                    return chosen, p_values, rivals
                absent = frozenset({TimeSkew.id})
        refuted.append(chosen.names)
    return NOTHING, {}, []


def _witnessed(earned: Mapping[str, float]) -> bool:
    """Whether every member earns something with the other cell model, and what looks like structure all it has to."""
    return all(nats >= (needed(name) if name in STRUCTURAL else NEAR) for name, nats in earned.items())


def _outweighed(
    found: Search, chosen: Selection, lab: Lab, logs: Sequence[FlightData]
) -> tuple[Selection, Left | None]:
    """The selection and what it leaves; nothing is selected where what is left tells more than it does.

    What by itself explains much of the misfit stays, with an unexplained rest. What looks like a model's structure is
    no physics of this pack where something without a name does as well. ``logs`` are the flights at their own rate.
    """
    fitted = found.fitted(chosen.names)
    # Neither is an error of the lab, however small: no model of a cell keeps time, or changes within a second.
    left = recurring(fitted) or changed_lag(fitted, logs) or _pattern(found, chosen.names)
    if not chosen.names:
        return chosen, left or bent_curve(fitted, lab)
    if left is not None and left.nats > found.evidence(chosen.names) and share(found, chosen.names) < MUCH:
        return NOTHING, left
    if chosen.names <= STRUCTURAL:
        bare = telling(found.fitted(frozenset()))
        if bare is not None and bare.nats > found.evidence(chosen.names) - NATS:
            return NOTHING, bare
    return chosen, left


def _pattern(found: Search, names: Names) -> Pattern | None:
    """The pattern that a set leaves; what is within the lab's own errors is one of those."""
    return telling(found.fitted(names)) if names or verdict.beyond_lab(found) else None


def courses_of(base: Joint, fitted: Fitted) -> list[Course]:
    """Every flight by the battery as it is and by the explanation; hidden states with their spread."""
    joint = fitted.joint
    draws = _draws(fitted)
    inferred = any("temperature" in kind.supplies for c in joint.members for _, kind in c.parts)
    found = []
    everywhere = zip(joint.flights, base.expected_v, joint.all_predicted(fitted.x[None, :]), strict=True)
    for k, (data, before, after) in enumerate(everywhere):
        states: dict[str, tuple[Array, Array]] = {}
        if inferred:
            rows = joint.temperature(draws, k)
            states["temperature"] = (rows[0], rows[1:].std(axis=0))
        found.append(Course(data, before, after.voltage[0], after.soc, states))
    return found


def _draws(fitted: Fitted) -> Array:
    """The fit and draws of its posterior, inside the bounds; (1 + draws, n)."""
    rng = np.random.default_rng(_SEED)
    spread = rng.multivariate_normal(np.zeros(fitted.x.size), fitted.covariance, size=_DRAWS, method="eigh")
    unknowns = fitted.joint.unknowns
    return np.vstack([fitted.x, np.clip(fitted.x + spread, unknowns.low, unknowns.high)])


def _findings(
    found: Search,
    chosen: Selection,
    fits: Sequence[Fitted],
    courses: Sequence[Course],
    proof: HeldOut | None,
    rivals: Sequence[Contest],
    p_values: dict[str, float],
    judged: verdict.Judged,
) -> Findings:
    fitted, *others = fits
    before = _rms([c.flight.voltage_v - c.before_v for c in courses])
    after = _rms([c.flight.voltage_v - c.after_v for c in courses])
    explained = max(1.0 - (after / max(before, 1e-9)) ** 2, 0.0)
    power = sum(v**2 for v in chosen.added_v.values()) or 1.0
    beaten = float(np.mean([c.beaten for c in rivals])) if rivals else None
    effects = [
        EffectFound(
            id=member.id,
            parameters=parameters(fitted, member.id, others),
            evidence_nats=float(chosen.earned[member.id]),
            p_familywise=p_values[member.id],
            share_of_misfit=float(explained * chosen.added_v[member.id] ** 2 / power),
            decoys_beaten=beaten if any("temperature" in kind.drivers for _, kind in member.parts) else None,
        )
        for member in sorted(fitted.joint.members, key=lambda m: -chosen.added_v[m.id])
    ]
    misfits = [c.flight.voltage_v - c.before_v for c in courses]
    where = judged.verdict != "none"
    regions = (
        locate(misfits, [c.flight for c in courses], [c.soc for c in courses], found.noise.sigma_v) if where else []
    )
    return Findings(
        verdict=judged.verdict,
        effects=effects,
        alternatives=[sorted(names) for names in chosen.alternatives],
        unexplained_rest=judged.rest,
        localisation=[
            Region(
                where=r.where,
                flights=list(r.flights),
                share_of_misfit=min(r.share_of_misfit, 1.0),
                sign=1 if r.sign > 0 else -1,
            )
            for r in regions
        ],
        change_points=_change_points(fitted),
        inferred=[
            Inferred(flight=c.flight.label, file=f"hidden/{c.flight.label}.csv", states=sorted(c.hidden))
            for c in courses
            if c.hidden
        ],
        fit=Fit(
            rmse_before_V=before,
            rmse_after_V=after,
            heldout_before_V=None if proof is None else proof.before_v,
            heldout_after_V=None if proof is None else (proof.after_v if chosen.names else proof.before_v),
            noise_floor_V=found.noise.sigma_v,
        ),
        advice=[],
        battery_file=None,
    )


def _rms(parts: Sequence[Array]) -> float:
    return float(np.sqrt(np.nanmean(np.concatenate(parts) ** 2)))


def _change_points(fitted: Fitted) -> list[ChangePoint]:
    found = []
    for member in fitted.joint.members:
        if first := first_flight(member):
            found.append(ChangePoint(flight=fitted.joint.flights[first].label, time_s=0.0))
        for key, told in member.fixed.items():
            if not key.startswith("intermittent-contact#"):
                continue
            for k, time_s in enumerate(told):
                if 0.0 < time_s < float(fitted.joint.flights[k].time_s[-1]):
                    found.append(ChangePoint(flight=fitted.joint.flights[k].label, time_s=float(time_s)))
    return _in_order(found)


def _in_order(changes: Sequence[ChangePoint]) -> list[ChangePoint]:
    return sorted(changes, key=lambda c: (c.flight, c.time_s))
