"""The page of an identification: one HTML file that needs nothing else."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, select_autoescape
from plotly.offline import get_plotlyjs

from bhm_service.identification.identify import Identified
from bhm_service.reporting.figure import as_html
from bhm_service.reporting.identified import (
    PARAMETER_HEADER,
    QUALITY_HEADER,
    error_text,
    headline,
    open_questions,
    parameters,
    quality,
    recordings,
    resistance,
    splits,
    subtitle,
)
from bhm_service.reporting.identified_figure import curve_figure, experiment_figure, title

_FULL_TINT_V = 0.04  # an error this large is tinted fully


def identified_page(identified: Identified) -> str:
    """The page as HTML."""
    environment = Environment(loader=PackageLoader("bhm_service.reporting"), autoescape=select_autoescape())
    models = [
        {
            "name": result.model,
            "parameters": parameters(result),
            "open": open_questions(result),
            "remarks": result.remarks,
        }
        for result in identified.results
    ]
    tables = [
        {
            "model": table.model,
            "header": table.header,
            "rows": [
                (label, [(error_text(e), 0.0 if e is None else min(e.rmse / _FULL_TINT_V, 1.0)) for e in errors])
                for label, errors in table.rows
            ],
        }
        for table in splits(identified)
    ]
    groups = recordings(identified)
    assessed = [a for group in groups for _, a in group]
    return environment.get_template("identified.html").render(
        title=f"{identified.battery.name}: identified",
        subtitle=subtitle(identified),
        source=identified.battery.source,
        headline=list(zip(headline(identified), [r.followed for r in identified.results], strict=True)),
        quality_header=QUALITY_HEADER,
        quality=quality(identified),
        held_out=any(a.held_out for a in assessed),
        oracle=any(a.oracle is not None for a in assessed),
        models=models,
        parameter_header=PARAMETER_HEADER,
        resistance=resistance(identified),
        remarks=identified.remarks,
        splits=tables,
        curve=as_html(curve_figure(identified)),
        figures=[(title(group[0][1]), as_html(experiment_figure(group))) for group in groups],
        plotly_js=get_plotlyjs(),
    )
