"""`bhm replay`: logs in, tables, series, pages and playable logs out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from bhm_service.assembly import Equipment
from bhm_service.config import Service
from bhm_service.equipment import equipment_of, read_service, recorded_equipment
from bhm_service.errors import BadInputError
from bhm_service.guess import guessed_equipment
from bhm_service.mavlink.log import Log, read_log
from bhm_service.messages import EventCode
from bhm_service.replay import Replay, replay, reproduced
from bhm_service.reporting.flights import FlightSummary, summarise
from bhm_service.reporting.page import write_page
from bhm_service.reporting.played import write_played
from bhm_service.reporting.series import write_series
from bhm_service.reporting.terminal import HEADER, flight_tables
from bhm_service.reporting.words import duration, moment

_WIDTH = 100
_READING, _REPLAYING = 0.15, 0.75  # shares of the progress bar; the rest is writing


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What was asked for."""

    output: Path
    vehicle: Path | None = None
    battery: Path | None = None
    battery_id: int | None = None
    system: int | None = None
    service: Path | None = None

    @property
    def as_recorded(self) -> bool:
        """Whether a flight recording is replayed with what it was made with."""
        return self.vehicle is None and self.battery is None and self.battery_id is None and self.service is None


@dataclass(frozen=True, slots=True)
class Result:
    """One log, replayed and written."""

    log: Log
    pages: Replay
    flights: list[FlightSummary]
    remarks: list[str]
    written: list[Path]


def replay_logs(logs: Sequence[Path], request: Request) -> int:
    """Replay every log; one that cannot be read is named and does not stop the others. Returns the exit status."""
    out, err = Console(width=_WIDTH, highlight=False), Console(stderr=True, width=_WIDTH, highlight=False)
    service = read_service(request.service)
    given = None if request.vehicle is None else equipment_of(request.vehicle, request.battery, request.battery_id)
    _make(request.output)
    failed = 0
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    for path, stem in zip(logs, _stems(logs), strict=True):
        with Progress(*columns, console=err, transient=True) as bar:
            task = bar.add_task(path.name, total=1.0)

            def progress(share: float, task: object = task, bar: Progress = bar) -> None:
                bar.update(task, completed=share)  # type: ignore[arg-type]

            try:
                result = _one(path, stem, request, given, service, progress)
            except BadInputError as why:
                failed += 1
                err.print(f"bhm replay: {why}", style="red", markup=False, soft_wrap=True)
                continue
        _show(out, result)
    return 2 if failed else 0


def _stems(logs: Sequence[Path]) -> list[str]:
    """Names for the results; logs of the same name from different folders do not overwrite each other."""
    stems = [path.name.removesuffix(".gz").rsplit(".", 1)[0] for path in logs]
    return [
        f"{path.resolve().parent.name}-{stem}" if stems.count(stem) > 1 else stem
        for path, stem in zip(logs, stems, strict=True)
    ]


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as why:
        raise BadInputError(str(folder), f"cannot be made: {why.strerror}") from None


def _one(
    path: Path,
    stem: str,
    request: Request,
    given: Equipment | None,
    service: Service,
    progress: Callable[[float], None],
) -> Result:
    log = read_log(path, request.system, lambda share: progress(_READING * share))
    remarks = log.remarks()
    recorded = None if log.recorded is None else recorded_equipment(log.recorded, str(path))
    as_recorded = recorded is not None and request.as_recorded
    if recorded is not None and as_recorded:
        equipment, service = recorded
    elif given is None:
        equipment, reasons = guessed_equipment(log, request.battery, request.battery_id)
        remarks = [*reasons, *remarks]
    else:
        equipment = given
    remarks = [*equipment.remarks, *remarks]
    pages = replay(log, equipment, service, lambda share: progress(_READING + _REPLAYING * share), as_recorded)
    if as_recorded:
        remarks.append(reproduced(log, pages))
    flights = summarise(pages)
    written = [request.output / f"{stem}{ending}" for ending in (".bhm.tlog", ".csv", ".html")]
    if path.resolve() in (file.resolve() for file in written):
        raise BadInputError(str(path), f"would be overwritten by its own result in {request.output}: choose another -o")
    write_played(written[0], log, pages)
    write_series(written[1], pages)
    write_page(written[2], log, equipment, pages, flights, remarks)
    return Result(log, pages, flights, remarks, written)


def _show(out: Console, result: Result) -> None:
    start, end = result.log.span_s
    out.print(f"\n[bold]{result.log.path.name}[/bold]: {result.log.kind.value}, {duration(end - start)} min")
    for remark in result.remarks:
        out.print(f"  {remark}", markup=False)
    for event in result.pages.events:
        if event.code not in (EventCode.TOOK_OFF, EventCode.LANDED):  # those stand in the tables
            out.print(f"  {moment(event.time_s, start)} {event.app}: {event.text}", style="yellow", markup=False)
    if not result.flights:
        out.print("  no flight found")
    for table in flight_tables(result.flights, start):
        if not table.rows:
            out.print(f"{table.title}: nothing was estimated", markup=False)
            continue
        shown = Table(title=table.title, title_justify="left", title_style="", box=None, padding=(0, 1, 0, 0))
        for k, name in enumerate(HEADER):
            shown.add_column(name, justify="left" if k == 0 else "right", no_wrap=k != len(HEADER) - 1)
        for row in table.rows:
            shown.add_row(*row)
        out.print(shown)
        for note in table.notes:
            out.print(f"  {note}", markup=False)
    out.print(
        f"  written: {', '.join(file.name for file in result.written)} in {result.written[0].parent}", markup=False
    )
