"""The figures of an explanation: where the model is off, voltage before and after, hidden states, steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from plotly.subplots import make_subplots

from bhm_service.discrepancy.confirm import LeftOutFlight
from bhm_service.discrepancy.explanation import Course, Explanation
from bhm_service.discrepancy.labels import flight_name
from bhm_service.discrepancy.locate import Map
from bhm_service.discrepancy.words import VARIABLES, Variable
from bhm_service.reporting.figure import MEASURED, legend_beside_each_panel
from bhm_service.units import ZERO_CELSIUS_K, Array

BEFORE, AFTER = "#d6604d", "#2a7f3f"
_REGION, _BAR, _QUIET = "#e69500", "#5b7f9f", "#888888"
_COLUMNS = 3
_BAND = 1.645  # standard deviations: 90 %
_MOST_FLIGHTS = 8  # that a figure of hidden states draws
_HIDDEN = {  # states of the catalogue as people read them: name, unit, factor, offset
    "temperature": ("Pack temperature", "degC", 1.0, -ZERO_CELSIUS_K),
    "core_rise": ("Core warmer than sensor", "K", 1.0, 0.0),
    "slow_v": ("Slow drop of a cell", "mV", 1e3, 0.0),
    "hysteresis": ("Branch (-1 after charge, 1 after discharge)", "1", 1.0, 0.0),
    "weak_soc": ("Weak cell's charge against the others", "%", 100.0, 0.0),
}
_FLIGHT_COLOURS = ("#1f77b4", "#d95f02", "#2a7f3f", "#7b4fa3", "#b2182b", "#8c6d31", "#17808c", "#c06c9e")


def map_figure(e: Explanation) -> Any:
    """Mean misfit over every variable, what was marked shaded; None where nothing varies."""
    if not e.maps:
        return None
    rows = -(-len(e.maps) // _COLUMNS)
    columns = min(_COLUMNS, len(e.maps))
    plot = make_subplots(rows=rows, cols=columns, shared_yaxes="all", vertical_spacing=0.3 / rows + 0.03)
    labels = [flight_name(c.flight.label) for c in e.courses]
    marked = False
    for k, told in enumerate(e.maps):
        place = {"row": k // _COLUMNS + 1, "col": k % _COLUMNS + 1}
        known = VARIABLES.get(told.variable, Variable(told.variable, ""))
        _bars(plot, told, known, labels, place, first=k == 0)
        for low, high in _marked(e, told):
            plot.add_vrect(
                x0=known.factor * low, x1=known.factor * high, fillcolor=_REGION, opacity=0.2, line_width=0,
                **place,
            )  # fmt: skip
            marked = True
        plot.update_xaxes(title_text=_axis(known.title, known.unit), title_font_size=12, **place)
        if place["col"] == 1:
            plot.update_yaxes(title_text="Mean misfit [mV]", title_font_size=12, **place)
    if marked:
        plot.add_scatter(
            x=[None], y=[None], mode="markers", name="where most of the misfit lies",
            marker={"symbol": "square", "size": 12, "color": _REGION, "opacity": 0.4}, row=1, col=1,
        )  # fmt: skip
    _finish(plot, 90 + 220 * rows)
    plot.update_layout(legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0}, bargap=0.0)
    return plot


def _marked(e: Explanation, told: Map) -> list[tuple[float, float]]:
    """Ranges of a variable in which the findings have most of the misfit."""
    found = e.findings.localisation
    if told.variable != "flight":
        return [r.where[told.variable] for r in found if told.variable in r.where]
    labels = [c.flight.label for c in e.courses]
    if told.mean_v.size != len(labels) or not found or len(found[0].flights) == len(labels):
        return []
    places = [labels.index(label) for label in found[0].flights if label in labels]
    return [(k - 0.5, k + 0.5) for k in places]


def _bars(plot: Any, told: Map, known: Variable, labels: Sequence[str], place: dict[str, int], *, first: bool) -> None:
    low, high = known.factor * told.edges[:-1], known.factor * told.edges[1:]
    shared = {
        "y": _short(1e3 * told.mean_v), "name": "measured minus battery file", "showlegend": first,
        "marker": {"color": _BAR, "line": {"color": "white", "width": 1}}, "customdata": _short(100.0 * told.share),
    }  # fmt: skip
    hover = "%{y:.0f} mV, %{customdata:.0f} % of the misfit<extra></extra>"
    if told.variable == "flight" and told.mean_v.size == len(labels):
        plot.add_bar(x=list(labels), hovertemplate="flight %{x}: " + hover, **shared, **place)
        plot.update_xaxes(type="category", **place)
    else:
        unit = f" {known.unit}: "
        plot.add_bar(
            x=_short(0.5 * (low + high)), width=_short(high - low), hovertemplate="%{x:.3g}" + unit + hover, **shared,
            **place,
        )  # fmt: skip
    plot.add_hline(y=0.0, line={"color": _QUIET, "width": 0.8}, **place)


def held_out_figure(e: Explanation, flight: LeftOutFlight) -> Any:
    """A flight that no fit saw: measured, by the battery file, by the explanation, and what is left of each."""
    course = next(c for c in e.courses if c.flight.label == flight.label)
    plot = _voltages(course, flight.measured_v, flight.before_v, flight.after_v, _steps(e, flight.label))
    seen_until = float(course.flight.time_s[min(flight.begin, course.flight.time_s.size - 1)]) / 60.0
    for row in (1, 2, 3):
        plot.add_vrect(
            x0=0.0, x1=seen_until, fillcolor="#6baed6", opacity=0.13, line_width=0, layer="below", row=row, col=1
        )
    plot.add_scatter(
        x=[None], y=[None], mode="markers", name="seen, for this flight's own start", row=1, col=1, legend="legend",
        marker={"symbol": "square", "size": 12, "color": "#6baed6", "opacity": 0.4},
    )  # fmt: skip
    return plot


def fitted_figure(e: Explanation, course: Course) -> Any:
    """A flight as the fit saw it: measured, by the battery file, by the explanation."""
    return _voltages(course, course.flight.voltage_v, course.before_v, course.after_v, _steps(e, course.flight.label))


def _steps(e: Explanation, label: str) -> list[float]:
    return [c.time_s / 60.0 for c in e.findings.change_points if c.flight == label]


def _voltages(course: Course, measured: Array, before: Array, after: Array, steps: Sequence[float]) -> Any:
    plot = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.03, row_heights=[0.5, 0.3, 0.2])
    t = _short(course.flight.time_s / 60.0)
    _line(plot, 1, t, measured, "measured", MEASURED, width=2.4)  # below: where a model fits, both are to be seen
    _line(plot, 1, t, before, "battery file", BEFORE)
    _line(plot, 1, t, after, "explanation", AFTER)
    _line(plot, 2, t, 1e3 * (measured - before), "measured - battery file", BEFORE)
    _line(plot, 2, t, 1e3 * (measured - after), "measured - explanation", AFTER)
    _line(plot, 3, t, course.flight.current_a, "current, measured", MEASURED)
    plot.add_hline(y=0.0, line={"color": _QUIET, "width": 0.8, "dash": "dot"}, row=2, col=1)
    for time in steps:
        for row in (1, 2, 3):
            plot.add_vline(x=time, line={"color": _REGION, "width": 1.5, "dash": "dash"}, row=row, col=1)
    if steps:
        line = {"color": _REGION, "width": 1.5, "dash": "dash"}
        plot.add_scatter(x=[None], y=[None], mode="lines", line=line, name="change point", row=1, col=1)
    for row, title in enumerate(("Pack voltage [V]", "Misfit [mV]", "Current [A]"), start=1):
        plot.update_yaxes(title_text=title, title_font_size=12, zeroline=False, row=row, col=1)
    plot.update_xaxes(title_text="time since the first sample [min]", row=3, col=1)
    _finish(plot, 620)
    plot.update_layout(hovermode="x unified")
    legend_beside_each_panel(plot, 3)
    return plot


def hidden_figure(e: Explanation) -> Any:
    """Inferred courses of what no sensor told, with their 90 % bands; None where there are none."""
    states = [name for name in _HIDDEN if any(name in c.hidden for c in e.courses)]
    if not states:
        return None
    plot = make_subplots(rows=len(states), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    shown = [c for c in e.courses if c.hidden][:_MOST_FLIGHTS]
    for row, name in enumerate(states, start=1):
        title, unit, factor, offset = _HIDDEN[name]
        for colour, course in zip(_FLIGHT_COLOURS, shown, strict=False):
            if name not in course.hidden:
                continue
            mean, sd = course.hidden[name]
            t, label = course.flight.time_s / 60.0, flight_name(course.flight.label)
            middle, reach = factor * mean + offset, factor * _BAND * sd
            _band(plot, row, t, middle - reach, middle + reach, label, colour)
            _line(plot, row, _short(t), middle, f"flight {label}, 90 % band", colour, group=label)
        plot.update_yaxes(title_text=_axis(title, unit), title_font_size=12, row=row, col=1)
    plot.update_xaxes(title_text="time since the first sample [min]", row=len(states), col=1)
    _finish(plot, 60 + 320 * len(states))
    legend_beside_each_panel(plot, len(states))
    return plot


def _axis(title: str, unit: str) -> str:
    return f"{title} [{unit}]" if unit and unit != "1" else title


def _line(
    plot: Any, row: int, x: Any, y: Array, name: str, colour: str, group: str | None = None, width: float = 1.2
) -> None:
    line = {"color": colour, "width": width}
    plot.add_scatter(x=x, y=_short(y), name=name, mode="lines", line=line, legendgroup=group, row=row, col=1)


def _band(plot: Any, row: int, t: Array, low: Array, high: Array, group: str, colour: str) -> None:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    plot.add_scatter(
        x=_short(np.concatenate([t, t[::-1]])), y=_short(np.concatenate([high, low[::-1]])), mode="lines",
        line={"width": 0}, fill="toself", fillcolor=f"rgba({red},{green},{blue},0.15)", legendgroup=group,
        showlegend=False, hoverinfo="skip", row=row, col=1,
    )  # fmt: skip


def _short(values: Array) -> Any:
    """Seven digits are enough for the eye and make half the page."""
    return np.asarray(values).astype(np.float32)


def _finish(plot: Any, height: int) -> None:
    plot.update_layout(
        height=height,
        margin={"l": 70, "r": 20, "t": 32, "b": 45},
        template="plotly_white",
        font={"family": "system-ui, sans-serif"},
    )
