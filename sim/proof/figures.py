"""The score card's figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from sim.proof.scoring.answers import Answer
from sim.proof.scoring.hidden import since_start, stem
from sim.proof.scoring.judge import Judgement
from sim.proof.scoring.rates import coverage
from sim.proof.scoring.score import SuiteScore

_RIGHT, _WRONG, _QUIET, _TRUTH = "#2a7f3f", "#c0392b", "#888888", "#222222"
_LEVELS = np.linspace(0.05, 0.99, 48)
_FEWEST_Z = 5
_PANELS = 12  # withheld channels shown


def html(figure: Figure) -> str:
    """A figure as a div; the library is not in it."""
    return str(figure.to_html(full_html=False, include_plotlyjs=False, config={"displaylogo": False}))


def figures(score: SuiteScore, answers: Sequence[Answer], inferred: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Title and figure of whatever a suite can show."""
    found = [("What was concealed, and what was said", html(confusion(score)))]
    drawn = (
        ("Found, by how clearly the effect shows", sensitivity(score)),
        ("Error on held-out flights, before and after the repair", residuals(score.judgements)),
        ("Are the parameters' intervals honest?", calibration(score)),
        ("Withheld channel, opened after the verdict", withheld(answers, inferred)),
    )
    return found + [(title, html(figure)) for title, figure in drawn if figure is not None]


def confusion(score: SuiteScore) -> Figure:
    """Counts; green on the diagonal, red beside it, so that a colour is never just a number."""
    truths, said, counts = score.confusion()
    share = np.array([[c / max(sum(row), 1) for c in row] for row in counts])
    signed = np.array([[share[i, j] * (1.0 if i == j else -1.0) for j in range(len(said))] for i in range(len(truths))])
    figure = Figure()
    figure.add_heatmap(
        z=signed,
        x=said,
        y=truths,
        text=[[str(c) if c else "" for c in row] for row in counts],
        texttemplate="%{text}",
        colorscale=[(0.0, "#c0392b"), (0.5, "#ffffff"), (1.0, "#2a7f3f")],
        zmin=-1.0,
        zmax=1.0,
        showscale=False,
        xgap=1,
        ygap=1,
        hovertemplate="concealed: %{y}<br>said: %{x}<br>cases: %{text}<extra></extra>",
    )
    longest = max(map(len, said))
    figure.update_xaxes(title_text="said (the truth's own class where the first name is in it)", tickangle=-40)
    figure.update_yaxes(title_text="concealed (equivalence class)", autorange="reversed")
    return _laid_out(figure, 26 * len(truths) + 130 + 5 * longest, left=90)


def sensitivity(score: SuiteScore) -> Figure | None:
    """Share found in each SNR class, with its exact interval."""
    rows = [row for row in score.rows if row.name.startswith("found at SNR") and row.n]
    if not rows:
        return None
    figure = Figure()
    figure.add_bar(
        x=[f"{row.name.removeprefix('found at ')}<br>{row.n} cases" for row in rows],
        y=[100.0 * row.value for row in rows],
        marker_color="#6baed6",
        error_y={
            "type": "data",
            "symmetric": False,
            "array": [100.0 * (row.interval[1] - row.value) for row in rows if row.interval],
            "arrayminus": [100.0 * (row.value - row.interval[0]) for row in rows if row.interval],
        },
        width=0.5,
        name="found, with its 95 % interval",
        showlegend=True,
    )
    figure.update_yaxes(title_text="found and named right [%]", range=[0, 105])
    figure.update_xaxes(title_text="signal-to-noise ratio of what was concealed [-]")
    return _laid_out(figure, 340)


def residuals(judged: Sequence[Judgement]) -> Figure | None:
    """Held-out RMSE after against before."""
    with_fit = [j for j in judged if j.heldout_v is not None]
    if not with_fit:
        return None
    figure = Figure()
    kinds = (
        ("named right", _RIGHT, "circle", [j for j in with_fit if j.first_right]),
        ("named wrong, or nothing was there", _WRONG, "x", [j for j in with_fit if j.first_right is False]),
        ("no name", _QUIET, "square-open", [j for j in with_fit if j.first_right is None]),
    )
    for name, colour, symbol, of in kinds:
        if of:
            figure.add_scatter(
                x=[1e3 * j.heldout_v[0] for j in of if j.heldout_v],
                y=[1e3 * j.heldout_v[1] for j in of if j.heldout_v],
                text=[f"{j.case}: {j.label}, said {j.said}" for j in of],
                mode="markers",
                marker={"color": colour, "symbol": symbol, "size": 8},
                name=name,
            )
    edges = [1e3 * v for j in with_fit if j.heldout_v for v in j.heldout_v]
    low, high = 0.8 * max(min(edges), 1e-2), 1.25 * max(edges)
    for factor, words in ((1.0, "no better"), (0.5, "half the error")):
        figure.add_scatter(
            x=[low, high], y=[factor * low, factor * high], mode="lines", name=words,
            line={"color": _QUIET, "width": 1, "dash": "solid" if factor == 1.0 else "dot"},
        )  # fmt: skip
    figure.update_xaxes(title_text="held-out RMSE before [mV]", type="log", dtick="D2")
    figure.update_yaxes(title_text="held-out RMSE after [mV]", type="log", dtick="D2")
    return _laid_out(figure, 420)


