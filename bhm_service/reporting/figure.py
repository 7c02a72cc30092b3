"""The figure of a replay: everything against one time axis, each panel with its unit, flights shaded."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from plotly.subplots import make_subplots

from bhm_service.messages import EndOfDischarge, Model, RemainingTime, StateEstimate
from bhm_service.replay import Replay
from bhm_service.reporting.flights import Span, spans
from bhm_service.units import Array, celsius

COLOURS = {Model.CIRC: "#1f77b4", Model.CHEM: "#d95f02"}
MEASURED = "#222222"
_FUSED, _TRUTH = "#2a7f3f", "#888888"
_PANEL_PX = 230
_GAP_S, _GAP_STEPS = 20.0, 4.0  # longer than both without a value, in seconds and usual steps, a line is broken


def figure(pages: Replay, start_s: float) -> str:
    """The figure as HTML."""
    return as_html(build(pages, start_s))


def as_html(plot: Any) -> str:
    """A plotly object as HTML (a div with its data; the library is not in it)."""
    return str(plot.to_html(full_html=False, include_plotlyjs=False, config={"displaylogo": False}))


def build(pages: Replay, start_s: float) -> Any:
    """The figure as a plotly object."""
    warm = any(s.temperature_k is not None for s in pages.samples)
    panels = ["Voltage [V]", "State of charge [%]", "Remaining flying time [min]", "Current [A]"]
    panels += ["Pack temperature [degC]"] if warm else []
    panels += ["Innovation [standard deviations]"]
    plot = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.025)

    def minutes(times: Sequence[float]) -> Array:
        return (np.asarray(times, dtype=float) - start_s) / 60.0

    _voltage(plot, pages, minutes, 1)
    _charge(plot, pages, minutes, 2)
    _remaining(plot, pages, minutes, 3)
    _line(plot, 4, pages.samples, minutes, lambda s: s.current_a, "current, measured", MEASURED)
    if warm:
        kelvin = [s for s in pages.samples if s.temperature_k is not None]
        _line(plot, 5, kelvin, minutes, lambda s: celsius(s.temperature_k), "temperature, measured", "#b2182b")
    _innovations(plot, pages, minutes, len(panels))

    flights = spans(pages.phases, pages.samples[-1].time_s) if pages.samples else []
    for span in flights:
        low, high = minutes([span.begin_s, span.end_s])
        plot.add_vrect(x0=low, x1=high, fillcolor="#6baed6", opacity=0.13, line_width=0, layer="below")
    for row, title in enumerate(panels, start=1):
        plot.update_yaxes(title_text=title, row=row, col=1, zeroline=False, title_font_size=12)
    plot.update_yaxes(range=[-6, 6], row=len(panels), col=1)
    plot.update_yaxes(range=[0, 105], row=2, col=1)
    plot.update_xaxes(title_text="time since the beginning of the log [min]", row=len(panels), col=1)
    plot.update_layout(
        height=_PANEL_PX * len(panels) + 60,
        margin={"l": 70, "r": 20, "t": 20, "b": 50},
        template="plotly_white",
        hovermode="x unified",
        font={"family": "system-ui, sans-serif"},
    )
    legend_beside_each_panel(plot, len(panels))
    return plot


def legend_beside_each_panel(plot: Any, panels: int) -> None:
    """Each panel's lines named next to it."""
    for row in range(1, panels + 1):
        suffix = "" if row == 1 else str(row)
        top = plot.layout[f"yaxis{suffix}"].domain[1]
        plot.update_layout({f"legend{suffix}": {"x": 1.01, "y": top, "yanchor": "top", "font": {"size": 11}}})
        plot.update_traces(legend=f"legend{suffix}", row=row, col=1)


def _segments(times: Array) -> list[slice]:
    """Pieces of a series that are not interrupted for long."""
    if times.size == 0:
        return []
    usual = float(np.median(np.diff(times))) if times.size > 2 else 0.0
    holes = np.flatnonzero(np.diff(times) > max(_GAP_S / 60.0, _GAP_STEPS * usual)) + 1
    edges = [0, *holes.tolist(), times.size]
    return [slice(low, high) for low, high in pairwise(edges)]


def _joined(parts: Sequence[Array]) -> Array:
    """Pieces one behind the other with a hole between."""
    return np.concatenate([np.append(part, np.nan) for part in parts]) if parts else np.empty(0)


def _line(plot: Any, row: int, items: Sequence[Any], minutes: Any, value: Any, name: str, colour: str) -> None:
    known = [(i.time_s, value(i)) for i in items if value(i) is not None]
    if not known:
        return
    t, v = minutes([k[0] for k in known]), np.array([k[1] for k in known], dtype=float)
    parts = _segments(t)
    x, y = _joined([t[p] for p in parts]), _joined([v[p] for p in parts])
    plot.add_scatter(x=x, y=y, name=name, mode="lines", line={"color": colour, "width": 1.2}, row=row, col=1)


