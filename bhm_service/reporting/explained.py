"""An explanation for people: one page that needs nothing else, and a summary for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import shorten
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, select_autoescape
from plotly.offline import get_plotlyjs
from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from bhm_service.discrepancy.demand_model import LEVEL_SD
from bhm_service.discrepancy.demand_side import DemandSide, NotLooked
from bhm_service.discrepancy.explanation import Course, Explanation
from bhm_service.discrepancy.labels import flight_name
from bhm_service.discrepancy.odds import NEAR
from bhm_service.reporting import explained_tables as tables
from bhm_service.reporting.explained_demand import (
    LASTS_HEADER,
    POWER_HEADER,
    demand_blocks,
    demand_fit,
    demand_line,
    lasts,
    lasts_in_words,
    power_figure,
    shown_course,
)
from bhm_service.reporting.explained_figure import fitted_figure, held_out_figure, hidden_figure, map_figure
from bhm_service.reporting.figure import as_html
from bhm_service.units import ampere_hours

_SETTLED = ("none", "parameter", "named")  # verdicts that leave nothing to find out
_WIDTH, _BROKEN = 98, 92  # columns of a line; of each of several, whose words do not break at the margin
_MOST_STEPPED = 4  # flights with change points that are drawn beside the worst one
_TERMINAL_EFFECTS, _TERMINAL_LINES = 2, 2  # in full; of regions, advice and what was left out


def explained_page(e: Explanation) -> str:
    """The page as HTML."""
    environment = Environment(loader=PackageLoader("bhm_service.reporting"), autoescape=select_autoescape())
    worst = tables.worst(e)
    settled = e.joined.verdict in _SETTLED and not e.joined.unexplained_rest
    voltages = [(flight_name(f.label), who, as_html(held_out_figure(e, f))) for who, f in worst]
    if not worst:
        fitted = _worst_fitted(e)
        voltages = [(flight_name(fitted.flight.label), "", as_html(fitted_figure(e, fitted)))]
    figures = {"map": map_figure(e), "hidden": hidden_figure(e)}
    return environment.get_template("explained.html").render(
        title=f"{e.battery.name}: explained",
        subtitle=subtitle(e),
        plotly_js=get_plotlyjs(),
        sentence=e.sentence,
        verdict=e.findings.verdict,
        demand_line=demand_line(e.demand),
        **_demand(e.demand),
        tone="good" if settled else "warn",
        regions=tables.regions(e),
        effects=tables.effects(e),
        parameter_header=tables.PARAMETER_HEADER,
        least=f"{NEAR:.0f}",
        odds=f"{np.exp(NEAR):.0f}",
        voltages=voltages,
        held_out=tables.held_out(e),
        from_assumed=e.held_out is not None and e.held_out.from_assumed,
        flight_header=tables.FLIGHT_HEADER,
        change_points=tables.change_points(e),
        stepped=_stepped(e, {f.label for _, f in worst}),
        rivals=tables.rivals(e),
        rival_header=tables.RIVAL_HEADER,
        decoys=tables.decoys(e),
        decoy_header=tables.DECOY_HEADER,
        flying=tables.flying(e),
        flying_header=tables.FLYING_HEADER,
        flying_sentence=tables.flying_in_words(e),
        advice=e.joined.advice,
        not_shown=tables.not_shown(e),
        left_out=[(r.label, r.because) for r in e.left_out],
        fit=tables.fit(e),
        fit_header=tables.fit_header(e),
        repaired=e.findings.battery_file or "",
        rest=f"{100.0 * e.findings.unexplained_rest:.0f} %" if e.findings.unexplained_rest else "",
        **{name: "" if figure is None else as_html(figure) for name, figure in figures.items()},
    )


def _demand(demand: DemandSide | NotLooked) -> dict[str, Any]:
    """What the page says of power; nothing where it was not looked at."""
    if isinstance(demand, NotLooked):
        return {}
    shown = shown_course(demand)
    return {
        "demand": demand.verdict,
        "demand_tone": "good" if demand.verdict in _SETTLED and not demand.rest else "warn",
        "demand_effects": demand_blocks(demand),
        "power": (flight_name(shown.flight.label), as_html(power_figure(demand, shown))),
        "power_fit": demand_fit(demand),
        "power_header": POWER_HEADER,
        "lasts": lasts(demand) if demand.effects else [],
        "lasts_header": LASTS_HEADER,
        "lasts_sentence": lasts_in_words(demand),
        "level": f"{100.0 * demand.level.value:+.0f} %",
        "level_sd": f"{100.0 * LEVEL_SD:.0f} %",
        "demand_not_shown": ", ".join(demand.not_shown),
        "demand_rest": f"{100.0 * demand.rest:.0f} %" if demand.rest else "",
        "vehicle_repaired": demand.repaired is not None,
    }


def _demand_lines(demand: DemandSide | NotLooked) -> list[RenderableType]:
    found: list[RenderableType] = [_lines(f"demand: {demand_line(demand)}", 2)]
    if isinstance(demand, NotLooked):
        return found
    for block in demand_blocks(demand)[:_TERMINAL_EFFECTS]:
        found += [_lines(f"{block.id}: {block.equation}", 1, "bold"), *_indented(block.words, 2)]
    if lasts_in_words(demand):
        found.append(_lines(lasts_in_words(demand), 1))
    return found


def subtitle(e: Explanation) -> str:
    """Pack and recordings in a line."""
    flown = sum(float(c.flight.time_s[-1]) for c in e.courses) / 60.0
    count = len(e.courses)
    return (
        f"{e.lab.series} cells in series, {ampere_hours(e.lab.capacity_c):.3g} Ah, {e.lab.model} model; "
        f"{count} flight{'s' * (count != 1)}, {flown:.0f} min"
    )


def _worst_fitted(e: Explanation) -> Course:
    return max(e.courses, key=lambda c: float(np.nanmean((c.flight.voltage_v - c.after_v) ** 2)))


def _stepped(e: Explanation, drawn: set[str]) -> list[tuple[str, str]]:
    """Flights with change points that are not drawn yet."""
    labels = {c.flight for c in e.findings.change_points} - drawn
    shown = [c for c in e.courses if c.flight.label in labels][:_MOST_STEPPED]
    return [(flight_name(c.flight.label), as_html(fitted_figure(e, c))) for c in shown]


def explained_lines(e: Explanation) -> Sequence[RenderableType]:
    """What to print: under forty lines, within a hundred columns."""
    style = "green" if e.joined.verdict in _SETTLED else "yellow"
    found: list[RenderableType] = [_lines(f"{e.joined.verdict}: {e.sentence}", 4, f"bold {style}")]
    found += _demand_lines(e.demand)
    found += [_lines(f"where: {line}", 2) for line in tables.regions(e)[:_TERMINAL_LINES]]
    blocks = tables.effects(e)
    for block in blocks[:_TERMINAL_EFFECTS]:
        found.append(_lines(f"{block.id}: {block.equation}", 1, "bold"))
        found += _indented(block.words, 3)
        numbers = [f"{row[0]} = {row[1]}" for row in block.parameters if "(flight" not in row[2]]
        found += _indented(", ".join(numbers), 2)
    found += [_lines(f"and {block.id}: {block.equation}", 1, "bold") for block in blocks[_TERMINAL_EFFECTS:]]
    others = [tables.title(names) for names in e.findings.alternatives]
    if others:
        more = f", or {len(others) - 3} more" if len(others) > 3 else ""
        found.append(_lines(f"or instead: {', or '.join(others[:3])}{more}", 2))
    if e.contests and blocks:
        found.append(Text(f"phantom drivers beaten: {sum(c.beaten for c in e.contests)} of {len(e.contests)}"))
    if e.findings.change_points:
        points = [f"{flight} at {time}" for flight, time in tables.change_points(e)]
        found.append(_lines(f"change points: flight {', '.join(points)}", 1))
    found.append(_fit_table(e))
    if tables.flying_in_words(e):
        found.append(Text(tables.flying_in_words(e)))
    if e.not_excited:
        found.append(_lines(f"cannot be shown by these recordings: {', '.join(n.id for n in e.not_excited)}", 1))
    found += [_lines(f"next flight: {line}", 2) for line in e.joined.advice[:_TERMINAL_LINES]]
    found += [_lines(f"left out {r.label}: {r.because}", 1) for r in e.left_out[:_TERMINAL_LINES]]
    if len(e.left_out) > _TERMINAL_LINES:
        found.append(Text(f"left out: {len(e.left_out) - _TERMINAL_LINES} more"))
    return found


def _indented(text: str, lines: int) -> list[RenderableType]:
    return [Padding(_lines(text, lines), (0, 0, 0, 2))] if text else []


def _lines(text: str, lines: int, style: str = "") -> Text:
    """At most so many lines; what does not fit is on the page."""
    return Text(shorten(text, _WIDTH if lines == 1 else lines * _BROKEN, placeholder=" ..."), style=style)


def _fit_table(e: Explanation) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for k, head in enumerate(tables.fit_header(e)):
        table.add_column(head, justify="left" if k == 0 else "right")
    for row in tables.fit(e):
        table.add_row(*row)
    return table
