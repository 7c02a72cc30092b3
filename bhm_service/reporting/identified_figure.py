"""The figures of an identification: every experiment against its models, and the open-circuit curve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from plotly.subplots import make_subplots

from bhm_service.battery.battery_file import ModelName
from bhm_service.identification.assess import ABOVE_SOC, Assessment
from bhm_service.identification.experiment import Kind
from bhm_service.identification.identify import Identified, ModelResult
from bhm_service.messages import Model
from bhm_service.reporting.figure import COLOURS, MEASURED, legend_beside_each_panel
from bhm_service.units import SECONDS_PER_HOUR, Array

_HEIGHTS = (0.5, 0.22, 0.28)
_PX = 640
_RESIDUAL_QUANTILE = 0.98  # of the samples above `ABOVE_SOC`: what the residual's axis has to show at least
_SOC = np.linspace(0.0, 1.0, 201)
_STEP = 1e-5
_LINE = 1.2


def experiment_figure(by_model: Sequence[tuple[ModelName, Assessment]]) -> Any:
    """Voltage, state of charge and residual of one recording (the paper's Figs. 16-24) as a plotly object."""
    measured = by_model[0][1].experiment
    span = float(measured.time_s[-1])
    unit, per = ("h", SECONDS_PER_HOUR) if span > 2.0 * SECONDS_PER_HOUR else ("min", 60.0)
    t = _short(measured.time_s / per)
    plot = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.03, row_heights=list(_HEIGHTS))
    _line(plot, 1, t, measured.voltage_v, "measured", MEASURED)
    reach = 0.005
    for model, a in by_model:
        colour = COLOURS[Model(model)]
        residual = 1e3 * (a.modelled_v - a.experiment.voltage_v)
        _line(plot, 1, t, a.modelled_v, model, colour)
        _line(plot, 2, t, 100.0 * a.soc, f"SoC, {model}", colour)
        _line(plot, 3, t, residual, f"{model} - measured", colour)
        quoted = np.abs(residual[(a.soc > ABOVE_SOC) & np.isfinite(residual)])
        reach = max(reach, float(np.quantile(quoted, _RESIDUAL_QUANTILE)) if quoted.size else 0.0)
    plot.add_hline(y=0.0, line={"color": "#888888", "width": 0.8, "dash": "dot"}, row=3, col=1)
    volts = measured.voltage_v[measured.measured]
    room = 0.05 * float(np.ptp(volts)) + 1e-3
    titles = ("Cell voltage [V]", "State of charge [%]", "Residual [mV]")
    for row, title in enumerate(titles, start=1):
        plot.update_yaxes(title_text=title, row=row, col=1, zeroline=False, title_font_size=12)
    plot.update_yaxes(range=[float(volts.min()) - room, float(volts.max()) + room], row=1, col=1)
    plot.update_yaxes(range=[0, 105], row=2, col=1)
    plot.update_yaxes(range=[-1.6 * reach, 1.6 * reach], row=3, col=1)
    plot.update_xaxes(title_text=f"time [{unit}]", row=3, col=1)
    _finish(plot, 3, _PX)
    return plot


def curve_figure(identified: Identified) -> Any:
    """The open-circuit curve of every model with what is not known of it, as a plotly object."""
    plot = make_subplots(rows=1, cols=1)
    slow = [a for a in identified.results[0].assessments if a.experiment.kind is Kind.SLOW]
    for a in slow[:1]:
        order = np.argsort(a.soc)
        _line(plot, 1, _short(100.0 * a.soc[order]), a.experiment.voltage_v[order], f"{a.label}, measured", MEASURED)
    for result in identified.results:
        colour = COLOURS[Model(result.model)]
        volts, sd = open_circuit(result)
        red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
        plot.add_scatter(
            x=_short(np.concatenate([100.0 * _SOC, 100.0 * _SOC[::-1]])),
            y=_short(np.concatenate([volts + 2.0 * sd, (volts - 2.0 * sd)[::-1]])),
            mode="lines",
            line={"width": 0},
            fill="toself",
            fillcolor=f"rgba({red},{green},{blue},0.18)",
            name=f"{result.model}, two standard deviations",
            hoverinfo="skip",
        )
        _line(plot, 1, _short(100.0 * _SOC), volts, f"{result.model}, open circuit", colour)
    plot.update_xaxes(title_text="State of charge [%]", range=[0, 100])
    plot.update_yaxes(title_text="Cell voltage [V]", title_font_size=12)
    _finish(plot, 1, 420)
    return plot


def open_circuit(result: ModelResult) -> tuple[Array, Array]:
    """The fitted curve on 0 ... 1 and its standard deviation from the covariance. [V]"""
    problem, x = result.solution.problem, result.solution.x
    points = np.vstack([x, x + _STEP * np.eye(x.size)])
    cell = problem.family.cell(problem.unknowns.values(points))
    curves = np.broadcast_to(np.asarray(cell.open_circuit(_SOC)), (x.size + 1, _SOC.size))
    slopes = (curves[1:] - curves[0]) / _STEP
    variance = np.einsum("ks,kl,ls->s", slopes, result.spread.covariance, slopes)
    return curves[0], np.sqrt(np.maximum(variance, 0.0))


def title(assessment: Assessment) -> str:
    """A recording's name, what it was made for and whether the fit saw it."""
    return f"{assessment.label} ({assessment.kind}{', held out' if assessment.held_out else ''})"


def _line(plot: Any, row: int, x: Array, y: Array, name: str, colour: str) -> None:
    line = {"color": colour, "width": _LINE}
    plot.add_scatter(x=x, y=_short(y), name=name, mode="lines", line=line, row=row, col=1)


def _short(values: Array) -> Any:
    """Seven digits are enough for the eye and make half the page."""
    return values.astype(np.float32)


def _finish(plot: Any, rows: int, height: int) -> None:
    plot.update_layout(
        height=height,
        margin={"l": 70, "r": 20, "t": 32, "b": 45},
        template="plotly_white",
        hovermode="x unified",
        font={"family": "system-ui, sans-serif"},
    )
    legend_beside_each_panel(plot, rows)
