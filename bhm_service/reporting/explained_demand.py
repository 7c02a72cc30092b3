"""The demand's side of an explanation as rows of text and as a figure; the page and the terminal show the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from plotly.subplots import make_subplots

from bhm_service.discrepancy.demand_side import DemandSide, NotLooked, PowerCourse
from bhm_service.discrepancy.findings import EffectFound
from bhm_service.discrepancy.labels import flight_name
from bhm_service.prediction.demand_effects import DEMAND_EFFECTS
from bhm_service.reporting.explained_tables import EffectBlock, with_sd
from bhm_service.reporting.figure import MEASURED, legend_beside_each_panel
from bhm_service.units import Array

POWER_HEADER = ("power error (RMSE)", "vehicle file", "explanation")
LASTS_HEADER = ("flight", "mean power", "vehicle file", "explanation", "a flight lasts")
_BEFORE, _AFTER, _STEP, _QUIET = "#d6604d", "#2a7f3f", "#e69500", "#888888"
_LEAST = 0.005  # of a flight's time: less goes without saying


def demand_line(demand: DemandSide | NotLooked) -> str:
    """The demand's side in a line; why it was not looked at."""
    return f"not looked at: {demand.because}." if isinstance(demand, NotLooked) else demand.sentence


def demand_blocks(demand: DemandSide) -> list[EffectBlock]:
    """What was found, the largest first."""
    told = zip(demand.effects, demand.in_words, demand.asked_for, strict=True)
    return [_block(found, words, asked_for) for found, words, asked_for in told]


def _block(found: EffectFound, words: str, asked_for: float) -> EffectBlock:
    kind = DEMAND_EFFECTS[found.id]
    (declared,) = kind.parameters()
    unit = "" if declared.unit == "1" else f" {declared.unit}"
    rows: list[tuple[str, ...]] = []
    for key, told in found.parameters.items():
        of = key.removesuffix("]").partition("[")[2]
        meaning = declared.meaning + (f" (flight {flight_name(of)})" if of else "")
        rows.append((declared.symbol, f"{with_sd(told.value, told.sd)}{unit}", meaning))
    grounds = [
        f"Evidence: {found.evidence_nats:.0f} nats beyond the best explanation without it; "
        f"{asked_for:.0f} are asked for.",
        f"{100.0 * found.share_of_misfit:.0f} % of the squared power error goes with it.",
    ]
    return EffectBlock(kind.title, found.id, kind.equation, kind.source, words, rows, grounds)


def demand_fit(demand: DemandSide) -> list[tuple[str, ...]]:
    """Rows under `POWER_HEADER`."""
    rows = [("on the flights of the fit", *(f"{w:.0f} W" for w in demand.errors_w))]
    if demand.unseen_w is not None:
        rows.append(("on what no fit saw", *(f"{w:.0f} W" for w in demand.unseen_w)))
    return [*rows, ("wind and control, from second to second", "", f"{demand.noise * demand.craft.hover_w:.0f} W")]


def lasts(demand: DemandSide) -> list[tuple[str, ...]]:
    """Rows under `LASTS_HEADER`: what the effects change for the time in the air."""
    return [
        (
            flight_name(c.flight.label),
            *(f"{float(np.mean(w)):.0f} W" for w in (c.flight.power_w, c.before_w, c.after_w)),
            _time(longer(c)),
        )
        for c in demand.courses
    ]


def longer(course: PowerCourse) -> float:
    """By which share a flight lasts longer than the vehicle file says, on the same energy."""
    return float(np.mean(course.before_w) / np.mean(course.after_w)) - 1.0


def lasts_in_words(demand: DemandSide) -> str:
    """The same in a sentence; empty where nothing was found or nothing changes."""
    if not demand.effects:
        return ""
    most = max(demand.courses, key=lambda c: abs(longer(c)))
    if abs(longer(most)) < _LEAST:
        return ""
    flight = flight_name(most.flight.label)
    return f"On the same energy flight {flight} lasts {_time(longer(most))} than by the vehicle file."


def _time(share: float) -> str:
    return f"{100.0 * abs(share):.1f} % {'longer' if share >= 0.0 else 'shorter'}"


def shown_course(demand: DemandSide) -> PowerCourse:
    """The flight that the explanation changes most."""
    return max(demand.courses, key=lambda c: float(np.mean((c.after_w - c.before_w) ** 2)))


def power_figure(demand: DemandSide, course: PowerCourse) -> Any:
    """Power measured, by the vehicle file and by the explanation, what is left of each, and the motion."""
    plot = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.03, row_heights=[0.5, 0.28, 0.22])
    t = course.flight.time_s / 60.0
    lines: Sequence[tuple[int, Array, str, str, float]] = (
        (1, course.flight.power_w, "measured", MEASURED, 1.8),
        (1, course.before_w, "vehicle file", _BEFORE, 1.4),
        (1, course.after_w, "explanation", _AFTER, 1.4),
        (2, _smooth(course.flight.power_w - course.before_w, t), "measured - vehicle file", _BEFORE, 1.4),
        (2, _smooth(course.flight.power_w - course.after_w, t), "measured - explanation", _AFTER, 1.4),
        (3, course.flight.climb_mps, "climb", "#5b7f9f", 1.4),
        (3, course.flight.airspeed_mps, "airspeed", "#7b4fa3", 1.4),
    )
    for row, values, name, colour, width in lines:
        line = {"color": colour, "width": width}
        plot.add_scatter(x=t.round(3), y=values.round(2), name=name, mode="lines", line=line, row=row, col=1,
                         legend="legend" if row == 1 else f"legend{row}")  # fmt: skip
    plot.add_hline(y=0.0, line={"color": _QUIET, "width": 0.8, "dash": "dot"}, row=2, col=1)
    steps = [c.time_s / 60.0 for c in demand.change_points if c.flight == course.flight.label]
    dashed = {"color": _STEP, "width": 1.5, "dash": "dash"}
    for time in steps:
        for row in (1, 2, 3):
            plot.add_vline(x=time, line=dashed, row=row, col=1)
    if steps:
        plot.add_scatter(x=[None], y=[None], mode="lines", line=dashed, name="payload let go", row=1, col=1)
    for row, title in enumerate(("Power [W]", "Misfit, 15 s mean [W]", "Motion [m/s]"), start=1):
        plot.update_yaxes(title_text=title, title_font_size=12, zeroline=False, row=row, col=1)
    plot.update_xaxes(title_text="time since the first sample [min]", row=3, col=1)
    plot.update_layout(
        template="plotly_white", height=620, margin={"l": 60, "r": 20, "t": 20, "b": 45}, hovermode="x unified"
    )
    legend_beside_each_panel(plot, 3)
    return plot


def _smooth(misfit: Array, minutes: Array) -> Array:
    width = max(int(0.25 / max(float(np.median(np.diff(minutes))), 1e-3)), 1)
    kernel = np.ones(width)
    return np.asarray(np.convolve(misfit, kernel, "same") / np.convolve(np.ones(misfit.size), kernel, "same"))
