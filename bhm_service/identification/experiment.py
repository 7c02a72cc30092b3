"""One bench recording of a cell, as arrays."""

from __future__ import annotations

import csv
import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bhm_service.errors import BadInputError
from bhm_service.units import ZERO_CELSIUS_K, Array

_COLUMNS = ("time_s", "current_A", "voltage_V", "temperature_C")


@dataclass(frozen=True, slots=True)
class Experiment:
    """A recording of one cell: voltage answers current; time rises; current is positive while discharging."""

    label: str
    time_s: Array
    current_a: Array
    voltage_v: Array
    temperature_k: Array

    def part(self, where: slice, label: str) -> Experiment:
        """The samples of ``where``."""
        return Experiment(
            label,
            self.time_s[where],
            self.current_a[where],
            self.voltage_v[where],
            self.temperature_k[where],
        )

    @property
    def charge_c(self) -> Array:
        """Charge taken out since the first sample. [C]"""
        mean = 0.5 * (self.current_a[1:] + self.current_a[:-1])
        return np.concatenate([[0.0], np.cumsum(mean * np.diff(self.time_s))])


def read_experiment(path: Path) -> Experiment:
    """Read a bench CSV (.csv or .csv.gz) with the columns time_s, current_A, voltage_V, temperature_C.

    Raises BadInputError when the file is missing or lacks a column.
    """
    if not path.is_file():
        raise BadInputError(str(path), "no such file")
    with gzip.open(path, "rt", newline="") if path.suffix == ".gz" else path.open(newline="") as stream:
        reader = csv.DictReader(stream)
        missing = [name for name in _COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise BadInputError(str(path), f"column {missing[0]!r} is missing; it has {reader.fieldnames}")
        rows = [[row[name] for name in _COLUMNS] for row in reader]
    table = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    return Experiment(path.name, table[:, 0], table[:, 1], table[:, 2], table[:, 3] + ZERO_CELSIUS_K)
