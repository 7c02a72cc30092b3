"""A replay in a few numbers per flight and model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.messages import BatterySample, FlightPhase, Model, RemainingTime, StateEstimate
from bhm_service.replay import Replay
from bhm_service.units import SECONDS_PER_HOUR

SHORTEST_S = 5.0  # a hop on landing is no flight
MOMENTS = (0.1, 0.5, 0.9)  # shares of a flight at which its remaining time is shown


@dataclass(frozen=True, slots=True)
class Span:
    """A flight: take-off to landing, or to the end of the log."""

    begin_s: float
    end_s: float
    landed: bool
    because: str  # how the take-off was noticed


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRow:
    """One model in one flight."""

    model: Model
    soc_begin: tuple[float, float, float] | None  # 5 %, median, 95 %
    soc_end: tuple[float, float, float] | None
    remaining_s: tuple[float | None, ...]  # at `MOMENTS`, and at the end
    rmse_v: float | None  # of the voltage expected one sample ahead
    bias_v: float | None  # measured minus expected
    nis: float | None  # mean; 1 where the filter is as sure as it should be
    used: int
    rejected: dict[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSummary:
    """One flight."""

    number: int
    span: Span
    charge_ah: float | None
    mean_a: float | None
    mean_w: float | None
    rows: tuple[ModelRow, ...]
    fused_s: tuple[tuple[float, float, float] | None, ...]  # 5 %, median, 95 % at `MOMENTS`, and at the end


def spans(phases: Sequence[FlightPhase], last_s: float) -> list[Span]:
    """Flights from take-offs and landings."""
    found: list[Span] = []
    began: FlightPhase | None = None
    for phase in phases:
        if phase.airborne:
            began = phase
        elif began is not None:
            found.append(Span(began.time_s, phase.time_s, True, began.because))
            began = None
    if began is not None:
        found.append(Span(began.time_s, last_s, False, began.because))
    return [span for span in found if span.end_s - span.begin_s >= SHORTEST_S]


def summarise(pages: Replay) -> list[FlightSummary]:
    """Every flight of a replay."""
    if not pages.samples:
        return []
    flights = spans(pages.phases, pages.samples[-1].time_s)
    return [_flight(pages, number, span) for number, span in enumerate(flights, start=1)]


def _flight(pages: Replay, number: int, span: Span) -> FlightSummary:
    inside = [s for s in pages.samples if span.begin_s <= s.time_s <= span.end_s]
    known = [s for s in inside if s.current_a is not None and s.voltage_v is not None]
    moments = [span.begin_s + share * (span.end_s - span.begin_s) for share in MOMENTS] + [span.end_s]
    return FlightSummary(
        number=number,
        span=span,
        charge_ah=_charge_ah(known),
        mean_a=float(np.mean([s.current_a for s in known])) if known else None,
        mean_w=float(np.mean([(s.current_a or 0.0) * (s.voltage_v or 0.0) for s in known])) if known else None,
        rows=tuple(_row(pages, model, span, moments) for model in pages.estimates),
        fused_s=tuple(_fused_at(pages.remaining, moment) for moment in moments),
    )


def _charge_ah(samples: Sequence[BatterySample]) -> float | None:
    if len(samples) < 2:
        return None
    return float(np.trapezoid([s.current_a for s in samples], [s.time_s for s in samples])) / SECONDS_PER_HOUR


def _row(pages: Replay, model: Model, span: Span, moments: Sequence[float]) -> ModelRow:
    inside = [e for e in pages.estimates[model] if span.begin_s <= e.time_s <= span.end_s]
    used = [e for e in inside if e.rejected is None and e.voltage_expected_v is not None]
    errors = np.array([(e.voltage_measured_v or 0.0) - (e.voltage_expected_v or 0.0) for e in used])
    predictions = pages.predictions.get(model, [])
    times = np.array([p.time_s for p in predictions])
    return ModelRow(
        model=model,
        soc_begin=_soc(inside[0]) if inside else None,
        soc_end=_soc(inside[-1]) if inside else None,
        remaining_s=tuple(
            predictions[k].median_s if (k := _latest(times, moment)) is not None else None for moment in moments
        ),
        rmse_v=float(np.sqrt(np.mean(errors**2))) if used else None,
        bias_v=float(np.mean(errors)) if used else None,
        nis=float(np.mean([e.nis for e in used])) if used else None,
        used=len(used),
        rejected=dict(Counter(e.rejected.value for e in inside if e.rejected is not None)),
    )


def _soc(estimate: StateEstimate) -> tuple[float, float, float] | None:
    return (estimate.soc_low, estimate.soc, estimate.soc_high) if estimate.valid else None


def _latest(times: np.ndarray, moment: float, within_s: float = 3.0) -> int | None:
    k = int(np.searchsorted(times, moment, side="right")) - 1
    return k if k >= 0 and moment - times[k] <= within_s else None


def _fused_at(remaining: Sequence[RemainingTime], moment: float) -> tuple[float, float, float] | None:
    k = _latest(np.array([r.time_s for r in remaining]), moment)
    if k is None:
        return None
    r = remaining[k]
    if r.low_s is None or r.median_s is None or r.high_s is None:
        return None
    return (r.low_s, r.median_s, r.high_s)
