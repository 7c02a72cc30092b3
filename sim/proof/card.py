"""The score card: an HTML page that needs nothing else, and the same as JSON."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, select_autoescape
from plotly.offline import get_plotlyjs

from sim.proof.figures import figures
from sim.proof.run import Proof
from sim.proof.scoring.names import CLASSES, INDISTINGUISHABLE
from sim.proof.words import ABOUT, HEADER, circumstances, line, measure, outcome, shown


def write_card(folder: Path, proof: Proof) -> list[Path]:
    """Write `score.json` and `scorecard.html`."""
    as_json, page = folder / "score.json", folder / "scorecard.html"
    as_json.write_text(json.dumps(_json(proof), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    page.write_text(_page(proof), encoding="utf-8")
    return [page, as_json]


def _json(proof: Proof) -> dict[str, Any]:
    suites = {
        score.suite: {
            "rows": [asdict(row) for row in score.rows],
            "missed": score.failed,
            "not_computed": score.open,
            "never_shown": score.never_shown,
            "cases": [asdict(judged) for judged in score.judgements],
        }
        for score in proof.scores
    }
    found = _plain({"about": proof.about, "outcome": outcome(proof.scores), "suites": suites})
    assert isinstance(found, dict)
    return found


def _plain(item: Any) -> Any:
    """JSON has no NaN: what is not known is null."""
    if isinstance(item, dict):
        return {str(key): _plain(value) for key, value in item.items()}
    if isinstance(item, list | tuple | frozenset):
        return [_plain(value) for value in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item


def _page(proof: Proof) -> str:
    environment = Environment(loader=PackageLoader("sim.proof"), autoescape=select_autoescape())
    inferred = {o["case"]: o.get("inferred", {}) for o in proof.outcomes}
    suites = [
        {
            "name": score.suite,
            "about": ABOUT.get(score.suite, ""),
            "count": len(score.judgements),
            "lines": [line(row) for row in shown(score)],
            "notes": [f"{row.name}: {row.note}" for row in score.rows if row.note],
            "never_shown": score.never_shown,
            "figures": figures(score, proof.answers[score.suite], inferred),
            "criteria": [
                (j.group or j.case, *_criterion(asked))
                for j in sorted(score.judgements, key=lambda j: j.group)
                for asked in j.criteria
            ],
            "cases": [_case(judged) for judged in score.judgements],
        }
        for score in proof.scores
    ]
    return environment.get_template("card.html").render(
        outcome=outcome(proof.scores),
        missed=any(score.failed for score in proof.scores),
        circumstances=circumstances(proof.about),
        about=proof.about,
        suites=suites,
        header=HEADER,
        classes=[" / ".join(members) for members in CLASSES],
        indistinguishable=INDISTINGUISHABLE,
        plotly_js=get_plotlyjs(),
    )


def _criterion(asked: tuple[str, str, float | None, bool]) -> tuple[str, str, str, str]:
    name, bound, found, met = asked
    return measure(name), "not computed" if found is None else f"{found:.3g}", bound, "met" if met else "MISSED"


def _case(judged: Any) -> tuple[str, ...]:
    ratio = judged.measures.get("heldout_ratio")
    return (
        judged.case,
        judged.group,
        judged.kind,
        judged.label,
        "-" if judged.snr is None else f"{judged.snr:.1f}",
        judged.verdict,
        judged.said if judged.first is None else judged.first,
        "right" if judged.accepted else "WRONG",
        "-" if ratio is None else f"{ratio:.2f}",
        "-" if judged.seconds is None else f"{judged.seconds:.1f}",
        judged.failure,
    )
