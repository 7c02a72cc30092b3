"""What an effect is: a piece of physics that the base models leave out, joined to the pack through hooks.

An effect is a frozen dataclass of its parameters. It overrides only the hooks it needs; every hook's default is the
identity. Its own states are declared like the cell's, so they are solved in steps and along recordings alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bhm_service.battery.cell import UNMODIFIED, Modifiers
from bhm_service.battery.dynamics import Solver
from bhm_service.units import Value


@dataclass(frozen=True, slots=True)
class Instant:
    """What an effect may look at: the pack at one instant, or along a recording."""

    current: Value  # [A] true pack current
    cell_current: Value  # [A] of it through one cell
    soc: Value  # [-]
    temperature: Value  # [K] of the cells, as far as it is known
    series: int  # cells in series


@dataclass(frozen=True, slots=True)
class Interval:
    """What moves an effect's states over each interval."""

    begin: Value  # [A] true current through one cell at the beginning of each
    end: Value  # [A] and at the end
    by: Modifiers  # what all effects lay on the cells
    soc: Value  # [-] at the beginning of each
    temperature: Value  # [K] of the cells, at the beginning of each
    losses: Value  # [W] heat that the pack makes, at the beginning of each


class Effect:
    """The hooks, each the identity."""

    id: ClassVar[str] = ""
    title: ClassVar[str] = ""
    equation: ClassVar[str] = ""
    state_names: ClassVar[tuple[str, ...]] = ()
    feedback: ClassVar[bool] = False  # its states act on the current, the heat or the modifiers that move them

    def start(self) -> tuple[Value, ...]:
        """Its states before the first sample."""
        return ()

    def true_current(self, measured: Value) -> Value:
        """Current that flows [A] when ``measured`` is read: sensor gain, offset, load past the sensor."""
        return measured

    def initial_soc(self, soc: Value) -> Value:
        """State of charge at the start when ``soc`` is assumed."""
        return soc

    def cell_temperature(self, state: tuple[Value, ...], known: Value) -> Value:
        """Temperature of the cells [K], where the effect carries it as a state."""
        return known

    def modifiers(self, state: tuple[Value, ...], temperature: Value) -> Modifiers:
        """Scales on resistance, kinetics, diffusion and capacity."""
        return UNMODIFIED

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        """Its states at the end of each interval."""
        return ()

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        """Voltage added to the pack's [V]."""
        return 0.0

    def measured_voltage(self, voltage: Value) -> Value:
        """What the sensor reads [V] when the pack has ``voltage``."""
        return voltage
