"""The page of a replay: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, select_autoescape
from plotly.offline import get_plotlyjs

from bhm_service.assembly import Equipment
from bhm_service.mavlink.log import Log
from bhm_service.messages import EventCode
from bhm_service.replay import Replay
from bhm_service.reporting.figure import figure
from bhm_service.reporting.flights import FlightSummary
from bhm_service.reporting.terminal import HEADER, flight_tables
from bhm_service.reporting.words import date, duration, moment
from bhm_service.units import SECONDS_PER_HOUR

_ORDINARY = (EventCode.TOOK_OFF, EventCode.LANDED)


def write_page(
    path: Path, log: Log, equipment: Equipment, pages: Replay, flights: Sequence[FlightSummary], remarks: Sequence[str]
) -> None:
    """Write the page."""
    environment = Environment(loader=PackageLoader("bhm_service.reporting"), autoescape=select_autoescape())
    start, end = log.span_s
    day = date(start)
    battery = equipment.vehicle.battery
    subtitle = [
        f"{log.kind.value}, {duration(end - start)} min" + (f", {day} from {moment(start, start)} UTC" if day else ""),
        f"{equipment.vehicle.name}: {equipment.series} cells in series, "
        f"{equipment.capacity_c / SECONDS_PER_HOUR:.3g} Ah, battery {battery.id}",
    ]
    html = environment.get_template("replay.html").render(
        title=log.path.name,
        subtitle=" - ".join(subtitle),
        warnings=list(dict.fromkeys(e.text for e in pages.events if e.code not in _ORDINARY)),
        remarks=remarks,
        header=HEADER,
        tables=flight_tables(flights, start),
        threshold=f"{battery.threshold_soc:.0%} SoC",
        cutoff=f"{battery.cutoff_v:g} V",
        figure=figure(pages, start),
        events=[(moment(e.time_s, start), e.app, e.text) for e in pages.events],
        plotly_js=get_plotlyjs(),
    )
    path.write_text(html, encoding="utf-8")
