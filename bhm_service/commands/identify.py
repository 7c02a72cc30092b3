"""`bhm identify`: recordings in, a battery file out, and how good it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from bhm_service.battery.battery_file import ModelName, write_battery
from bhm_service.errors import BadInputError
from bhm_service.identification.bench import Bench, read_bench
from bhm_service.identification.bench_table import QUANTITIES, Reading
from bhm_service.identification.experiment import Discharge, Experiment, Kind, discharges
from bhm_service.identification.identify import Identified, Ocv, Request, identify, steps
from bhm_service.identification.solve import Method

_WIDTH = 100
_KINDS = {
    "slow": Kind.SLOW, "one_c": Kind.ONE_C, "variable": Kind.VARIABLE, "pulses": Kind.PULSES, "rate": Kind.RATE,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """What was asked for on the command line."""

    recordings: tuple[tuple[Kind, Path], ...]
    held_out: tuple[Path, ...] = ()
    output: Path
    report: Path | None = None
    reading: Reading
    oracle: bool = False
    models: tuple[ModelName, ...] = ("circ", "chem")
    name: str | None = None
    method: Method = "trf"
    ocv: Ocv = "auto"
    capacity_ah: float | None = None


def columns_of(told: Sequence[str]) -> dict[str, str]:
    """``time=T,current=I`` as a mapping; a name may hold commas. BadInputError names a quantity that there is not."""
    found: dict[str, str] = {}
    for text in told:
        for part in re.split(r",(?=\w+=)", text):
            quantity, equals, name = part.partition("=")
            if not equals or quantity not in QUANTITIES:
                raise BadInputError(
                    "--columns", f"{part!r} is not QUANTITY=NAME", f"quantities: {', '.join(QUANTITIES)}"
                )
            found[quantity] = name
    return found


def task_of(given: dict[str, Any]) -> Task:
    """What the options of the command say. Raises BadInputError where they do not go together."""
    recordings = [(kind, path) for option, kind in _KINDS.items() for path in given[option]]
    if not recordings:
        raise BadInputError(
            "bhm identify", "nothing to identify from", "give --slow, --one-c, --variable, --pulses or --rate"
        )
    if given["series"] is None:
        raise BadInputError("bhm identify", "how many cells in series?", "answer with --series N")
    return Task(
        recordings=tuple(recordings),
        held_out=given["held_out"],
        output=given["output"],
        report=given["report"],
        reading=Reading(
            series=given["series"],
            columns=columns_of(given["columns"]),
            current_unit=given["current_unit"],
            voltage_of=given["voltage"],
            discharge=given["discharge"],
            battery_id=given["battery_id"],
        ),
        oracle=given["oracle"],
        models=("circ", "chem") if given["model"] == "both" else (given["model"],),
        name=given["name"],
        method=given["method"],
        ocv=given["ocv"],
        capacity_ah=given["capacity_ah"],
    )


def identify_pack(task: Task) -> None:
    """Identify, write and show. Raises BadInputError."""
    out, err = Console(width=_WIDTH, highlight=False), Console(stderr=True, width=_WIDTH, highlight=False)
    if not task.output.parent.is_dir():
        raise BadInputError(str(task.output), "its folder does not exist")
    with _bar(err) as (said, total):
        benches = [bench for kind, path in task.recordings for bench in _read(path, kind, task.reading, said)]
        unseen = [bench for path in task.held_out for bench in _read(path, Kind.VARIABLE, task.reading, said)]
        request = Request(
            experiments=tuple(b.experiment for b in benches),
            held_out=tuple(b.experiment for b in unseen),
            oracle=task.oracle,
            series=task.reading.series,
            models=task.models,
            name=task.name or task.output.name.removesuffix(".toml"),
            method=task.method,
            ocv=task.ocv,
            capacity_ah=task.capacity_ah,
            source="bhm identify: " + ", ".join(f"{path.name} ({kind.value})" for kind, path in task.recordings),
        )
        total(steps(request))
        identified = identify(request, said)
    write_battery(task.output, identified.battery)
    _show_recordings(out, [*benches, *unseen])
    _show(out, identified)
    out.print(f"written: {task.output}", markup=False)


def _read(path: Path, kind: Kind, reading: Reading, said: Callable[[str], None]) -> list[Bench]:
    said(f"reading {path.name}")
    return read_bench(path, kind, reading)


@contextmanager
def _bar(console: Console) -> Iterator[tuple[Callable[[str], None], Callable[[int], None]]]:
    """A bar that moves on with everything that is said; a function to say it, and one to tell how much will be."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)
        done = -1

        def said(what: str) -> None:
            nonlocal done
            done += 1
            bar.update(task, description=what, completed=done)

        def total(of: int) -> None:
            nonlocal done
            done = -1
            bar.reset(task, total=of)

        yield said, total


# ---- the terminal ---------------------------------------------------------------------------------------------------


def _show_recordings(out: Console, benches: Sequence[Bench]) -> None:
    for remark, labels in _by_remark(benches).items():
        out.print(f"{', '.join(labels)}: {remark}", markup=False)
    found: list[tuple[Experiment, Discharge]] = [(b.experiment, d) for b in benches for d in _whole(b.experiment)]
    if not found:
        return
    table = _table("Discharges", ("recording", "charge", "from", "to", "lasted"))
    for _, d in found:
        table.add_row(d.label, f"{d.charge_ah:.4g} Ah", f"{d.begin_v:.3f} V", f"{d.end_v:.3f} V", f"{d.seconds:.0f} s")
    out.print(table)


def _whole(experiment: Experiment) -> list[Discharge]:
    return discharges(experiment) if experiment.kind in (Kind.SLOW, Kind.ONE_C, Kind.RATE) else []


def _by_remark(benches: Sequence[Bench]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for bench in benches:
        for remark in bench.remarks:
            found.setdefault(remark, []).append(bench.experiment.label)
    return found


def _show(out: Console, identified: Identified) -> None:
    for remark in identified.remarks:
        out.print(remark, markup=False)
    for result in identified.results:
        for remark in result.remarks:
            out.print(f"{result.model}: {remark}", markup=False)
        if result.not_told:
            out.print(f"{result.model}: not told by these recordings: {', '.join(result.not_told)}", markup=False)
        heads = ("recording", "rmse", "bias", "best possible")
        table = _table(f"{result.model}: voltage error of a cell above 10 % SoC", heads)
        for a in result.assessments:
            best = "" if a.oracle is None else f"{1e3 * a.oracle.rmse:.1f} mV"
            label = f"{a.label} (held out)" if a.held_out else a.label
            table.add_row(label, f"{1e3 * a.whole.rmse:.1f} mV", f"{1e3 * a.whole.bias:.1f} mV", best)
        out.print(table)


def _table(title: str, heads: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 1, 0, 0))
    for k, head in enumerate(heads):
        table.add_column(head, justify="left" if k == 0 else "right")
    return table