def _band(plot: Any, row: int, t: Array, low: Array, high: Array, name: str, colour: str) -> None:
    parts = _segments(t)
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    plot.add_scatter(
        x=_joined([np.concatenate([t[p], t[p][::-1]]) for p in parts]),
        y=_joined([np.concatenate([high[p], low[p][::-1]]) for p in parts]),
        mode="lines",
        line={"width": 0},
        fill="toself",
        fillcolor=f"rgba({red},{green},{blue},0.18)",
        name=name,
        hoverinfo="skip",
        row=row,
        col=1,
    )


def _voltage(plot: Any, pages: Replay, minutes: Any, row: int) -> None:
    for model, estimates in pages.estimates.items():
        seen = [e for e in estimates if e.voltage_expected_v is not None and e.voltage_expected_sd_v is not None]
        if not seen:
            continue
        t = minutes([e.time_s for e in seen])
        mean = np.array([e.voltage_expected_v for e in seen])
        reach = 1.645 * np.array([e.voltage_expected_sd_v for e in seen])
        _band(plot, row, t, mean - reach, mean + reach, f"voltage, {model.value}, 90 % band", COLOURS[model])
        _line(plot, row, seen, minutes, _expected, f"voltage, {model.value}, one sample ahead", COLOURS[model])
    _line(plot, row, pages.samples, minutes, lambda s: s.voltage_v, "voltage, measured", MEASURED)
    refused = [e for found in pages.estimates.values() for e in found if e.rejected is not None]
    refused = [e for e in refused if e.voltage_measured_v is not None]
    if refused:
        plot.add_scatter(
            x=minutes([e.time_s for e in refused]),
            y=[e.voltage_measured_v for e in refused],
            mode="markers",
            marker={"symbol": "x", "color": "#c00", "size": 6},
            name="voltage, rejected",
            text=[f"{e.model.value}: {e.rejected.value if e.rejected else ''}" for e in refused],
            row=row,
            col=1,
        )


def _expected(estimate: StateEstimate) -> float | None:
    return estimate.voltage_expected_v


def _charge(plot: Any, pages: Replay, minutes: Any, row: int) -> None:
    for model, estimates in pages.estimates.items():
        valid = [e for e in estimates if e.valid]
        if not valid:
            continue
        t = minutes([e.time_s for e in valid])
        low, high = (np.array([100.0 * getattr(e, name) for e in valid]) for name in ("soc_low", "soc_high"))
        _band(plot, row, t, low, high, f"SoC, {model.value}, 90 % band", COLOURS[model])
        _line(plot, row, valid, minutes, lambda e: 100.0 * e.soc, f"SoC, {model.value}", COLOURS[model])
    _line(
        plot,
        row,
        pages.samples,
        minutes,
        lambda s: None if s.remaining is None else 100.0 * s.remaining,
        "SoC, as the autopilot says",
        _TRUTH,
    )


def _remaining(plot: Any, pages: Replay, minutes: Any, row: int) -> None:
    known = [r for r in pages.remaining if r.median_s is not None]
    if known:
        t = minutes([r.time_s for r in known])
        _band(plot, row, t, _minutes_of(known, "low_s"), _minutes_of(known, "high_s"), "RFT, 90 % band", _FUSED)
    for model, predictions in pages.predictions.items():
        _line(plot, row, predictions, minutes, _median, f"RFT, {model.value}", COLOURS[model])
    _line(plot, row, known, minutes, lambda r: r.median_s / 60.0, "RFT, both", _FUSED)
    last = pages.samples[-1].time_s if pages.samples else 0.0
    for k, span in enumerate(spans(pages.phases, last)):
        _time_to_landing(plot, span, minutes, row, first=k == 0)


def _time_to_landing(plot: Any, span: Span, minutes: Any, row: int, *, first: bool) -> None:
    plot.add_scatter(
        x=minutes([span.begin_s, span.end_s]),
        y=[(span.end_s - span.begin_s) / 60.0, 0.0],
        mode="lines",
        line={"color": _TRUTH, "dash": "dot", "width": 1.2},
        name="time to landing (the flight that was flown)",
        legendgroup="landing",
        showlegend=first,
        row=row,
        col=1,
    )


def _minutes_of(remaining: Sequence[RemainingTime], name: str) -> Array:
    return np.array([getattr(r, name) for r in remaining], dtype=float) / 60.0


def _median(prediction: EndOfDischarge) -> float:
    return prediction.median_s / 60.0


def _innovations(plot: Any, pages: Replay, minutes: Any, row: int) -> None:
    for model, estimates in pages.estimates.items():
        seen = [e for e in estimates if e.voltage_expected_v is not None and e.voltage_expected_sd_v]
        plot.add_scatter(
            x=minutes([e.time_s for e in seen]),
            y=[
                ((e.voltage_measured_v or 0.0) - (e.voltage_expected_v or 0.0)) / (e.voltage_expected_sd_v or 1.0)
                for e in seen
            ],
            mode="markers",
            marker={"color": COLOURS[model], "size": 3},
            name=f"innovation, {model.value}",
            row=row,
            col=1,
        )
    for level in (-2.0, 2.0):
        plot.add_hline(y=level, line={"color": _TRUTH, "width": 0.8, "dash": "dot"}, row=row, col=1)
