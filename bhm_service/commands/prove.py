"""`bhm prove`: the proof on concealed data, with its progress and its score card."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from sim.proof.card import write_card
from sim.proof.run import Proof, Request, all_met, prove, scored
from sim.proof.terminal import show

_WIDTH = 100


def prove_it(
    suites: tuple[str, ...], seed: int | None, cases: int | None, jobs: int, answerer: str, keep: bool, output: Path
) -> int:
    """Run and score; the exit status is 0 when every target is met, else 1."""
    request = Request(suites=suites, seed=seed, cases=cases, jobs=jobs, answerer=answerer, keep=keep, output=output)
    out, err = Console(width=_WIDTH, highlight=False), Console(stderr=True, width=_WIDTH, highlight=False)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bar:
        tasks: dict[str, TaskID] = {}

        def progress(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done)

        proof = prove(request, lambda line: out.print(line, markup=False), progress)
    return _reported(out, proof, request.output)


def score_again(folder: Path) -> int:
    """Check the seal of a finished run and score it again."""
    return _reported(Console(width=_WIDTH, highlight=False), scored(folder), folder)


def _reported(out: Console, proof: Proof, folder: Path) -> int:
    written = write_card(folder, proof)
    show(out, proof)
    out.print(f"written: {', '.join(path.name for path in written)} in {folder}", markup=False)
    return 0 if all_met(proof.scores) else 1
