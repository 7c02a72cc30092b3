"""Stand-in answerers, each a program: `python -m sim.proof.standins WHO CASE OUT [--answer FILE]`.

They answer without looking at a recording: `none`, `always:EFFECT`, `random:SEED`, and `oracle`, which alone is handed
the answer. A score card that does not condemn the first three, or condemns the last, is broken.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import random
from pathlib import Path
from typing import Any

from sim.proof.scoring.answers import Answer, answer_from_json
from sim.proof.scoring.names import EFFECTS, NONE, UNKNOWN

_BEFORE_V, _NOISE_V = 0.2, 0.05  # what a stand-in claims of its fit; it has none
_SD = 0.05  # relative error that the oracle owns up to, and makes


def main() -> None:
    """Answer one case."""
    parser = argparse.ArgumentParser()
    parser.add_argument("who")
    parser.add_argument("case", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--answer", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    who, _, what = given.who.partition(":")
    if who == "oracle":
        findings = _oracle(answer_from_json(json.loads(given.answer.read_text())), given.out)
    elif who == "random":
        findings = _random(random.Random(f"{what} {_fingerprint(given.case)}"))
    else:
        findings = _findings("none", []) if who == "none" else _findings("named", [_effect(what, {})])
    (given.out / "findings.json").write_text(json.dumps(findings))


def _fingerprint(case: Path) -> str:
    """So that a random answer is of a case and not of its place in the suite."""
    files = sorted((case / "flights").iterdir())
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _random(dice: random.Random) -> dict[str, Any]:
    if dice.random() < 1.0 / 3.0:
        return _findings("none", [])
    return _findings("named", [_effect(dice.choice(EFFECTS), {})])


def _oracle(answer: Answer, out: Path) -> dict[str, Any]:
    right = next((names for names in answer.accept if names == answer.truth), answer.accept[0])
    dice = random.Random(answer.case)
    if right == frozenset({NONE}):
        findings = _findings("none", [])
    elif right == frozenset({UNKNOWN}):
        findings = _findings("unknown", [])
    else:
        effects = [_effect(name, _parameters(answer, name, dice)) for name in sorted(right)]
        findings = _findings("ambiguous" if answer.ambiguous else "named", effects)
        if answer.ambiguous:
            findings["alternatives"] = [sorted(names) for names in answer.accept if names != right]
    findings["change_points"] = [{"flight": m.flight, "time_s": m.time_s} for m in answer.change_points]
    findings["inferred"] = {flight: _written(out, flight, columns) for flight, columns in answer.hidden.items()}
    return findings


def _parameters(answer: Answer, effect: str, dice: random.Random) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for asked in answer.criteria:
        if asked.measure.startswith(f"parameter.{effect}.") and None not in (asked.at_least, asked.at_most):
            middle = (float(asked.at_least or 0.0) + float(asked.at_most or 0.0)) / 2.0
            found[asked.measure.rpartition(".")[2]] = {"value": middle, "sd": _SD * middle, "unit": ""}
    bounded = frozenset(found)
    for name, q in answer.parameters.get(effect, {}).items():
        sd = _SD * abs(q.value)
        value = found[name]["value"] if name in bounded else dice.gauss(q.value, sd)
        found[name] = {"value": value, "sd": sd, "unit": q.unit}
    return found


def _written(out: Path, flight: str, columns: Any) -> str:
    name = f"{flight.split('.')[0]}.inferred.csv"
    with (out / name).open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return name


def _effect(name: str, parameters: dict[str, Any]) -> dict[str, Any]:
    return {
        "id": name,
        "parameters": parameters,
        "evidence_nats": 0.0,
        "p_familywise": 1.0,
        "share_of_misfit": 1.0,
        "decoys_beaten": 1.0,
    }


def _findings(verdict: str, effects: list[dict[str, Any]]) -> dict[str, Any]:
    after = _NOISE_V if effects else _BEFORE_V
    return {
        "verdict": verdict,
        "effects": effects,
        "alternatives": [],
        "unexplained_rest": 0.0,
        "localisation": [],
        "change_points": [],
        "inferred": {},
        "fit": {
            "rmse_before_V": _BEFORE_V,
            "rmse_after_V": after,
            "heldout_before_V": _BEFORE_V,
            "heldout_after_V": after,
            "noise_floor_V": _NOISE_V,
        },
        "advice": [],
        "battery_file": None,
    }


if __name__ == "__main__":
    main()
