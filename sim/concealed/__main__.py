"""Make concealed cases: python -m sim.concealed SUITE SEED -o DIR [--count N]."""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from sim.concealed.answer import Answer
from sim.concealed.generate import generate
from sim.concealed.sheets import CaseSheet
from sim.concealed.suites import SUITES, draw_suite


def make(sheet: CaseSheet, cases: Path, answers: Path) -> Answer:
    """One case and its answer, in their two directories."""
    answer = generate(sheet, cases / sheet.name)
    answers.mkdir(parents=True, exist_ok=True)
    (answers / f"{sheet.name}.json").write_text(answer.as_json())
    return answer


def _table(answers: list[Answer]) -> Table:
    table = Table(title="Concealed cases")
    for name in ("case", "kind", "effects", "SNR", "noise", "withheld"):
        table.add_column(name, justify="right" if name == "SNR" else "left", overflow="fold")
    for answer in sorted(answers, key=lambda a: a.index):
        effects = "\n".join(f"{e.size} {e.name}" for e in answer.effects) or "none"
        withheld = ", ".join(answer.withheld)
        table.add_row(answer.case, answer.kind, effects, f"{answer.snr:.1f}", answer.noise, withheld)
    return table


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m sim.concealed", description=__doc__)
    parser.add_argument("suite", choices=sorted(SUITES))
    parser.add_argument("seed", type=int)
    parser.add_argument("-o", "--output", type=Path, required=True, help="cases/ and answers/ are written below it")
    parser.add_argument("--count", type=int, help="how many cases, in the suite's proportions")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one process for each core; threads would fight
    sheets = draw_suite(given.suite, given.seed, given.count)
    cases, answers = given.output / "cases", given.output / "answers"
    columns = (TextColumn("making cases"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    made: list[Answer] = []
    with Progress(*columns) as progress, ProcessPoolExecutor(max_workers=os.cpu_count()) as pool:
        task = progress.add_task("", total=len(sheets))
        for future in as_completed([pool.submit(make, sheet, cases, answers) for sheet in sheets]):
            made.append(future.result())
            progress.advance(task)
    Console().print(_table(made))


if __name__ == "__main__":
    main()
