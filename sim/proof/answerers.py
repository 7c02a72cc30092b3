"""Who answers: the tool, by its two commands, or a stand-in. Each gets a case's folder and an empty one."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, Protocol

from bhm_service.errors import BadInputError
from sim.proof.cases import Case
from sim.proof.confine import Confinement, Ran
from sim.proof.inferred import inferred_series
from sim.proof.scoring.answers import Answer, answer_to_json
from sim.proof.scoring.names import EFFECTS

_ROOT = Path(__file__).resolve().parents[2]
_LONGEST_S = 1800.0  # of the wall clock: on a crowded machine an identification of 15 s has taken over ten minutes
_THREADS = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_REFUSED = 2  # exit status of bad input, with its sentence
_TOLD = 300  # characters of what a failed program said


class Answerer(Protocol):
    """Answers one case; `Outcome` as JSON."""

    @property
    def needs_answer(self) -> bool:
        """Whether it is handed the answer: only the oracle is."""
        ...

    @property
    def can_be_told(self) -> bool:
        """Whether `told` is worth a call."""
        ...

    def answer(self, case: Case, out: Path, answer: Answer | None) -> dict[str, Any]:
        """What comes back for a case. ``answer`` is there for an oracle only."""
        ...

    def told(self, case: Case, out: Path, effects: Sequence[str]) -> float | None:
        """Held-out RMSE [V] of its own fitter when it is told the effects; None where it cannot be told."""
        ...


@dataclass(slots=True)
class StandIn:
    """One of `sim.proof.standins`."""

    name: str
    confinement: Confinement
    can_be_told: bool = False

    @property
    def needs_answer(self) -> bool:
        return self.name == "oracle"

    def answer(self, case: Case, out: Path, answer: Answer | None) -> dict[str, Any]:
        command = [sys.executable, "-m", "sim.proof.standins", self.name, str(case.folder), str(out)]
        told = out / "answer.json"
        if answer is not None:
            told.write_text(json.dumps(answer_to_json(answer)))
            command += ["--answer", str(told)]
        ran = self.confinement.run(command, out, _LONGEST_S, _environment())
        told.unlink(missing_ok=True)
        return _collected(case, out, ran)

    def told(self, case: Case, out: Path, effects: Sequence[str]) -> float | None:
        return None


@dataclass(slots=True)
class Tool:
    """`bhm identify`, once for a pack, and `bhm explain`; only the second is timed."""

    batteries: Path
    confinement: Confinement
    needs_answer: bool = False
    can_be_told: bool = False
    cores: int = 1  # for one case
    _locks: dict[str, Lock] = field(default_factory=dict)
    _lock: Lock = field(default_factory=Lock)

    def answer(self, case: Case, out: Path, answer: Answer | None) -> dict[str, Any]:
        battery, failure = case.battery, ""
        if battery is None:
            battery, failure = self._identified(case)
        if failure:
            return {"case": case.name, "failure": failure}
        ran = self.confinement.run(self._explain(case, battery, out), out, _LONGEST_S, _environment())
        return {**_collected(case, out, ran), "battery": str(battery.resolve())}

    def told(self, case: Case, out: Path, effects: Sequence[str]) -> float | None:
        battery = case.battery or self._identified(case)[0]
        command = [*self._explain(case, battery, out), "--told", "+".join(effects)]
        self.confinement.run(command, out, _LONGEST_S, _environment())
        try:
            found = json.loads((out / "findings.json").read_text())["fit"]["heldout_after_V"]
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return float(found) if isinstance(found, int | float) else None

    def _explain(self, case: Case, battery: Path, out: Path) -> list[str]:
        command = [*_bhm("explain"), *map(str, case.flights), "--battery", str(battery), "-o", str(out)]
        command += ["--cores", str(self.cores)]
        if case.vehicle is not None:
            command += ["--vehicle", str(case.vehicle)]
        if case.sidecar is not None:
            command += ["--sidecar", str(case.sidecar)]
        return command

    def _identified(self, case: Case) -> tuple[Path, str]:
        """The battery of a case's lab recordings, and why there is none."""
        digest = case.lab_digest()
        with self._lock:
            lock = self._locks.setdefault(digest, Lock())
        path, said = self.batteries / f"{digest}.toml", self.batteries / f"{digest}.failed"
        with lock:
            if not path.exists() and not said.exists():
                command = [*_bhm("identify"), *(w for o, f in case.lab.items() for w in (o, str(f)))]
                command += ["--series", str(case.series), "-o", str(path)]
                ran = self.confinement.run(command, self.batteries, _LONGEST_S, _environment())
                if ran.status != 0 or not path.exists():
                    said.write_text(f"bhm identify: {_why(ran)}")
        return path, said.read_text() if said.exists() else ""


def answerer(name: str, folder: Path, confinement: Confinement, cores: int = 1) -> Tool | StandIn:
    """An answerer by its name, with so many cores for a case. Raises BadInputError for one that is not known."""
    who, _, what = name.partition(":")
    if name == "tool":
        batteries = folder / "batteries"
        batteries.mkdir(parents=True, exist_ok=True)
        options = confinement.run([*_bhm("explain"), "--help"], batteries, _LONGEST_S, _environment()).said
        if "--battery" not in options:
            raise BadInputError(
                "--answerer tool", "there is no bhm explain here", "stand-ins: none, random, oracle ..."
            )
        return Tool(batteries, confinement, can_be_told="--told" in options, cores=cores)
    known = name in ("none", "random", "oracle") or (who == "always" and what in EFFECTS)
    known = known or (who == "random" and what.isdigit())
    if not known:
        raise BadInputError(
            f"--answerer {name}", "is not known", "known are tool, none, always:EFFECT, random[:SEED], oracle"
        )
    return StandIn(name, confinement)


def _bhm(command: str) -> list[str]:
    return [sys.executable, "-m", "bhm_service.cli", command]


def _environment() -> Mapping[str, str]:
    kept = {key: os.environ[key] for key in ("PATH", "HOME", "LANG", "TMPDIR") if key in os.environ}
    return {**kept, **_THREADS, "PYTHONPATH": str(_ROOT), "PYTHONHASHSEED": "0", "COLUMNS": "100"}


def _collected(case: Case, out: Path, ran: Ran) -> dict[str, Any]:
    found: dict[str, Any] = {
        "case": case.name,
        "seconds": round(ran.seconds, 3),
        "cpu_seconds": round(ran.cpu_seconds, 3),
        "peak_mib": round(ran.peak_mib, 1),
    }
    path = out / "findings.json"
    if not path.is_file():
        return {**found, "failure": _why(ran), "refused": _refused(ran)}
    try:
        findings = json.loads(path.read_text())
        return {**found, "findings": findings, "inferred": inferred_series(findings, out)}
    except ValueError as why:
        return {**found, "failure": f"findings.json: {why}"}


def _refused(ran: Ran) -> bool:
    """Whether it said in its own sentence that the input cannot be used; a wrong option also ends with status 2."""
    return ran.status == _REFUSED and "bhm: " in ran.said and "Usage: " not in ran.said


def _why(ran: Ran) -> str:
    if ran.status is None:
        return f"not done after {_LONGEST_S:.0f} s"
    said = " ".join(ran.said.split())
    return f"exit status {ran.status}: {said[-_TOLD:]}" if said else f"exit status {ran.status} and not a word"
