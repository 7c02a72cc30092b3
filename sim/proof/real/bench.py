"""Cells on a bench: the model from warm or slow runs, then cold, fast or aged ones without temperature or ambient."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.proof.cases import write_pack
from sim.proof.real.recordings import Recording, discharge_of, read_bench, write_bench, write_log
from sim.proof.scoring.answers import Answer, Criterion, Names, Quantity

WARMTH: tuple[Names, ...] = tuple(
    map(frozenset, (("resistance-temperature",), ("self-heating",), ("resistance-temperature", "self-heating")))
)
_ONE_CAPACITY = 0.03  # discharges whose capacities differ by less can be given as one number
_TEMPERATURE = "hidden.temperature_K"


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchCase:
    """A cell: which recordings its model comes from, which are shown, and what is right."""

    name: str
    group: str
    lab: dict[str, Recording]
    shown: tuple[Recording, ...]
    accept: tuple[Names, ...]
    criteria: tuple[Criterion, ...] = ()
    parameters: dict[str, dict[str, Quantity]] | None = None
    note: str = ""

    def __call__(self, folder: Path, held: Path) -> list[Answer]:
        """Write what may be seen; temperatures of what is shown go into the answer."""
        case = folder / self.name
        write_pack(case, series=1)
        (case / "lab").mkdir()
        (case / "flights").mkdir()
        for kind, recording in self.lab.items():
            write_bench(case / "lab" / f"{kind}.csv.gz", recording)
        hidden, starts = {}, {}
        for k, recording in enumerate(self.shown):
            log = case / "flights" / f"{k:02d}.tlog"
            starts[log.name] = write_log(log, recording, k, with_temperature=False)
            hidden[log.name] = recording.hidden_temperature
        return [
            Answer(
                case=self.name,
                kind="withheld",
                group=self.group,
                accept=self.accept,
                truth=self.accept[0],
                hidden=hidden,
                starts_s=starts,
                criteria=self.criteria,
                parameters=self.parameters or {},
                note=self.note,
            )
        ]


def panasonic(data: Path, names: list[str]) -> list[BenchCase]:
    """18650PF: identified at 25 degC, shown at one cold ambient each."""
    folder = data / "lab" / "panasonic_18650pf"

    def read(name: str) -> Recording:
        return read_bench(folder / f"{name}.csv.gz")

    lab = {"slow": read("c20_ocv_25C"), "one_c": read("dis1C_start_1_25C"), "variable": read("drive_Cycle_1_25C")}
    criteria = (
        Criterion("heldout_ratio", at_most=0.5),
        Criterion(f"{_TEMPERATURE}.rmse", at_most=4.0),
        Criterion(f"{_TEMPERATURE}.r", at_least=0.9),
    )
    return [
        BenchCase(
            name=name,
            group=f"Panasonic 18650PF at {words} degC",
            lab=lab,
            shown=tuple(read(f"drive_{cycle}_{ambient}C") for cycle in ("Cycle_1", "US06")),
            accept=(*WARMTH, frozenset({"resistance-temperature", "cold-capacity"}),
                    frozenset({"resistance-temperature", "self-heating", "cold-capacity"})),
            criteria=criteria,
        )
        for name, (ambient, words) in zip(names, (("0", "0"), ("n10", "-10"), ("n20", "-20")), strict=True)
    ]  # fmt: skip


def maxamps(data: Path, names: list[str]) -> list[BenchCase]:
    """5.45 Ah pouch: identified at 1C, shown at 3C and 4C."""
    folder = data / "lab" / "maxamps_lipo5450"
    lab = {"one_c": discharge_of(read_bench(folder / "cell_1C_cycle01.csv.gz"))}
    return [
        BenchCase(
            name=name,
            group=f"MaxAmps 5.45 Ah at {rate}",
            lab=lab,
            shown=tuple(discharge_of(read_bench(folder / f"cell_{rate}_cycle{n}.csv.gz")) for n in ("01", "48")),
            accept=WARMTH,
            criteria=(
                Criterion("listed.self-heating|resistance-temperature", at_least=1.0),
                Criterion(f"{_TEMPERATURE}.rise_error", at_most=4.0),
            ),
        )
        for name, rate in zip(names, ("3C", "4C"), strict=True)
    ]


NASA = (
    ("B0005", "002", ("074", "098")), ("B0005", "002", ("146", "168")), ("B0007", "002", ("146", "168")),
    ("B0029", "002", ("026", "040")), ("B0053", "002", ("050", "055")),
)  # fmt: skip
"""Cell, the discharge that its model comes from, and those that are shown with their cycle number withheld."""


def nasa(data: Path, names: list[str]) -> list[BenchCase]:
    """18650 cells of the PCoE set, aged between the discharge of the model and those that are shown."""
    folder = data / "lab" / "nasa_pcoe"
    capacity = _capacities(folder / "per_discharge_summary.csv")
    cases = []
    for name, (cell, fresh, aged) in zip(names, NASA, strict=True):

        def read(number: str, cell: str = cell) -> Recording:
            return discharge_of(read_bench(folder / f"{cell}_every24th.csv.gz", f"{cell}_dis{number}"))

        shares = [capacity[cell, int(n)] / capacity[cell, int(fresh)] for n in aged]
        left = float(np.mean(shares))
        growth = _growth(folder / "eis_Re_Rct.csv", cell)
        known = {"capacity-fade": {"fade": Quantity(1.0 - left, "1")}}
        if growth is not None:
            known["resistance-growth"] = {"growth": Quantity(growth, "1")}
        cases.append(
            BenchCase(
                name=name,
                group=f"NASA {cell}, discharges {' and '.join(map(str, map(int, aged)))}",
                lab={"one_c": read(fresh)},
                shown=tuple(read(number) for number in aged),
                accept=(
                    frozenset({"capacity-fade"}),
                    frozenset({"capacity-fade", "resistance-growth"}),
                    frozenset({"capacity-fade", "self-heating"}),
                    frozenset({"capacity-fade", "resistance-growth", "self-heating"}),
                ),
                criteria=(
                    Criterion("named.capacity-fade", at_least=1.0),
                    *([_within_three_percent(left)] if np.ptp(shares) < _ONE_CAPACITY else []),
                ),
                parameters=known,
                note="growth is of Re + Rct over the cell's whole life" if growth is not None else "",
            )
        )
    return cases


def _within_three_percent(left: float) -> Criterion:
    return Criterion("parameter.capacity-fade.fade", at_least=1.0 - 1.03 * left, at_most=1.0 - 0.97 * left)


def _capacities(path: Path) -> dict[tuple[str, int], float]:
    """The data set's own capacity of every discharge [Ah]."""
    with path.open(newline="") as stream:
        return {(row["battery"], int(row["dis"])): float(row["capacity_Ah"]) for row in csv.DictReader(stream)}


def _growth(path: Path, cell: str) -> float | None:
    """By what share Re + Rct grew over a cell's life: the last tenth of its spectra over the first."""
    with path.open(newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if row["battery_id"] == cell]
    total = np.array([float(row["Re"]) + float(row["Rct"]) for row in rows])
    total = total[np.isfinite(total) & (total > 0.0) & (total < 1.0)]
    tenth = total.size // 10
    if tenth < 2:
        return None
    return float(np.median(total[-tenth:]) / np.median(total[:tenth]) - 1.0)
