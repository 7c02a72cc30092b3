"""The score card in a terminal, within 100 columns."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim.proof.run import Proof
from sim.proof.scoring.score import SuiteScore
from sim.proof.words import ABOUT, HEADER, circumstances, line, outcome, shown

_STYLES = {"met": "green", "MISSED": "bold red", "open": "yellow"}


def _failures(score: SuiteScore) -> dict[str, list[str]]:
    """Cases by the reason why nothing came of them."""
    found: dict[str, list[str]] = {}
    for judged in score.judgements:
        if judged.failure:
            found.setdefault(judged.failure, []).append(judged.case)
    return found


def show(console: Console, proof: Proof) -> None:
    """Print it."""
    console.print(f"\n{outcome([*proof.scores])}", style="bold", markup=False)
    for score in proof.scores:
        console.print(f"\n{score.suite}: {ABOUT.get(score.suite, '')}, {len(score.judgements)} cases", markup=False)
        table = Table(box=None, padding=(0, 1, 0, 0))
        for k, name in enumerate(HEADER):
            table.add_column(name, justify="left" if k in (0, 5) else "right", no_wrap=True)
        for row in shown(score):
            cells = line(row)
            table.add_row(*map(escape, cells), style=_STYLES.get(cells[-1], ""))
        console.print(table)
        for why, cases in _failures(score).items():
            console.print(f"  {cases[0]} and {len(cases) - 1} more: {why}"[:300], style="red", markup=False)
    console.print(f"\n{circumstances(proof.about)}", style="dim", markup=False)
