"""A suite's score: rates, medians and whether they reach what issues 4 and 5 ask for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from sim.proof.scoring.answers import Answer
from sim.proof.scoring.findings import Outcome
from sim.proof.scoring.judge import Judgement, judge
from sim.proof.scoring.names import EFFECTS
from sim.proof.scoring.rates import Rate, coverage, quantile, rate

SNR_CLASSES = ((3.0, 5.0), (5.0, 15.0), (15.0, math.inf))
_SHOWN_FROM_SNR = 3.0  # below, an effect is not excited: no method finds it


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the score card. ``met`` is None where there is no target or nothing to compute it from."""

    name: str
    value: float
    n: int
    target: str = ""
    met: bool | None = None
    interval: tuple[float, float] | None = None
    percent: bool = False
    note: str = ""


@dataclass(frozen=True, slots=True)
class SuiteScore:
    """One suite's score."""

    suite: str
    judgements: tuple[Judgement, ...]
    rows: tuple[Row, ...]
    never_shown: tuple[str, ...]  # effects that no recording of the suite could show

    @property
    def failed(self) -> int:
        """Targets that were computed and missed."""
        return sum(row.met is False for row in self.rows)

    @property
    def open(self) -> int:
        """Targets that there was nothing to compute from."""
        return sum(row.met is None and bool(row.target) for row in self.rows)

    def confusion(self) -> tuple[list[str], list[str], list[list[int]]]:
        """Truth classes (rows), what was said (columns, the same classes first) and counts."""
        truths = sorted({j.label for j in self.judgements})
        said = truths + sorted({j.said for j in self.judgements} - set(truths))
        counts = [[sum(j.label == t and j.said == s for j in self.judgements) for s in said] for t in truths]
        return truths, said, counts

    def errors_z(self) -> list[float]:
        """All parameter errors in their own standard deviations."""
        return [p.z for j in self.judgements for p in j.parameters if p.z is not None]


@dataclass(frozen=True, slots=True)
class Bound:
    """A target: a bound on a row's value."""

    at_most: float = math.inf
    at_least: float = -math.inf
    fewest: int = 1  # of fewer nothing is said: of ten intervals no share lies between 85 and 95 % but 90

    def words(self, percent: bool) -> str:
        """As people read it."""
        scale, unit = (100.0, " %") if percent else (1.0, "")
        low, high = f"{scale * self.at_least:.4g}", f"{scale * self.at_most:.4g}"
        if math.isinf(self.at_most):
            return f"≥ {low}{unit}"
        return f"≤ {high}{unit}" if math.isinf(self.at_least) else f"{low}-{high}{unit}"


PRECISION, FALSE_ALARMS = "naming precision, one effect", "false alarms on nulls"
ANSWERED = "cases answered right"
OF_ORACLE = "share of what an oracle gains, median"
CRITERIA = "criteria of real recordings met"
TARGETS: Mapping[str, Mapping[str, Bound]] = {
    "concealed": {
        PRECISION: Bound(at_least=0.97),
        FALSE_ALARMS: Bound(at_most=2 / 150),
        "found at SNR over 15": Bound(at_least=0.9),
        "found at SNR 5-15": Bound(at_least=0.75),
        "two effects or more: all found": Bound(at_least=0.75),
        "two effects or more: a spurious extra": Bound(at_most=0.12),
        "out of catalogue: flagged": Bound(at_least=0.9),
        "parameter error, median": Bound(at_most=0.08),
        "coverage of 90 % intervals": Bound(at_least=0.85, at_most=0.95, fewest=20),
        "RFT error after over before, median": Bound(at_most=0.5),
        "time a case, median [s]": Bound(at_most=15.0),
        "time a case, longest [s]": Bound(at_most=45.0),
        "peak memory [MiB]": Bound(at_most=1024.0),
    },
    "truth": {PRECISION: Bound(at_least=0.9), FALSE_ALARMS: Bound(at_most=0.0)},
    "shared": {ANSWERED: Bound(at_least=1.0), "change points found within 10 s": Bound(at_least=1.0)},
    "real": {CRITERIA: Bound(at_least=1.0)},
}
"""Per family of suites, from issues 4 and 5."""


def family(suite: str) -> str:
    """Which targets a suite answers to: development and exam are held to the same."""
    return suite if suite in TARGETS else "concealed"


def score(suite: str, answers: Sequence[Answer], outcomes: Sequence[Outcome]) -> SuiteScore:
    """Judge every case and sum up; a case without an outcome counts as failed."""
    by_case = {outcome.case: outcome for outcome in outcomes}
    silent = {a.case: Outcome(case=a.case, findings=None, failure="nothing came back") for a in answers}
    judgements = tuple(judge(answer, by_case.get(answer.case, silent[answer.case])) for answer in answers)
    targets = TARGETS[family(suite)]
    rows = tuple(_against(row, targets.get(row.name)) for row in _rows(judgements))
    return SuiteScore(suite, judgements, rows, _never_shown(answers))


