"""One case: its answer against what the tool said. What cannot be computed is said, never guessed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median

import numpy as np

from sim.proof.scoring.answers import Answer, Stratum
from sim.proof.scoring.findings import Findings, Outcome, Region
from sim.proof.scoring.hidden import compare, since_start, stem
from sim.proof.scoring.names import NONE, OUTSIDE, UNKNOWN, class_of

_FOUND_WITHIN_S = 10.0  # a change point is found when it is this near (issue 5)
_NEAR_ZERO_V = 1e-6


@dataclass(frozen=True, slots=True)
class ParameterScore:
    """A parameter that both sides give in one unit."""

    effect: str
    name: str
    true: float
    found: float
    sd: float | None

    @property
    def relative_error(self) -> float:
        """|found - true| / |true|."""
        return abs(self.found - self.true) / abs(self.true)

    @property
    def z(self) -> float | None:
        """Its error in its own standard deviations; None where none was given."""
        return (self.found - self.true) / self.sd if self.sd else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """How one case was answered. None: does not apply, or could not be computed (then ``missing`` says why).

    measures : single numbers by name: ``heldout_ratio``, ``share_of_oracle``, ``rft_ratio``, ``rft_before_s``,
        ``rft_after_s``, ``iou``, ``parameter_error`` (median), ``accepted`` (1 or 0), ``change_points_found`` (share),
        ``hidden.*``; ``named.EFFECT`` and ``listed.EFFECT`` (1 if in the chosen set, or in any set);
        ``parameter.EFFECT.NAME``.
    """

    case: str
    kind: str
    group: str
    stratum: Stratum
    label: str
    said: str  # as the confusion matrix has it
    verdict: str
    snr: float | None
    accepted: bool  # what it says is right, all of it
    claims: bool
    first: str | None = None  # the first name, if one was given
    first_right: bool | None = None
    exact: bool | None = None
    all_found: bool | None = None
    any_found: bool | None = None
    extra: bool | None = None
    flagged: bool | None = None
    rest: bool = False  # it owns up to an unexplained rest
    ambiguous: bool = False
    set_holds_truth: bool | None = None
    set_size: int | None = None
    parameters: tuple[ParameterScore, ...] = ()
    heldout_v: tuple[float, float] | None = None
    measures: Mapping[str, float] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    criteria: tuple[tuple[str, str, float | None, bool], ...] = ()  # measure, bound, value, met
    seconds: float | None = None
    cpu_seconds: float | None = None
    peak_mib: float | None = None
    failure: str = ""


def judge(answer: Answer, outcome: Outcome) -> Judgement:
    """Judge one case."""
    if outcome.findings is None:
        return _failed(answer, outcome)
    in_class = frozenset().union(*answer.accept)
    findings = outcome.findings.without(answer.permitted - in_class)
    measures: dict[str, float] = {}
    missing: list[str] = []
    with_effect = answer.stratum in ("single", "several")
    parameters = _parameters(answer, findings, missing) if with_effect else ()
    flagged = (findings.verdict == UNKNOWN or findings.with_rest) if answer.stratum == "unknown" else None
    accepted = findings.chosen in answer.accept or bool(flagged)
    measures["accepted"] = float(accepted)
    if parameters:
        measures["parameter_error"] = median(p.relative_error for p in parameters)
    heldout = _fit(findings, outcome, measures, missing)
    _where(answer, findings, measures, missing)
    if answer.hidden:
        found, why = compare(answer.hidden, outcome.inferred, answer.starts_s)
        measures |= found
        missing += why
    candidates = findings.candidates if findings.claims else ()
    _asked_for(answer, findings, measures)
    return Judgement(
        case=answer.case,
        kind=answer.kind,
        group=answer.group,
        stratum=answer.stratum,
        label=answer.label,
        said=_said(answer, findings, in_class),
        verdict=findings.verdict + (" + unexplained rest" if findings.with_rest else ""),
        snr=answer.snr,
        accepted=accepted,
        claims=findings.claims,
        first=findings.first,
        first_right=findings.first in in_class if findings.first is not None else None,
        exact=findings.chosen in answer.accept if with_effect else None,
        all_found=any(names <= findings.chosen for names in answer.accept) if with_effect else None,
        any_found=bool(findings.chosen & in_class) if with_effect else None,
        extra=_extra(answer, findings) if with_effect and findings.claims else None,
        flagged=flagged or (accepted if answer.stratum == "unknown" else None),
        rest=findings.verdict == UNKNOWN or findings.with_rest,
        ambiguous=answer.ambiguous,
        set_holds_truth=(answer.truth in candidates if answer.truth else None) if answer.ambiguous else None,
        set_size=len(candidates) if answer.ambiguous and candidates else None,
        parameters=parameters,
        heldout_v=heldout,
        measures=measures,
        missing=tuple(missing),
        criteria=tuple(
            (c.measure, c.words(), measures.get(c.measure), c.measure in measures and c.met(measures[c.measure]))
            for c in answer.criteria
        ),
        seconds=outcome.seconds,
        cpu_seconds=outcome.cpu_seconds,
        peak_mib=outcome.peak_mib,
    )


def _asked_for(answer: Answer, findings: Findings, measures: dict[str, float]) -> None:
    """Measures of single effects and parameters, where a criterion asks for them."""
    listed = frozenset().union(*findings.candidates)
    for name in (c.measure for c in answer.criteria):
        kind, _, what = name.partition(".")
        if kind == "named":
            measures[name] = float(what in findings.chosen)
        elif kind == "listed":
            measures[name] = float(any(effect in listed for effect in what.split("|")))
        elif kind == "parameter":
            effect, _, parameter = what.partition(".")
            estimate = findings.parameters.get(effect, {}).get(parameter)
            if estimate is not None:
                measures[name] = estimate.value


def _failed(answer: Answer, outcome: Outcome) -> Judgement:
    """No findings: nothing is right, and nothing is claimed either."""
    effect = answer.stratum in ("single", "several")
    right = answer.may_refuse and outcome.refused
    return Judgement(
        case=answer.case,
        kind=answer.kind,
        group=answer.group,
        stratum=answer.stratum,
        label=answer.label,
        said="refused" if outcome.refused else "failed",
        verdict="refused" if outcome.refused else "failed",
        snr=answer.snr,
        accepted=right,
        claims=False,
        exact=False if effect else None,
        all_found=False if effect else None,
        any_found=False if effect else None,
        flagged=right if answer.stratum == "unknown" else None,
        ambiguous=answer.ambiguous,
        set_holds_truth=False if answer.ambiguous else None,
        measures={"accepted": float(right)},
        criteria=tuple((c.measure, c.words(), None, right) for c in answer.criteria),
        seconds=outcome.seconds,
        cpu_seconds=outcome.cpu_seconds,
        peak_mib=outcome.peak_mib,
        failure="" if right else outcome.failure or "no findings.json",
    )


def _said(answer: Answer, findings: Findings, in_class: frozenset[str]) -> str:
    """A column of the confusion matrix: the answer's own class where the first name is in it."""
    if findings.chosen in answer.accept or findings.first in in_class:
        return answer.label
    if findings.first is not None:
        return class_of(findings.first)
    return OUTSIDE if findings.verdict == UNKNOWN else NONE if findings.verdict == "parameter" else findings.verdict


