"""An identification in the terminal, at most a hundred columns wide."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from bhm_service.identification.identify import Identified
from bhm_service.reporting.identified import (
    PARAMETER_HEADER,
    QUALITY_HEADER,
    error_text,
    headline,
    open_questions,
    parameters,
    quality,
    resistance,
    splits,
    subtitle,
)

_LABEL = 28  # columns of a recording's name
_MEANING = "meaning"


def identified_tables(identified: Identified) -> Sequence[RenderableType]:
    """What to print, in order: how good, what stays open, the parameters, where the error lies, remarks."""
    found: list[RenderableType] = [Text(subtitle(identified))]
    found += _lines(headline(identified), "bold")
    best = QUALITY_HEADER.index("best possible")
    shown = [k for k in range(len(QUALITY_HEADER)) if k != best or any(row[best] for row in quality(identified))]
    found.append(
        _table(
            "\nAbove 10 % SoC, modelled minus measured",
            [QUALITY_HEADER[k] for k in shown],
            [[row[k] for k in shown] for row in quality(identified)],
            left=3,
        )
    )
    found.append(Text("\nStep resistance, an independent check"))
    found += _lines(resistance(identified))
    keep = [k for k, name in enumerate(PARAMETER_HEADER) if name != _MEANING]
    for result in identified.results:
        rows = parameters(result)
        found.append(
            _table(
                f"\nParameters, {result.model}",
                [PARAMETER_HEADER[k] for k in keep],
                [[row.cells[k] for k in keep] for row in rows],
                left=1,
                styles=["" if row.told else "dim" for row in rows],
            )
        )
        found += _lines(open_questions(result), "yellow")
        found += _lines(result.remarks)
    for split in splits(identified):
        found.append(
            _table(
                f"\nWhere the error lies, {split.model}: RMSE [mV] by SoC, then by current (* held out)",
                ["", *split.header],
                [[label, *(error_text(e) for e in errors)] for label, errors in split.rows],
                left=1,
            )
        )
    found.append(Text(""))
    found += _lines(identified.remarks)
    return found


def _lines(lines: Sequence[str], style: str = "") -> list[RenderableType]:
    """Sentences, each set in from the left."""
    return [Padding(Text(f"- {line}", style=style), (0, 0, 0, 2), expand=False) for line in lines]


def _table(
    title: str, header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int, styles: Sequence[str] = ()
) -> Table:
    """A table without lines; the first ``left`` columns stand to the left."""
    table = Table(title=Text(title), title_justify="left", title_style="", box=None, padding=(0, 1, 0, 0))
    for k, name in enumerate(header):
        table.add_column(
            name,
            justify="left" if k < left else "right",
            no_wrap=k > 0,
            overflow="fold",
            max_width=_LABEL if k == 0 else None,
        )
    for k, row in enumerate(rows):
        table.add_row(*(Text(cell) for cell in row), style=styles[k] if styles else "")
    return table
