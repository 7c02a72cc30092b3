"""A proof from the draw to the score: cases drawn, answers sealed, tool run, hash checked, opened, scored."""

from __future__ import annotations

import hashlib
import json
import platform
import secrets
import shutil
import subprocess
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol

from bhm_service.discrepancy.cores import available
from bhm_service.errors import BadInputError
from sim.proof.answerers import Answerer, answerer
from sim.proof.cases import Batch, Case
from sim.proof.confine import close_memory, confinement
from sim.proof.flying_time import flying_times
from sim.proof.scoring.answers import Answer
from sim.proof.scoring.findings import outcome_from_json
from sim.proof.scoring.judge import judge
from sim.proof.scoring.names import DEMAND_EFFECTS, EFFECTS
from sim.proof.scoring.score import SuiteScore, score
from sim.proof.sealing import opened, seal, write_opened, write_sealed
from sim.proof.suites import SHARED, checked_seed, exam_seed, suite

OUTCOMES, ENDED = "outcomes.json", "ended.json"
_MOST_TOLD = 16  # cases of a suite that are fitted again with their effects told
_MOST_FLOWN_ON = 16  # cases of a suite whose flying time is examined: each is 40 s of replay
_ROOT = Path(__file__).resolve().parents[2]
_ENTROPY_BITS = 48


class Progress(Protocol):
    """Told what is being done and how far it is."""

    def __call__(self, what: str, done: int, total: int) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What to prove."""

    suites: tuple[str, ...]
    seed: int | None  # None: an exam, drawn now
    cases: int | None = None  # of each suite; None: as many as it has
    jobs: int = 2
    answerer: str = "tool"
    output: Path
    flying: bool = True  # replay flights kept back, with the battery as it was and as it was repaired
    keep: bool = False  # cases and everything that was written, not only what is scored


@dataclass(frozen=True, slots=True)
class Proof:
    """A finished run."""

    about: dict[str, Any]
    answers: dict[str, list[Answer]]
    outcomes: list[dict[str, Any]]
    scores: tuple[SuiteScore, ...]


def prove(request: Request, said: Callable[[str], None], progress: Progress) -> Proof:
    """Run it all. ``said`` is given the hash before the tool runs, and the seed after.

    Raises BadInputError for an unknown suite or answerer, a seed that belongs to exams, an output folder that holds
    an earlier run, and answers that are not those that were sealed.
    """
    close_memory()
    exam = request.seed is None
    seed = exam_seed(secrets.randbits(_ENTROPY_BITS)) if request.seed is None else checked_seed(request.seed, exam)
    chosen = [suite(name) for name in dict.fromkeys(request.suites)]
    folder = _fresh(request.output.resolve())  # the tool runs in a folder of its own
    held = folder / "held"
    held.mkdir(mode=0o700)
    kept_in = confinement([SHARED, held])
    who = answerer(request.answerer, folder, kept_in, max(1, available() // request.jobs))
    begin = datetime.now(UTC)
    batches = {s.name: s.draw(seed, request.cases or s.cases) for s in chosen}
    answers = _made(batches, folder, held, request.jobs, progress)
    sealed = seal(answers, seed)
    about = {
        "answerer": request.answerer,
        "suites": {name: len(of) for name, of in answers.items()},
        "exam": exam,
        "started": begin.isoformat(timespec="seconds"),
        "confinement": kept_in.words(),
        **_versions(),
    }
    write_sealed(folder, sealed, about)
    said(f"sealed: SHA-256 {sealed.digest}")
    outcomes = _answered(answers, who, folder, request.jobs, progress)
    (folder / OUTCOMES).write_text(json.dumps(outcomes) + "\n")
    write_opened(folder, sealed)
    times = _flown_on(answers, outcomes, folder, request.jobs, progress) if request.flying else {}
    best = _told(answers, outcomes, who, folder, request.jobs, progress)
    seconds = round((datetime.now(UTC) - begin).total_seconds(), 1)
    (folder / ENDED).write_text(json.dumps({"seconds": seconds, "rft_error_s": times, "oracle_heldout_v": best}) + "\n")
    proof = scored(folder)
    said(f"opened: the hash is the one that was sealed; seed {proof.about['seed']}")
    if not request.keep:
        for name in ("cases", "verdicts", "held", "told", "batteries"):
            shutil.rmtree(folder / name, ignore_errors=True)
    return proof


def scored(folder: Path) -> Proof:
    """A finished run's folder, checked against its seal and scored again.

    Raises BadInputError where the answers are not those that were sealed, or the folder holds no finished run.
    """
    try:
        about = json.loads((folder / "sealed.json").read_text())
        seed, answers = opened(folder)
        outcomes = json.loads((folder / OUTCOMES).read_text())
        ended = json.loads((folder / ENDED).read_text())
    except FileNotFoundError as why:
        raise BadInputError(str(folder), f"holds no finished run: {Path(why.filename).name} is missing") from None
    after = ("rft_error_s", "oracle_heldout_v")
    read = [outcome_from_json(o | {name: ended[name].get(o["case"]) for name in after}) for o in outcomes]
    scores = tuple(score(name, of, read) for name, of in answers.items())
    return Proof(about | {"seed": seed, "seconds": ended["seconds"]}, answers, outcomes, scores)


def _fresh(folder: Path) -> Path:
    """The output folder; one run each."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as why:
        raise BadInputError(str(folder), f"cannot be made: {why.strerror}") from None
    if any(folder.iterdir()):
        raise BadInputError(str(folder), "is not empty", "a run that is scored stays as it is: choose another -o")
    return folder


