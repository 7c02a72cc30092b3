"""What a model or an effect says of its parameters: name, symbol, unit, range; stated once, used by everybody.

The battery file, its checks, the identification's bounds and the reports all read these declarations.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

_KEY = "parameter"


@dataclass(frozen=True, slots=True)
class Parameter:
    """Declaration of one number of a model."""

    name: str
    symbol: str  # as in NASA/TM-20230012868
    unit: str  # in files and reports; the model's own value is this times ``scale``, in SI
    low: float  # physical bounds, in ``unit``
    high: float
    meaning: str
    scale: float = 1.0


def parameter(
    symbol: str, unit: str, low: float, high: float, meaning: str, *, scale: float = 1.0, default: float | None = None
) -> Any:
    """Declare a dataclass field as a model parameter."""
    metadata = {_KEY: (symbol, unit, low, high, meaning, scale)}
    if default is None:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(metadata=metadata, default=default)


def parameters_of(model: type) -> tuple[Parameter, ...]:
    """The parameters that a dataclass declares, in order."""
    return tuple(
        Parameter(field.name, *field.metadata[_KEY]) for field in dataclasses.fields(model) if _KEY in field.metadata
    )