def _against(row: Row, bound: Bound | None) -> Row:
    if bound is None:
        return row
    few = math.isnan(row.value) or row.n < bound.fewest
    met = None if few else bound.at_least <= row.value <= bound.at_most + 1e-12
    return Row(row.name, row.value, row.n, bound.words(row.percent), met, row.interval, row.percent, row.note)


def _rows(judged: Sequence[Judgement]) -> list[Row]:
    def these(stratum: str) -> list[Judgement]:
        return [j for j in judged if j.stratum == stratum]

    single, several, null, unknown = (these(s) for s in ("single", "several", "null", "unknown"))
    ambiguous = [j for j in judged if j.ambiguous]
    found = [j for j in single + several if j.first_right]
    rows = [
        _share(ANSWERED, rate(j.accepted for j in judged)),
        _share(PRECISION, rate(j.first_right for j in single)),
        _share("naming precision, every claim", rate(j.first_right for j in judged)),
        _share(FALSE_ALARMS, rate(j.claims for j in null)),
    ]
    for low, high in SNR_CLASSES:
        words = f"over {low:g}" if math.isinf(high) else f"{low:g}-{high:g}"
        inside = [j for j in single if j.snr is not None and low <= j.snr < high]
        rows.append(_share(f"found at SNR {words}", rate(bool(j.first_right) for j in inside)))
    rows += [
        _share("found, SNR not known", rate(bool(j.first_right) for j in single if j.snr is None)),
        _share("one effect: a spurious extra", rate(j.extra for j in single)),
        _share("two effects or more: all found", rate(j.all_found for j in several)),
        _share("two effects or more: exactly these", rate(j.exact for j in several)),
        _share("two effects or more: at least one", rate(j.any_found for j in several)),
        _share("two effects or more: a spurious extra", rate(bool(j.extra) for j in several)),
        _share("designed-ambiguous: set holds the truth", rate(j.set_holds_truth for j in ambiguous)),
        _number("designed-ambiguous: mean set size", [float(j.set_size) for j in ambiguous if j.set_size], _mean),
        _share("out of catalogue: flagged", rate(j.flagged for j in unknown)),
        _share("catalogue suffices: flagged all the same", rate(j.rest for j in single + several + null)),
        _share("out of catalogue: named without a flag", rate(j.first is not None and not j.flagged for j in unknown)),
    ]
    errors = [p.relative_error for j in found for p in j.parameters]
    z = [p.z for j in found for p in j.parameters if p.z is not None]
    rows += [
        _number("parameter error, median", errors, percent=True),
        _number("parameter error, 90th percentile", errors, lambda v: quantile(v, 0.9), percent=True),
        _share("coverage of 90 % intervals", coverage(z, 0.9)),
        _measured("held-out RMSE after over before, median", found, "heldout_ratio"),
        _measured(OF_ORACLE, judged, "share_of_oracle"),
        _measured("RFT error after over before, median", found, "rft_ratio"),
        _measured("RFT error before, median [s]", found, "rft_before_s"),
        _measured("RFT error after, median [s]", found, "rft_after_s"),
        _measured("localisation overlap (IoU), median", judged, "iou"),
        _measured("change points found within 10 s", judged, "change_points_found", _mean),
        _number("time a case, median [s]", [j.seconds for j in judged if j.seconds is not None]),
        _number("time a case, longest [s]", [j.seconds for j in judged if j.seconds is not None], max),
        _number("processor time a case, median [s]", [j.cpu_seconds for j in judged if j.cpu_seconds is not None]),
        _number("peak memory [MiB]", [j.peak_mib for j in judged if j.peak_mib is not None], max),
        _share("no answer at all", rate(bool(j.failure) for j in judged)),
    ]
    asked = [c for j in judged for c in j.criteria]
    return [*rows, _share(CRITERIA, rate(met for *_, met in asked))]


def _share(name: str, found: Rate) -> Row:
    return Row(name, found.value, found.n, interval=found.interval if found.n else None, percent=True)


def _number(
    name: str, values: Sequence[float], of: Callable[[Sequence[float]], float] | None = None, *, percent: bool = False
) -> Row:
    take = of or (lambda v: quantile(v, 0.5))
    return Row(name, take(values) if values else float("nan"), len(values), percent=percent)


def _measured(
    name: str, judged: Sequence[Judgement], measure: str, of: Callable[[Sequence[float]], float] | None = None
) -> Row:
    values = [j.measures[measure] for j in judged if measure in j.measures]
    row = _number(name, values, of)
    reasons = sorted({m for j in judged for m in j.missing if m.startswith(f"{measure}:")})
    return Row(row.name, row.value, row.n, note="" if values or not reasons else reasons[0])


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _never_shown(answers: Sequence[Answer]) -> tuple[str, ...]:
    """Effects that a suite holds in no case, or only where they are too small to be seen."""
    shown: set[str] = set()
    for answer in answers:
        if answer.snr is None or answer.snr >= _SHOWN_FROM_SNR:
            shown |= answer.truth
    return tuple(name for name in EFFECTS if name not in shown)
