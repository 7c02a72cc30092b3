"""What is sealed: for each case what was concealed, how large, where, and what a right answer is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from sim.proof.scoring.names import NONE, OUTSIDE, SEVERAL, UNKNOWN, class_of

Stratum = Literal["null", "single", "several", "unknown"]
Series = Mapping[str, tuple[float, ...]]
Names = frozenset[str]


@dataclass(frozen=True, slots=True)
class Quantity:
    """A true parameter."""

    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class Moment:
    """A place in time: flight (name of its file) and seconds; in answers since the log's first sample."""

    flight: str
    time_s: float


@dataclass(frozen=True, slots=True)
class Criterion:
    """What one measure of one case must reach; see `Judgement.measures` for the names."""

    measure: str
    at_most: float | None = None
    at_least: float | None = None

    def met(self, value: float) -> bool:
        """Whether a value is good enough; NaN never is."""
        above = self.at_least is None or value >= self.at_least
        return above and (self.at_most is None or value <= self.at_most)

    def words(self) -> str:
        """The bound as people read it."""
        if self.at_most is None:
            return f"at least {self.at_least:.3g}"
        return f"at most {self.at_most:.3g}" if self.at_least is None else f"{self.at_least:.3g} to {self.at_most:.3g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One case's sealed answer.

    accept : sets of effects, any of which is right; {"none"} and {"unknown"} are sets too.
    truth : what was really put in; empty for a null.
    ambiguous : nobody could tell the members of ``accept`` apart; a set that holds the truth is the right answer.
    snr : smallest signal-to-noise ratio of what was put in; None where it is not known.
    samples : per flight, columns of equal length with ``affected`` (0 or 1): where the effect acts.
    hidden : per flight, ``time_s`` since the log's first sample and what was withheld, e.g. ``temperature_K``.
    starts_s : per flight, its log's first time stamp, so that a tool may speak in either clock.
    criteria : what this case must reach, beyond its suite's rates.
    permitted : true of this world though not concealed; naming them as well is no error, and no claim.
    held : flights that nobody is shown, with the ``end_s`` at which each would have been empty.
    may_refuse : to say that the recordings cannot be of one pack is right too.
    """

    case: str
    kind: str
    accept: tuple[Names, ...]
    truth: Names = frozenset()
    ambiguous: bool = False
    group: str = ""
    snr: float | None = None
    parameters: Mapping[str, Mapping[str, Quantity]] = field(default_factory=dict)
    change_points: tuple[Moment, ...] = ()
    samples: Mapping[str, Series] = field(default_factory=dict)
    hidden: Mapping[str, Series] = field(default_factory=dict)
    starts_s: Mapping[str, float] = field(default_factory=dict)
    criteria: tuple[Criterion, ...] = ()
    permitted: Names = frozenset()
    held: Mapping[str, float] = field(default_factory=dict)
    may_refuse: bool = False
    note: str = ""

    @property
    def stratum(self) -> Stratum:
        """How it is counted."""
        if frozenset({UNKNOWN}) in self.accept:
            return "unknown"
        if self.accept == (frozenset({NONE}),):
            return "null"
        if len(self.truth) > 1:
            return "several"
        return "single" if any(len(names) == 1 for names in self.accept) else "several"

    @property
    def label(self) -> str:
        """Its row of the confusion matrix."""
        if self.stratum == "unknown":
            return OUTSIDE
        if self.stratum != "single":
            return NONE if self.stratum == "null" else SEVERAL
        return class_of(min(self.truth or self.accept[0]))


def answer_from_json(given: Mapping[str, Any]) -> Answer:
    """An answer as it was written. Raises KeyError where case, kind or accept are missing."""
    accept = tuple(frozenset(entry.split("+")) for entry in given["accept"])
    return Answer(
        case=given["case"],
        kind=given["kind"],
        accept=accept,
        truth=frozenset(given.get("truth", ())),
        ambiguous=bool(given.get("ambiguous", False)),
        group=given.get("group", ""),
        snr=given.get("snr"),
        parameters={
            effect: {name: Quantity(float(q["value"]), q["unit"]) for name, q in of.items()}
            for effect, of in given.get("parameters", {}).items()
        },
        change_points=tuple(Moment(m["flight"], float(m["time_s"])) for m in given.get("change_points", ())),
        samples=_series(given.get("samples", {})),
        hidden=_series(given.get("hidden", {})),
        starts_s={flight: float(t) for flight, t in given.get("starts_s", {}).items()},
        criteria=tuple(Criterion(**c) for c in given.get("criteria", ())),
        permitted=frozenset(given.get("permitted", ())),
        held={flight: float(end_s) for flight, end_s in given.get("held", {}).items()},
        may_refuse=bool(given.get("may_refuse", False)),
        note=given.get("note", ""),
    )


def answer_to_json(answer: Answer) -> dict[str, Any]:
    """What `answer_from_json` gives back; the same answer gives the same text."""
    return {
        "case": answer.case,
        "kind": answer.kind,
        "accept": ["+".join(sorted(names)) for names in answer.accept],
        "truth": sorted(answer.truth),
        "ambiguous": answer.ambiguous,
        "group": answer.group,
        "snr": answer.snr,
        "parameters": {
            effect: {name: {"value": q.value, "unit": q.unit} for name, q in of.items()}
            for effect, of in answer.parameters.items()
        },
        "change_points": [{"flight": m.flight, "time_s": m.time_s} for m in answer.change_points],
        "samples": {flight: {k: list(v) for k, v in of.items()} for flight, of in answer.samples.items()},
        "hidden": {flight: {k: list(v) for k, v in of.items()} for flight, of in answer.hidden.items()},
        "starts_s": dict(answer.starts_s),
        "criteria": [{"measure": c.measure, "at_most": c.at_most, "at_least": c.at_least} for c in answer.criteria],
        "permitted": sorted(answer.permitted),
        "held": dict(answer.held),
        "may_refuse": answer.may_refuse,
        "note": answer.note,
    }


def _series(given: Mapping[str, Mapping[str, Any]]) -> dict[str, Series]:
    return {flight: {name: tuple(map(float, v)) for name, v in of.items()} for flight, of in given.items()}
