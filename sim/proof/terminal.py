"""The score card in a terminal, within 100 columns."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim.proof.run import Proof
from sim.proof.words import ABOUT, HEADER, circumstances, line, outcome, shown

_STYLES = {"met": "green", "MISSED": "bold red", "open": "yellow"}


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
        for judged in score.judgements:
            if judged.failure:
                console.print(f"  {judged.case}: {judged.failure}"[:300], style="red", markup=False)
    console.print(f"\n{circumstances(proof.about)}", style="dim", markup=False)
