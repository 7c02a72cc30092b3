"""What a model or an effect says of its parameters: name, symbol, unit, range; stated once, used by everybody.

The battery file, its checks, the identification's bounds, the search for missing physics and the reports all read
these declarations.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

_KEY = "parameter"


@dataclass(frozen=True, slots=True)
class Parameter:
    """Declaration of one number of a model; what follows ``scale`` is said by effects only."""

    name: str
    symbol: str  # as in NASA/TM-20230012868
    unit: str  # in files and reports; the model's own value is this times ``scale``, in SI
    low: float  # physical bounds, in ``unit``
    high: float
    meaning: str
    scale: float = 1.0
    absent: float | None = None  # value at which the effect vanishes, in ``unit``; None: only gives it its shape
    prior: tuple[float, float] | None = None  # mean and standard deviation of a plausible value, in ``unit``
    per_flight: bool = False  # another value in every flight
    driver: str | None = None  # what is known of a flight that gives this number: never fitted
    model: Literal["circ", "chem"] | None = None  # of this model only; with the other it stays at its default
    source: str = ""  # of prior and bounds
    beside: str | None = None  # the driver without which it means nothing: fitted only where that is known
    unless: str | None = None  # the effect that says the same where the battery has it: there it stays at its default
    apart: float | None = None  # of a value of every flight: what these differ by, its prior being that of them all

    def si(self, value: float) -> float:
        """A value in ``unit`` as the model holds it."""
        return value * self.scale


def parameter(
    symbol: str,
    unit: str,
    low: float,
    high: float,
    meaning: str,
    *,
    scale: float = 1.0,
    default: float | None = None,
    absent: float | None = None,
    prior: tuple[float, float] | None = None,
    per_flight: bool = False,
    driver: str | None = None,
    model: Literal["circ", "chem"] | None = None,
    source: str = "",
    beside: str | None = None,
    unless: str | None = None,
    apart: float | None = None,
) -> Any:
    """Declare a dataclass field as a model parameter; ``default`` is in SI, all else in ``unit``."""
    metadata = {
        _KEY: (
            symbol, unit, low, high, meaning, scale, absent, prior, per_flight, driver, model, source, beside, unless,
            apart,
        ),
    }  # fmt: skip
    if default is None:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(metadata=metadata, default=default)


def parameters_of(model: type) -> tuple[Parameter, ...]:
    """The parameters that a dataclass declares, in order."""
    return tuple(
        Parameter(field.name, *field.metadata[_KEY]) for field in dataclasses.fields(model) if _KEY in field.metadata
    )
