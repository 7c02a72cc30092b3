"""What an effect is: a piece of physics that the base models leave out, joined to the pack through hooks.

An effect is a frozen dataclass of its parameters. It overrides only the hooks it needs; every hook's default is the
identity. Its own states are declared like the cell's, so they are solved in steps and along recordings alike.
Parameters are floats, or arrays (M, 1) that broadcast against states (T,) or (M, T): many candidates in one call.
"""

from __future__ import annotations

from types import FunctionType
from typing import ClassVar, NamedTuple

from bhm_service.battery.cell import UNMODIFIED, CellModel, Modifiers
from bhm_service.battery.dynamics import Solver
from bhm_service.battery.parameters import Parameter, parameters_of
from bhm_service.units import Value


class Conditions(NamedTuple):
    """What the scales on a cell may depend on."""

    temperature: Value  # [K] of the cells, as far as it is known
    soc: Value  # [-]
    cell_current: Value  # [A] true current through one cell; over an interval its mean
    cell: CellModel


class Instant(NamedTuple):
    """What an effect may look at: the pack at one instant, or along a recording."""

    current: Value  # [A] true pack current
    cell_current: Value  # [A] of it through one cell
    soc: Value  # [-]
    temperature: Value  # [K] of the cells, as far as it is known
    series: int  # cells in series
    parallel: Value  # cells side by side
    cell: CellModel
    by: Modifiers  # what all effects lay on the cells
    curve_lag: Value = 0.0  # [-] charge by which the open-circuit curve is read below ``soc``


class Interval(NamedTuple):
    """What moves an effect's states over each interval."""

    begin: Value  # [A] true current through one cell at the beginning of each
    end: Value  # [A] and at the end
    by: Modifiers  # what all effects lay on the cells
    soc: Value  # [-] at the beginning of each
    temperature: Value  # [K] of the cells, at the beginning of each
    losses: Value  # [W] heat that the pack makes, at the beginning of each
    cell: CellModel


class Spread(NamedTuple):
    """How uncertain a filter is of a state."""

    start: float  # standard deviation before the first sample
    drift: float  # what it gains per root second


class Physics:
    """What a piece of physics says of itself: the search for missing physics, reports and advice read this."""

    id: ClassVar[str] = ""
    title: ClassVar[str] = ""
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    excited_by: ClassVar[str] = ""  # what a recording must have to show it
    mimics: ClassVar[tuple[str, ...]] = ()  # effects that look nearly the same; always mutual
    manoeuvre: ClassVar[str] = ""  # the cheapest that tells it from them
    drivers: ClassVar[tuple[str, ...]] = ()  # what must be known beside current and voltage
    supplies: ClassVar[tuple[str, ...]] = ()  # drivers that it carries as a state where they are not measured
    shown_below: ClassVar[float] = 1.0  # charge that a flight must reach, else it looks like its mimics
    repeats: ClassVar[bool] = False  # a battery that has it already may lack more of it
    shown_by: ClassVar[tuple[str, ...]] = ()  # one of these must be joined too, else it changes nothing

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """Its numbers, in order."""
        return parameters_of(cls)

    @classmethod
    def priors(cls, pack_wh: float) -> dict[str, tuple[float, float]]:
        """Mean and standard deviation of each parameter that has any, in its unit, for a pack of so much energy."""
        return {p.name: p.prior for p in cls.parameters() if p.prior is not None}


class Effect(Physics):
    """The hooks, each the identity."""

    state_names: ClassVar[tuple[str, ...]] = ()
    # Its states act on the current, the heat or the modifiers that move them, or its modifiers depend on SoC.
    feedback: ClassVar[bool] = False
    own_hooks: ClassVar[frozenset[str]] = frozenset()  # those that are not left the identity

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        hooks = {name: own for name, own in vars(Effect).items() if isinstance(own, FunctionType)}
        cls.own_hooks = frozenset(name for name, identity in hooks.items() if getattr(cls, name) is not identity)

    def start(self) -> tuple[Value, ...]:
        """Its states before the first sample."""
        return ()

    def spread(self) -> tuple[Spread, ...]:
        """How uncertain a filter is of its states; none said: as of a voltage across the cell."""
        return ()

    def true_current(self, measured: Value) -> Value:
        """Current that flows [A] when ``measured`` is read: gain, offset, load past the sensor; a straight line."""
        return measured

    def initial_soc(self, soc: Value) -> Value:
        """State of charge at the start when ``soc`` is assumed."""
        return soc

    def cell_temperature(self, state: tuple[Value, ...]) -> Value:
        """Temperature of the cells [K] where it is not measured, if the effect carries it as a state."""
        raise NotImplementedError

    def temperature_rise(self, state: tuple[Value, ...]) -> Value:
        """What the cells are warmer inside than where temperature is known. [K]"""
        return 0.0

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        """Scales on resistance, kinetics, diffusion and capacity."""
        return UNMODIFIED

    def curve_lag(self, state: tuple[Value, ...]) -> Value:
        """By how much charge below the cells' own the open-circuit curve is read. [-]"""
        return 0.0

    def heat(self, state: tuple[Value, ...], now: Instant) -> Value:
        """Heat in the pack [W] beside the losses of the cell model itself."""
        return 0.0

    def advance(self, solver: Solver, start: tuple[Value, ...], interval: Interval) -> tuple[Value, ...]:
        """Its states at the end of each interval."""
        return ()

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        """Voltage added to the pack's [V], beside what drops in proportion to the current."""
        return 0.0

    def series_resistance(self, state: tuple[Value, ...], now: Instant) -> Value:
        """Resistance added to the pack's, whose drop follows the current at once [Ohm]."""
        return 0.0

    def odd_cell(self, state: tuple[Value, ...], now: Instant) -> Value:
        """By what the voltage of one cell of the pack is above that of the others. [V]"""
        return 0.0

    def measured_voltage(self, voltage: Value) -> Value:
        """What the sensor reads [V] when the pack has ``voltage``; a straight line."""
        return voltage
