"""Ratios of our times to a peer's, collected over the run and printed at its end."""

from __future__ import annotations

import pytest

ROWS: list[tuple[str, str, str, str]] = []


@pytest.fixture
def row():
    """Note one line of the table: what, ours, theirs, ratio or verdict."""
    return lambda *cells: ROWS.append(cells)


def pytest_terminal_summary(terminalreporter):
    if not ROWS:
        return
    widths = [max(len(r[k]) for r in [*ROWS, ("what", "ours", "peer", "ratio")]) for k in range(4)]
    terminalreporter.write_line("")
    for cells in [("what", "ours", "peer", "ratio"), *ROWS]:
        terminalreporter.write_line("  ".join(c.ljust(w) for c, w in zip(cells, widths, strict=True)).rstrip())
