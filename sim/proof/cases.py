"""A case as a tool sees it: a folder with `lab/`, `flights/` and what a user would know of the pack.

`lab/` holds `slow`, `one_c`, `variable` and `pulses` as far as they were recorded. `flights/` holds logs, and
`flights.csv` where there is a sidecar. `pack.json` says how many cells are in series. A pack without lab recordings
comes with a battery file and a vehicle file instead.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from sim.proof.scoring.answers import Answer

LAB_OPTIONS = {"slow": "--slow", "one_c": "--one-c", "variable": "--variable", "pulses": "--pulses"}
Batch: TypeAlias = Callable[[Path, Path], list[Answer]]
"""Writes one case or more: what a tool may see into the first folder, flights kept back into the second."""


@dataclass(frozen=True, slots=True)
class Case:
    """A case's folder."""

    folder: Path

    @property
    def name(self) -> str:
        """Its name, which says nothing of what it conceals."""
        return self.folder.name

    @property
    def flights(self) -> list[Path]:
        """Its logs."""
        return sorted(f for f in (self.folder / "flights").iterdir() if f.name != "flights.csv")

    @property
    def sidecar(self) -> Path | None:
        """What was noted beside the logs."""
        path = self.folder / "flights" / "flights.csv"
        return path if path.is_file() else None

    @property
    def vehicle(self) -> Path | None:
        """The vehicle file, if the case comes with one."""
        path = self.folder / "vehicle.toml"
        return path if path.is_file() else None

    @property
    def battery(self) -> Path | None:
        """The battery file, if the case comes with one."""
        path = self.folder / "battery.toml"
        return path if path.is_file() else None

    @property
    def series(self) -> int:
        """Cells in series."""
        return int(json.loads((self.folder / "pack.json").read_text())["series"])

    @property
    def lab(self) -> dict[str, Path]:
        """The option of `bhm identify` for each lab recording."""
        folder = self.folder / "lab"
        found = {LAB_OPTIONS[f.name.split(".")[0]]: f for f in sorted(folder.iterdir())} if folder.is_dir() else {}
        return {option: found[option] for option in LAB_OPTIONS.values() if option in found}

    def lab_digest(self) -> str:
        """The same for cases of one pack, which is then identified once."""
        found = hashlib.sha256(str(self.series).encode())
        for option, path in self.lab.items():
            found.update(option.encode() + path.read_bytes())
        return found.hexdigest()[:16]


def write_pack(folder: Path, series: int) -> None:
    """Say how many cells are in series."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "pack.json").write_text(json.dumps({"series": series}) + "\n")