def calibration(score: SuiteScore) -> Figure | None:
    """Share of true values inside intervals of every level."""
    z = score.errors_z()
    if len(z) < _FEWEST_Z:
        return None
    rates = [coverage(z, float(level)) for level in _LEVELS]
    x = 100.0 * _LEVELS
    figure = Figure()
    figure.add_scatter(
        x=[*x, *x[::-1]],
        y=[100.0 * r.interval[1] for r in rates] + [100.0 * r.interval[0] for r in reversed(rates)],
        fill="toself",
        line={"width": 0},
        fillcolor="rgba(31,119,180,0.18)",
        name="95 % interval of the share",
        hoverinfo="skip",
    )
    figure.add_scatter(
        x=x, y=[100.0 * r.value for r in rates], mode="lines", line={"color": "#1f77b4"}, name=f"{len(z)} parameters"
    )
    figure.add_scatter(x=[0, 100], y=[0, 100], mode="lines", line={"color": _QUIET, "dash": "dot"}, name="honest")
    figure.update_xaxes(title_text="level of the interval [%]", range=[0, 100])
    figure.update_yaxes(title_text="true values inside [%]", range=[0, 100])
    return _laid_out(figure, 380)


def withheld(answers: Sequence[Answer], inferred: Mapping[str, Any]) -> Figure | None:
    """Withheld channels and what was inferred for them, one panel a flight."""
    panels = [
        (answer, flight, quantity)
        for answer in answers
        for flight, columns in sorted(answer.hidden.items())[:2]
        for quantity in sorted(set(columns) - {"time_s"})
    ][:_PANELS]
    if not panels:
        return None
    across = min(3, len(panels))
    down = math.ceil(len(panels) / across)
    titles = [f"{a.group or a.case}, {flight}" for a, flight, _ in panels]
    plot = make_subplots(rows=down, cols=across, subplot_titles=titles, vertical_spacing=0.32 / down)
    for k, (answer, flight, quantity) in enumerate(panels):
        row, col = k // across + 1, k % across + 1
        columns = answer.hidden[flight]
        unit = quantity.rsplit("_", 1)[-1]
        _line(plot, row, col, columns["time_s"], columns[quantity], "withheld", _TRUTH, first=k == 0)
        given: Mapping[str, Any] = next(
            (of for f, of in inferred.get(answer.case, {}).items() if stem(f) == stem(flight)), {}
        )
        if quantity in given and "time_s" in given:
            start = answer.starts_s.get(flight, 0.0)
            times = [since_start(t, start) for t in given["time_s"]]
            _line(plot, row, col, times, given[quantity], "inferred", "#d95f02", first=k == 0)
        plot.update_yaxes(title_text=f"{quantity.rsplit('_', 1)[0]} [{unit}]", row=row, col=col, title_font_size=11)
        plot.update_xaxes(title_text="time [min]", row=row, col=col, title_font_size=11)
    plot.update_annotations(font_size=11)
    return _laid_out(plot, 250 * down + 80)


def _line(
    plot: Any, row: int, col: int, x: Sequence[float], y: Sequence[float], name: str, colour: str, *, first: bool
) -> None:
    plot.add_scatter(
        x=np.asarray(x) / 60.0, y=np.asarray(y), name=name, legendgroup=name, showlegend=first,
        mode="lines", line={"color": colour, "width": 1.4}, row=row, col=col,
    )  # fmt: skip


def _laid_out(figure: Any, height: int, left: int = 70) -> Figure:
    figure.update_layout(
        height=height,
        margin={"l": left, "r": 20, "t": 30, "b": 60},
        template="plotly_white",
        font={"family": "system-ui, sans-serif"},
    )
    return figure
