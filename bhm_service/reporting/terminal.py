"""The tables of a replay, at most a hundred columns wide; the terminal, the page and the README show the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bhm_service.reporting.flights import MOMENTS, FlightSummary
from bhm_service.reporting.words import duration, moment, number, percent_band

HEADER = (
    "",
    "SoC take-off",
    "SoC landing",
    *(f"RFT at {share:.0%}" for share in MOMENTS),
    "at end",
    "V rmse",
    "bias",
    "NIS",
    "rejected",
)


@dataclass(frozen=True, slots=True)
class FlightTable:
    """One flight as text: a title and rows under `HEADER`."""

    title: str
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]


def flight_tables(flights: Sequence[FlightSummary], start_s: float) -> list[FlightTable]:
    """A table for every flight."""
    return [_table(flight, start_s) for flight in flights]


def _table(flight: FlightSummary, start_s: float) -> FlightTable:
    span = flight.span
    end = "landed" if span.landed else "log ends"
    title = (
        f"Flight {flight.number}: took off {moment(span.begin_s, start_s)}, {end} {moment(span.end_s, start_s)} "
        f"({duration(span.end_s - span.begin_s)})"
    )
    if flight.mean_a is not None:
        title += f"; {flight.mean_a:.1f} A, {number(flight.mean_w, 0)} W, {number(flight.charge_ah, 2)} Ah"
    rows: list[tuple[str, ...]] = []
    notes: list[str] = []
    for row in flight.rows:
        rejected = sum(row.rejected.values())
        rows.append(
            (
                row.model.value,
                percent_band(row.soc_begin),
                percent_band(row.soc_end),
                *(duration(seconds) for seconds in row.remaining_s),
                f"{number(row.rmse_v, 0, 1e3)} mV" if row.rmse_v is not None else "-",
                number(row.bias_v, 0, 1e3),
                number(row.nis, 2),
                f"{rejected} of {rejected + row.used}",
            )
        )
        notes += [f"{row.model.value}: {count} rejected, {why}" for why, count in row.rejected.items()]
    if any(flight.fused_s):
        rows.append(("both", "", "", *(_middle(band) for band in flight.fused_s), "", "", "", ""))
        rows.append(("5 %", "", "", *(_part(band, 0) for band in flight.fused_s), "", "", "", ""))
        rows.append(("95 %", "", "", *(_part(band, 2) for band in flight.fused_s), "", "", "", ""))
    return FlightTable(title, tuple(rows), tuple(notes))


def _middle(band: tuple[float, float, float] | None) -> str:
    return _part(band, 1)


def _part(band: tuple[float, float, float] | None, which: int) -> str:
    return "-" if band is None else duration(band[which])