def _made(
    batches: dict[str, list[Batch]], folder: Path, held: Path, jobs: int, progress: Progress
) -> dict[str, list[Answer]]:
    """Write every case; the answers stay in memory."""
    found: dict[str, list[Answer]] = {name: [] for name in batches}
    visible = folder / "cases"
    visible.mkdir()
    total, done = sum(map(len, batches.values())), 0
    progress("drawing cases", 0, total)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=close_memory) as pool:
        waiting = {pool.submit(batch, visible, held): name for name, of in batches.items() for batch in of}
        for future in as_completed(waiting):
            found[waiting[future]] += future.result()
            done += 1
            progress("drawing cases", done, total)
    return {name: sorted(of, key=lambda a: a.case) for name, of in found.items()}


def _answered(
    answers: dict[str, list[Answer]], who: Answerer, folder: Path, jobs: int, progress: Progress
) -> list[dict[str, Any]]:
    """Every case to the answerer, which is told nothing unless it is the oracle."""
    everyone = [answer for of in answers.values() for answer in of]

    def one(answer: Answer) -> dict[str, Any]:
        out = folder / "verdicts" / answer.case
        out.mkdir(parents=True)
        return who.answer(Case(folder / "cases" / answer.case), out, answer if who.needs_answer else None)

    found: list[dict[str, Any]] = []
    progress("collecting verdicts", 0, len(everyone))
    with ThreadPoolExecutor(jobs) as pool:
        waiting: list[Future[dict[str, Any]]] = [pool.submit(one, answer) for answer in everyone]
        for future in as_completed(waiting):
            found.append(future.result())
            progress("collecting verdicts", len(found), len(everyone))
    return sorted(found, key=lambda o: str(o["case"]))


def _flown_on(
    answers: dict[str, list[Answer]], outcomes: list[dict[str, Any]], folder: Path, jobs: int, progress: Progress
) -> dict[str, tuple[float, float]]:
    """Flying time on flights kept back, of the first cases of every suite whose effect was found and repaired."""
    by_case = {o["case"]: o for o in outcomes}
    asked = []
    for of in answers.values():
        found = [a for a in of if a.held and judge(a, outcome_from_json(by_case[a.case])).first_right]
        for answer in found[:_MOST_FLOWN_ON]:
            before, after = (_battery(folder, by_case[answer.case], when) for when in ("before", "after"))
            if before is not None and after is not None:
                asked.append((answer, before, after, Case(folder / "cases" / answer.case).series))
    if not asked:
        return {}
    return flying_times(asked, folder / "held", jobs, lambda done, of: progress("flying on", done, of))


def _told(
    answers: dict[str, list[Answer]],
    outcomes: list[dict[str, Any]],
    who: Answerer,
    folder: Path,
    jobs: int,
    progress: Progress,
) -> dict[str, float]:
    """Held-out errors of the same fitter when it is told the effects, for the first cases of every suite that has any.

    The answers are open by now; what it is told cannot change a verdict.
    """
    came_back = {o["case"] for o in outcomes if o.get("findings") is not None}
    asked = []
    for of in answers.values():
        known = [a for a in of if _of_pack(a) and a.truth <= set(EFFECTS) and a.case in came_back]
        asked += known[:_MOST_TOLD]

    def one(answer: Answer) -> tuple[str, float | None]:
        out = folder / "told" / answer.case
        out.mkdir(parents=True)
        return answer.case, who.told(Case(folder / "cases" / answer.case), out, _of_pack(answer))

    if not asked or not who.can_be_told:
        return {}
    found: dict[str, float] = {}
    progress("telling the effects", 0, len(asked))
    with ThreadPoolExecutor(jobs) as pool:
        for done, (case, volts) in enumerate(pool.map(one, asked), start=1):
            if volts is not None:
                found[case] = volts
            progress("telling the effects", done, len(asked))
    return found


def _of_pack(answer: Answer) -> list[str]:
    """What of an answer shows in the voltage for a given current."""
    return sorted(answer.truth - set(DEMAND_EFFECTS))


def _battery(folder: Path, outcome: dict[str, Any], when: str) -> Path | None:
    """The battery file that a case was examined with, or the one that it was given back."""
    named = outcome.get("battery") if when == "before" else outcome["findings"].get("battery_file")
    if not isinstance(named, str):
        return None
    path = Path(named) if when == "before" else folder / "verdicts" / outcome["case"] / named
    return path if path.is_file() else None


def _versions() -> dict[str, Any]:
    """What ran: package, commit, assessor and machine."""
    assessor = hashlib.sha256()
    for path in sorted((Path(__file__).parent / "scoring").glob("*.py")):
        assessor.update(path.read_bytes())
    return {
        "version": version("bhm-service"),
        "commit": _commit(),
        "assessor_sha256": assessor.hexdigest(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "scipy": version("scipy"),
    }


def _commit() -> str:
    """The commit, with a + where files differ from it."""

    def git(*words: str) -> str:
        run = subprocess.run(["git", "-C", str(_ROOT), *words], capture_output=True, text=True, check=False)
        return run.stdout.strip() if run.returncode == 0 else ""

    commit = git("rev-parse", "--short=10", "HEAD")
    return f"{commit}{'+' if git('status', '--porcelain') else ''}" if commit else "unknown"


def all_met(scores: Sequence[SuiteScore]) -> bool:
    """Whether no target was missed and every one could be computed."""
    return all(s.failed == 0 and s.open == 0 for s in scores)
