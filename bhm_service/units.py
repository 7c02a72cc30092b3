"""Physical constants and the conversions that happen at the edge; everything inside is SI."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]
Places: TypeAlias = NDArray[np.intp]
Value: TypeAlias = float | Array
"""A number, or an array of numbers that broadcasts: samples, flights and columns go through one call."""

GAS_CONSTANT = 8.3144621  # [J/(mol K)] the value of Daigle & Kulkarni's library
FARADAY = 96487.0  # [C/mol] likewise
ZERO_CELSIUS_K = 273.15
REFERENCE_TEMPERATURE_K = 298.15  # [K] 25 degC: where cells are identified
SECONDS_PER_HOUR = 3600.0
STANDARD_GRAVITY = 9.80665  # [m/s^2]


def kelvin(celsius: float) -> float:
    """Degrees Celsius to kelvin."""
    return celsius + ZERO_CELSIUS_K


def celsius(kelvin_: float) -> float:
    """Kelvin to degrees Celsius."""
    return kelvin_ - ZERO_CELSIUS_K


def coulombs(ampere_hours: float) -> float:
    """Ampere-hours to coulombs."""
    return ampere_hours * SECONDS_PER_HOUR


def ampere_hours(coulombs_: float) -> float:
    """Coulombs to ampere-hours."""
    return coulombs_ / SECONDS_PER_HOUR
