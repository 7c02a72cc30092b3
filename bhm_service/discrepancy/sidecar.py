"""The table beside the logs: what was known of each flight that no log holds."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from bhm_service.errors import BadInputError

_REST_V = "rest_voltage_V"
_NUMBERS = {
    _REST_V: (0.0, 200.0),
    "rest_minutes": (0.0, 1e5),
    "cycles": (0.0, 1e5),
    "storage_days": (0.0, 1e5),
    "ambient_C": (-60.0, 80.0),
    "battery_id": (0.0, 255.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Notes:
    """One flight's line of the sidecar; None where nothing was written."""

    rest_voltage_v: float | None = None
    rest_s: float = 1200.0  # from the end of the log to that voltage
    cycles: float | None = None
    storage_days: float | None = None
    ambient_k: float | None = None
    battery_id: int | None = None
    pack: str | None = None


def read_sidecar(path: Path) -> dict[str, Notes]:
    """Notes by file name. Columns that are not known are left alone: they may be anybody's.

    Raises BadInputError naming line, column, value and what is allowed.
    """
    if not path.is_file():
        raise BadInputError(str(path), "no such file")
    with path.open(newline="", encoding="utf-8") as stream:
        reader = csv.DictReader(stream)
        if "file" not in (reader.fieldnames or ()):
            raise BadInputError(
                str(path), f"has no column 'file'; it has {', '.join(reader.fieldnames or ()) or 'none'}"
            )
        found: dict[str, Notes] = {}
        for number, row in enumerate(reader, start=2):
            name = (row["file"] or "").strip()
            if name in found:
                raise BadInputError(f"{path}, line {number}", f"file {name!r} stands there twice")
            found[name] = _notes(row, f"{path}, line {number}")
    return found


def _notes(row: dict[str, str], where: str) -> Notes:
    given: dict[str, float] = {}
    for name, (low, high) in _NUMBERS.items():
        text = (row.get(name) or "").strip()
        if not text:
            continue
        try:
            value = float(text)
        except ValueError:
            raise BadInputError(where, f"{name} = {text!r} is not a number") from None
        if not low <= value <= high:
            raise BadInputError(where, f"{name} = {value:g} is outside {low:g} ... {high:g}")
        given[name] = value
    ambient = given.get("ambient_C")
    battery_id = given.get("battery_id")
    return Notes(
        rest_voltage_v=given.get(_REST_V),
        rest_s=60.0 * given.get("rest_minutes", 20.0),
        cycles=given.get("cycles"),
        storage_days=given.get("storage_days"),
        ambient_k=None if ambient is None else ambient + 273.15,
        battery_id=None if battery_id is None else int(battery_id),
        pack=(row.get("pack") or "").strip() or None,
    )