def _extra(answer: Answer, findings: Findings) -> bool:
    """Whether even the kindest reading leaves an effect that is not there."""
    return min(len(findings.chosen - names) for names in answer.accept) > 0 and bool(findings.effects)


def _parameters(answer: Answer, findings: Findings, missing: list[str]) -> tuple[ParameterScore, ...]:
    scores = []
    for effect, true in answer.parameters.items():
        found = findings.parameters.get(effect)
        if found is None:
            continue  # another name of the class was given, or none: the naming counts that
        for name, quantity in true.items():
            estimate = found.get(name)
            if estimate is None:
                missing.append(f"{effect}.{name}: not given (it gives {', '.join(found) or 'none'})")
            elif estimate.unit != quantity.unit:
                missing.append(f"{effect}.{name}: in {estimate.unit}, the answer is in {quantity.unit}")
            elif quantity.value != 0.0:
                scores.append(ParameterScore(effect, name, quantity.value, estimate.value, estimate.sd))
    return tuple(scores)


def _fit(
    findings: Findings, outcome: Outcome, measures: dict[str, float], missing: list[str]
) -> tuple[float, float] | None:
    before, after = (findings.fit.get(f"heldout_{when}_V") for when in ("before", "after"))
    heldout = None
    if findings.claims:
        if before is None or after is None or before < _NEAR_ZERO_V:
            missing.append("heldout_ratio: no held-out errors in fit")
        else:
            heldout = (before, after)
            measures["heldout_ratio"] = after / before
    oracle = outcome.oracle_heldout_v
    if before is not None and after is not None and oracle is not None and before - oracle > _NEAR_ZERO_V:
        measures["share_of_oracle"] = (before - after) / (before - oracle)  # nothing, where nothing was claimed
    if outcome.rft_error_s is not None and outcome.rft_error_s[0] > 0.0:
        measures["rft_before_s"], measures["rft_after_s"] = outcome.rft_error_s
        measures["rft_ratio"] = outcome.rft_error_s[1] / outcome.rft_error_s[0]
    return heldout


def _where(answer: Answer, findings: Findings, measures: dict[str, float], missing: list[str]) -> None:
    if answer.change_points:
        hits = [
            any(
                stem(c.flight) == stem(m.flight)
                and abs(since_start(c.time_s, answer.starts_s.get(m.flight, 0.0)) - m.time_s) <= _FOUND_WITHIN_S
                for c in findings.change_points
            )
            for m in answer.change_points
        ]
        measures["change_points_found"] = sum(hits) / len(hits)
    if answer.samples and findings.claims:
        overlap = _overlap(answer, findings.regions, missing)
        if overlap is not None:
            measures["iou"] = overlap


def _overlap(answer: Answer, regions: tuple[Region, ...], missing: list[str]) -> float | None:
    """Intersection over union of the samples that are affected and those that are pointed at."""
    if not regions:
        missing.append("iou: nothing is localised")
        return None
    both = either = 0
    for flight, columns in answer.samples.items():
        affected = np.array(columns["affected"]) > 0.5
        pointed = np.zeros(affected.size, dtype=bool)
        for region in regions:
            if region.flights and stem(flight) not in map(stem, region.flights):
                continue
            unknown = [name for name in region.where if name not in columns]
            if unknown:
                missing.append(f"iou: the answer has no {', '.join(unknown)}")
                return None
            inside = np.ones(affected.size, dtype=bool)
            for name, (low, high) in region.where.items():
                values = np.array(columns[name])
                inside &= (values >= low) & (values <= high)
            pointed |= inside
        both += int((affected & pointed).sum())
        either += int((affected | pointed).sum())
    return both / either if either else None
