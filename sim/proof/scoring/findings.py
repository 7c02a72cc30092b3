"""What was collected from a tool: its findings.json, the hidden states that it wrote, and what it cost."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from sim.proof.scoring.answers import Moment, Names, Series
from sim.proof.scoring.names import NONE, UNKNOWN

Verdict = Literal["none", "parameter", "named", "ambiguous", "sensor-suspect", "unknown", "not-excited"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
REST = 0.1  # of the misfit: when so much is owned up to as unexplained, the verdict is flagged
_CLAIMS = ("named", "ambiguous", "sensor-suspect", "unknown")
KEYS = (
    "verdict", "effects", "alternatives", "unexplained_rest", "localisation", "change_points", "inferred", "fit",
    "advice", "battery_file",
)  # fmt: skip


class UnreadableError(Exception):
    """Findings that are not what the interface says."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter as a tool gives it."""

    value: float
    sd: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class Region:
    """Where a tool says that the misfit sits."""

    where: Mapping[str, tuple[float, float]]
    flights: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """A tool's findings.json."""

    verdict: Verdict
    with_rest: bool
    effects: tuple[str, ...]
    parameters: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    alternatives: tuple[Names, ...] = ()
    regions: tuple[Region, ...] = ()
    change_points: tuple[Moment, ...] = ()
    fit: Mapping[str, float] = field(default_factory=dict)

    def without(self, permitted: Names) -> Findings:
        """The same without names that count neither way; nothing else named is no claim."""
        left = tuple(effect for effect in self.effects if effect not in permitted)
        if left == self.effects:
            return self
        verdict: Verdict = "none" if not left and self.verdict != UNKNOWN else self.verdict
        sets = tuple(names - permitted for names in self.alternatives if names - permitted)
        return replace(self, verdict=verdict, effects=left, alternatives=sets)

    @property
    def claims(self) -> bool:
        """Whether it says that physics is missing (a shifted parameter or too little excitation is no such claim)."""
        return self.verdict in _CLAIMS

    @property
    def first(self) -> str | None:
        """The first name, where it names anything."""
        return self.effects[0] if self.claims and self.effects else None

    @property
    def chosen(self) -> Names:
        """What it says, as an answer's ``accept`` would."""
        if not self.claims:
            return frozenset({NONE})
        return frozenset(self.effects) or frozenset({UNKNOWN})

    @property
    def candidates(self) -> tuple[Names, ...]:
        """The chosen set and all that it says cannot be told from it, each once."""
        return tuple(dict.fromkeys((self.chosen, *self.alternatives)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came back for one case; without findings, ``failure`` says why.

    refused : it said in a sentence that the recordings cannot be used (exit status 2).
    oracle_heldout_v : held-out RMSE of the same fitter, told the structure. [V]
    rft_error_s : median RFT error before and after the repair, in the second half of flights nobody showed it. [s]
    """

    case: str
    findings: Findings | None
    failure: str = ""
    refused: bool = False
    inferred: Mapping[str, Series] = field(default_factory=dict)
    seconds: float | None = None
    cpu_seconds: float | None = None
    peak_mib: float | None = None
    oracle_heldout_v: float | None = None
    rft_error_s: tuple[float, float] | None = None


def findings_from_json(given: Mapping[str, Any]) -> Findings:
    """Findings as written. Raises UnreadableError naming the key where they are not what the interface says."""
    missing = [key for key in KEYS if key not in given]
    if missing:
        raise UnreadableError(f"findings.json lacks {', '.join(missing)}")
    words = str(given["verdict"]).lower()
    verdict = next((v for v in VERDICTS if words.split("+")[0].strip().replace(" ", "-") == v), None)
    if verdict is None:
        raise UnreadableError(f"verdict {given['verdict']!r} is none of {', '.join(VERDICTS)}")
    try:
        return Findings(
            verdict=verdict,
            with_rest=float(given["unexplained_rest"] or 0.0) >= REST,
            effects=tuple(str(effect["id"]) for effect in given["effects"]),
            parameters={e["id"]: {k: _estimate(q) for k, q in e["parameters"].items()} for e in given["effects"]},
            alternatives=tuple(frozenset(names) for names in given["alternatives"]),
            regions=tuple(
                Region(
                    {k: (_edge(v[0], -math.inf), _edge(v[1], math.inf)) for k, v in r["where"].items()},
                    tuple(str(flight) for flight in r["flights"]),
                )
                for r in given["localisation"]
            ),
            change_points=tuple(Moment(str(c["flight"]), float(c["time_s"])) for c in given["change_points"]),
            fit={key: float(v) for key, v in (given["fit"] or {}).items() if isinstance(v, int | float)},
        )
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as why:
        raise UnreadableError(f"findings.json: {type(why).__name__} {why}") from None


def outcome_from_json(given: Mapping[str, Any]) -> Outcome:
    """One collected outcome; findings that cannot be read become a failure."""
    findings, failure = None, str(given.get("failure", ""))
    if given.get("findings") is not None:
        try:
            findings = findings_from_json(given["findings"])
        except UnreadableError as why:
            failure = str(why)
    return Outcome(
        case=given["case"],
        findings=findings,
        failure=failure,
        refused=bool(given.get("refused", False)),
        inferred={f: {k: tuple(map(float, v)) for k, v in of.items()} for f, of in given.get("inferred", {}).items()},
        seconds=given.get("seconds"),
        cpu_seconds=given.get("cpu_seconds"),
        peak_mib=given.get("peak_mib"),
        oracle_heldout_v=given.get("oracle_heldout_v"),
        rft_error_s=None if given.get("rft_error_s") is None else tuple(given["rft_error_s"]),
    )


def _estimate(given: Mapping[str, Any]) -> Estimate:
    sd = given.get("sd")
    return Estimate(float(given["value"]), None if sd is None else float(sd), str(given.get("unit", "")))


def _edge(value: Any, open_end: float) -> float:
    return open_end if value is None else float(value)
