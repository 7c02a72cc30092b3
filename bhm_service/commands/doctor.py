"""`bhm doctor`: looks at a machine and a link, prints what is wrong and how to mend it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from bhm_service.checkpoint import state_folder
from bhm_service.doctor.finding import Finding, Level, bad
from bhm_service.doctor.machine import machine
from bhm_service.doctor.vehicle import Heard, listen, vehicle
from bhm_service.equipment import configured
from bhm_service.errors import BadInputError
from bhm_service.mavlink.links import Links
from bhm_service.mavlink.signing import read_key
from bhm_service.mavlink.transport import LinkUrl

_WIDTH = 100
_STYLES = {Level.GOOD: "green", Level.DOUBTFUL: "yellow", Level.BAD: "red"}


def examine(
    urls: Sequence[str], config: Path | None, vehicle_file: Path | None, battery: Path | None, seconds: float
) -> int:
    """Print every finding; the exit status is 0 when nothing is bad, else 1."""
    out, err = Console(width=_WIDTH, highlight=False), Console(stderr=True, width=_WIDTH, highlight=False)
    equipment, settings = configured(config, vehicle_file, battery)
    parsed = tuple(map(LinkUrl.parse, urls or settings.link.urls))
    findings = machine(settings, parsed, state_folder(os.environ), time.time())
    _show(out, "This computer", findings)
    if seconds > 0.0:
        try:
            key = None if settings.link.signing_key is None else read_key(settings.link.signing_key)
            links = Links([url.text for url in parsed], settings.link.system, settings.link.component, key)
        except BadInputError as why:
            linked = [bad(f"{why.where}: {why.problem}", why.hint or "see above")]
        else:
            columns = (TextColumn("listening"), BarColumn(), TextColumn("{task.description}"))
            with Progress(*columns, console=err, transient=True) as bar:
                task = bar.add_task("", total=seconds)
                heard = Heard()
                for heard in listen(links, equipment.vehicle.battery.id, seconds, time.monotonic):
                    who = "" if heard.heartbeat is None else f"{heard.heartbeat.kind.value} heard"
                    bar.update(task, completed=heard.seconds, description=who)
            links.close()
            linked = vehicle(heard, equipment)
        _show(out, f"{equipment.vehicle.name}, {seconds:.0f} s", linked)
        findings += linked
    worst = [finding for finding in findings if finding.level is Level.BAD]
    out.print(f"\n{len(worst)} to mend" if worst else "\nnothing to mend", style="red" if worst else "green")
    return 1 if worst else 0


def _show(out: Console, title: str, findings: Iterable[Finding]) -> None:
    out.print(f"\n[bold]{title}[/bold]")
    for finding in findings:
        out.print(f"  {finding.level.value:9} {finding.what}", style=_STYLES[finding.level], markup=False)
        if finding.mend:
            out.print(f"            -> {finding.mend}", markup=False)
