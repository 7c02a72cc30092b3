"""`bhm identify`: recordings in, a battery file out, and how good it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from bhm_service.battery.battery_file import MODELS, ModelName, read_battery, write_battery
from bhm_service.config import shipped
from bhm_service.discrepancy.lab_errors import with_lab_errors
from bhm_service.errors import BadInputError
from bhm_service.guess import GENERIC_BATTERY, GENERIC_LIHV, guess_vehicle
from bhm_service.identification.bench import Bench, read_bench, read_held_out
from bhm_service.identification.bench_table import QUANTITIES, Reading
from bhm_service.identification.experiment import Discharge, Experiment, Kind, discharges
from bhm_service.identification.flight_log import read_flights
from bhm_service.identification.flights import identify_flights
from bhm_service.identification.identify import Identified, Ocv, Request, identify, steps
from bhm_service.identification.solve import Method
from bhm_service.mavlink.log import Log, read_log
from bhm_service.reporting.identified_page import identified_page
from bhm_service.reporting.identified_terminal import identified_tables

Said: TypeAlias = Callable[[str], None]

_WIDTH = 100
# Of a capacity's logarithm: told with --capacity-ah, set in the autopilot, out of the flights themselves.
_TOLD_SD, _PARAMETER_SD, _GUESSED_SD = 0.05, 0.10, 0.30
_KINDS = {
    "slow": Kind.SLOW, "one_c": Kind.ONE_C, "variable": Kind.VARIABLE, "pulses": Kind.PULSES, "rate": Kind.RATE,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """What was asked for on the command line."""

    recordings: tuple[tuple[Kind, Path], ...]
    flights: tuple[Path, ...] = ()  # instead of recordings
    held_out: tuple[Path, ...] = ()
    output: Path
    report: Path | None = None
    reading: Reading
    oracle: bool = False
    models: tuple[ModelName, ...] = MODELS
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
    flights = given["flights"]
    if not recordings and not flights:
        raise BadInputError(
            "bhm identify",
            "nothing to identify from",
            "give --slow, --one-c, --variable, --pulses or --rate, or --flights alone",
        )
    if flights and (recordings or given["held_out"]):
        raise BadInputError(
            "bhm identify", "--flights stands alone", "bench recordings tell more: give a flight as --variable"
        )
    if given["series"] is None and not flights:
        raise BadInputError("bhm identify", "how many cells in series?", "answer with --series N")
    return Task(
        recordings=tuple(recordings),
        flights=flights,
        held_out=given["held_out"],
        output=given["output"],
        report=given["report"],
        reading=Reading(
            series=given["series"] or 0,
            columns=columns_of(given["columns"]),
            current_unit=given["current_unit"],
            voltage_of=given["voltage"],
            discharge=given["discharge"],
            battery_id=given["battery_id"],
        ),
        oracle=given["oracle"],
        models=MODELS if given["model"] == "both" else (given["model"],),
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
    if task.report is not None and not task.report.parent.is_dir():
        raise BadInputError(str(task.report), "its folder does not exist")
    with _bar(err) as (said, total):
        benches, identified = (_from_flights if task.flights else _from_bench)(task, said, total)
    write_battery(task.output, identified.battery)
    _show_recordings(out, benches)
    _show(out, identified)
    page = _page(task.report, task.output)
    page.write_text(identified_page(identified), encoding="utf-8")
    out.print(f"written: {task.output}, {page}", markup=False)


def _request(task: Task, benches: Sequence[Bench], source: str, series: int) -> Request:
    return Request(
        experiments=tuple(b.experiment for b in benches),
        oracle=task.oracle,
        series=series,
        models=task.models,
        name=task.name or task.output.name.removesuffix(".toml"),
        method=task.method,
        ocv=task.ocv,
        capacity_ah=task.capacity_ah,
        source=f"bhm identify: {source}",
    )


def _from_bench(task: Task, said: Said, total: Callable[[int], None]) -> tuple[list[Bench], Identified]:
    benches = [bench for kind, path in task.recordings for bench in _read(path, kind, task.reading, said)]
    unseen = [bench for path in task.held_out for bench in _held_out(path, task.reading, said)]
    source = ", ".join(f"{path.name} ({kind.value})" for kind, path in task.recordings)
    request = _request(task, benches, source, task.reading.series)
    request = replace(request, held_out=tuple(b.experiment for b in unseen))
    total(steps(request) + 1)
    identified = identify(request, said)
    said("what the models leave of the recordings")
    return [*benches, *unseen], replace(identified, battery=with_lab_errors(identified.battery, identified.results))


def _from_flights(task: Task, said: Said, total: Callable[[int], None]) -> tuple[list[Bench], Identified]:
    """Cells in series and capacity as told, else from the logs."""
    logs: list[Log] = []
    for path in task.flights:
        said(f"reading {path.name}")
        logs.append(read_log(path))
    file, series, capacity_ah, capacity_sd, reasons = _known_before(task, logs)
    benches: list[Bench] = []
    useless: list[BadInputError] = []
    for log in logs:
        try:
            found = read_flights(log, task.reading.battery_id, series, capacity_ah)
        except BadInputError as why:
            useless.append(why)
            continue
        benches += [Bench(experiment, tuple(log.remarks())) for experiment in found]
    if not benches:
        raise useless[0]
    reasons += [f"left out {Path(why.where).name}: {why.problem}" for why in useless]
    request = _request(task, benches, ", ".join(log.path.name for log in logs), series)
    request = replace(request, capacity_ah=capacity_ah)
    total(2 * len(request.models))
    known = read_battery(file)
    identified = identify_flights(request, known, capacity_sd, said)
    return benches, replace(identified, remarks=(*reasons, *identified.remarks))


def _known_before(task: Task, logs: Sequence[Log]) -> tuple[Path, int, float, float, list[str]]:
    """The file of such a cell, cells in series, capacity [Ah] and how well it is known, and where that is from."""
    guesses = [guess_vehicle((m for _, m in log.messages), task.reading.battery_id, log.path.stem) for log in logs]
    told = [g for g in guesses if g.capacity_told] or guesses
    reasons = [] if task.reading.series and task.capacity_ah else [f"guessed: {'; '.join(told[0].reasons)}"]
    # One full pack tells what the others are charged to.
    lihv = [log for guess, log in zip(guesses, logs, strict=True) if guess.vehicle.battery.file.endswith(GENERIC_LIHV)]
    reasons += [f"LiHV cells, charged to 4.35 V, by {log.path.name}" for log in lihv[:1]]
    file = shipped("batteries", GENERIC_LIHV if lihv else GENERIC_BATTERY)
    series = task.reading.series or told[0].vehicle.battery.series or 1
    if task.capacity_ah is not None:
        return file, series, task.capacity_ah, _TOLD_SD, reasons
    capacity_ah = float(np.median([g.vehicle.battery.capacity_ah or 5.0 for g in told]))
    return file, series, capacity_ah, _PARAMETER_SD if told[0].capacity_told else _GUESSED_SD, reasons


def _read(path: Path, kind: Kind, reading: Reading, said: Said) -> list[Bench]:
    said(f"reading {path.name}")
    return read_bench(path, kind, reading)


def _held_out(path: Path, reading: Reading, said: Said) -> list[Bench]:
    said(f"reading {path.name}")
    return read_held_out(path, reading)


@contextmanager
def _bar(console: Console) -> Iterator[tuple[Said, Callable[[int], None]]]:
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
    for shown in identified_tables(identified):
        out.print(shown)


def _page(report: Path | None, output: Path) -> Path:
    """Where the page goes: to the file or into the folder that was named, else beside the battery file."""
    name = output.with_suffix(".html").name
    if report is None:
        return output.with_name(name)
    return report / name if report.is_dir() else report


def _table(title: str, heads: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 1, 0, 0))
    for k, head in enumerate(heads):
        table.add_column(head, justify="left" if k == 0 else "right")
    return table
