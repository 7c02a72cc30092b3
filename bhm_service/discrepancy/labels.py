"""Flights as people call them."""

from __future__ import annotations

from collections.abc import Sequence


def flight_name(label: str) -> str:
    """A flight by its log's name, without the ending."""
    stem, bracket, part = label.partition(" [")
    return stem.removesuffix(".gz").rsplit(".", 1)[0] + bracket + part


def flights_in_words(labels: Sequence[str], every: Sequence[str]) -> str:
    """``flights 00 to 02``: some flights out of all, shortly."""
    if len(labels) == len(every):
        return "every flight"
    names = [flight_name(label) for label in labels]
    if len(names) == 1:
        return f"flight {names[0]}"
    first = list(every).index(labels[0])
    if len(names) > 2 and list(labels) == list(every[first : first + len(labels)]):
        return f"flights {names[0]} to {names[-1]}"
    if len(names) > 4:
        return f"{len(names)} of {len(every)} flights"
    return f"flights {', '.join(names[:-1])} and {names[-1]}"
