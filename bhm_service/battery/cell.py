"""What a cell model is: its states, how they move, and the voltage at its terminals."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from bhm_service.battery.dynamics import Solver
from bhm_service.units import Value


class Modifiers(NamedTuple):
    """Scales that effects lay on a cell; both cell models honour the same, but for ``transfer``.

    ``area`` is for the pack to honour: the current of a cell is what goes through its whole area.
    """

    resistance: Value = 1.0  # times the ohmic resistance
    kinetics: Value = 1.0  # times the speed of charge transfer and of all that a model may have put with it
    diffusion: Value = 1.0  # times the speed of diffusion
    capacity: Value = 1.0  # times the charge between full and empty
    transfer: Value = 1.0  # times the speed of charge transfer alone, where it is told from the rest
    area: Value = 1.0  # times the area of its electrodes: with less, cells are as if fewer of them stood side by side

    def times(self, other: Modifiers) -> Modifiers:
        """Both scales together."""
        return Modifiers(
            self.resistance * other.resistance,
            self.kinetics * other.kinetics,
            self.diffusion * other.diffusion,
            self.capacity * other.capacity,
            self.transfer * other.transfer,
            self.area * other.area,
        )


UNMODIFIED = Modifiers()


class CellModel(Protocol):
    """One cell. Its first state is always the state of charge."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, the first of them ``soc``."""
        ...

    @property
    def capacity_c(self) -> Value:
        """Charge between SoC 1 and SoC 0. [C]"""
        ...

    def rest(self, soc: Value) -> tuple[Value, ...]:
        """States of a cell at rest at ``soc``."""
        ...

    def advance(
        self, solver: Solver, start: tuple[Value, ...], begin: Value, end: Value, by: Modifiers
    ) -> tuple[Value, ...]:
        """States at the end of each interval; the cell current [A] runs straight from begin to end."""
        ...

    def emf(self, state: tuple[Value, ...], by: Modifiers) -> Value:
        """Terminal voltage before the drop that follows the current at once. [V]"""
        ...

    def polarisation(self, state: tuple[Value, ...], by: Modifiers) -> Value:
        """What ``emf`` is below the voltage at rest. [V]"""
        ...

    def series_resistance(self, by: Modifiers) -> Value:
        """Resistance whose drop follows the current at once. [Ohm]"""
        ...

    def ohmic_resistance(self, by: Modifiers) -> Value:
        """Resistance of wires, foils and electrolyte, however fast the model lets its drop follow. [Ohm]"""
        ...

    def open_circuit(self, soc: Value) -> Value:
        """Voltage of a cell at rest at ``soc``. [V]"""
        ...
