"""Numbers as people read them."""

from __future__ import annotations

from datetime import UTC, datetime

_EARLIEST_UNIX_S = 1e9  # stamps below count from a boot, not from 1970


def duration(seconds: float | None) -> str:
    """Minutes and seconds, ``12:05``; a dash for what is not known."""
    if seconds is None:
        return "-"
    whole = round(seconds)
    if whole >= 6000:
        return f"{whole // 3600}h{whole % 3600 // 60:02d}"
    return f"{whole // 60}:{whole % 60:02d}"


def moment(time_s: float, start_s: float) -> str:
    """When something was: the time of day in UTC where the log knows it, else since its beginning."""
    if time_s >= _EARLIEST_UNIX_S:
        return datetime.fromtimestamp(time_s, UTC).strftime("%H:%M:%S")
    return f"+{duration(time_s - start_s)}"


def date(time_s: float) -> str | None:
    """The day, where the log knows it."""
    return datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%d") if time_s >= _EARLIEST_UNIX_S else None


def percent_band(band: tuple[float, float, float] | None) -> str:
    """A state of charge with its 90 % band: ``83 % (81-85)``."""
    if band is None:
        return "-"
    low, middle, high = (round(100.0 * value) for value in band)
    return f"{middle} % ({low}-{high})"


def number(value: float | None, digits: int, factor: float = 1.0) -> str:
    """A number with so many digits; a dash for what is not known."""
    return "-" if value is None else f"{value * factor:.{digits}f}"
