"""Series of hidden states that findings point to, read into plain columns."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def inferred_series(findings: Mapping[str, Any], out: Path) -> dict[str, dict[str, list[float]]]:
    """Columns of every flight's file. Files outside ``out`` are not opened; unreadable ones are left out."""
    found = {}
    for flight, name in _files(findings.get("inferred")).items():
        path = (out / name).resolve()
        if path.is_relative_to(out.resolve()) and path.is_file():
            columns = _columns(path)
            if columns:
                found[flight] = columns
    return found


def _files(given: Any) -> dict[str, str]:
    """Flight to file, from a mapping or from a list of records."""
    if isinstance(given, Mapping):
        return {str(flight): str(file) for flight, file in given.items() if isinstance(file, str)}
    if isinstance(given, list):
        return {
            str(g["flight"]): str(g["file"]) for g in given if isinstance(g, Mapping) and {"flight", "file"} <= {*g}
        }
    return {}


def _columns(path: Path) -> dict[str, list[float]]:
    with path.open(newline="") as stream:
        reader = csv.DictReader(stream)
        names = list(reader.fieldnames or [])
        columns: dict[str, list[float]] = {name: [] for name in names}
        for row in reader:
            for name in names:
                columns[name].append(_number(row[name]))
    return columns


def _number(text: str | None) -> float:
    try:
        return float(text) if text else float("nan")
    except ValueError:
        return float("nan")
