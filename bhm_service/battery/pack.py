"""The pack: cells in series, scaled to the pack's capacity, with the effects that the cell model leaves out.

Everybody uses this one class: the filter steps its sigma points with it, the predictor its samples, the
identification and the search for missing physics run whole recordings through it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.cell import UNMODIFIED, CellModel, Modifiers
from bhm_service.battery.dynamics import Course, Solver, Step
from bhm_service.battery.effects.base import Conditions, Effect, Instant, Interval, Spread
from bhm_service.battery.feedback import Apart, Feedback, States, Swept
from bhm_service.units import REFERENCE_TEMPERATURE_K, Array, Flags, Value

_COLDEST_K, _HOTTEST_K = 220.0, 400.0  # a temperature that is a state is held where the equations mean something


@dataclass(frozen=True, slots=True)
class Simulation:
    """A pack run along a recording: one value per sample, the time axis last."""

    voltage: Array  # [V] as the sensor would read it
    soc: Array  # [-]
    temperature: Value  # [K] of the cells: measured, or what an effect makes of it
    swept: Swept

    @property
    def states(self) -> tuple[Array, ...]:
        """In the order of `PackModel.state_names`."""
        return self.swept.states


class PackModel:
    """``series`` cells of a model, ``parallel`` of them side by side (a capacity ratio, so not only whole numbers)."""

    def __init__(self, cell: CellModel, series: int, parallel: Value = 1.0, effects: Iterable[Effect] = ()) -> None:
        self.cell = cell
        self.series = series
        self.parallel = parallel
        self.effects = tuple(effects)
        own = [name for effect in self.effects for name in effect.state_names]
        self.state_names: tuple[str, ...] = (*cell.state_names, *own)
        self.n_states = len(self.state_names)
        self._n_cell = len(cell.state_names)
        self._slices: list[tuple[Effect, slice]] = []
        column = self._n_cell
        for effect in self.effects:
            self._slices.append((effect, slice(column, column + len(effect.state_names))))
            column += len(effect.state_names)
        # Only the hooks that are overridden are called: a bare pack pays nothing for the rest.
        self._current = self._with("true_current")
        self._soc0 = self._with("initial_soc")
        self._carrying = self._with("cell_temperature")
        self._rising = self._with("temperature_rise")
        self._modifying = self._with("modifiers")
        self._lagging = self._with("curve_lag")
        self._heating = self._with("heat")
        moving = self._with("advance")
        self._fed = [(effect, where) for effect, where in moving if effect.feedback]  # by heat, which they act on
        self._calm = [(effect, where) for effect, where in moving if not effect.feedback]
        self._adding = self._with("extra_voltage")
        self._resisting = self._with("series_resistance")
        self._sensing = self._with("measured_voltage")
        self._uneven = self._with("odd_cell")
        self.has_feedback = any(effect.feedback for effect in self.effects)
        self._fed_states, self._calm_states = _places(self._fed), _places(self._calm)

    def _with(self, hook: str) -> list[tuple[Effect, slice]]:
        return [(e, where) for e, where in self._slices if hook in e.own_hooks]

    @property
    def capacity_c(self) -> Value:
        """Charge between SoC 1 and SoC 0, effects aside. [C]"""
        return self.cell.capacity_c * self.parallel

    # ---- states -------------------------------------------------------------------------------------------------

    def rest(self, soc: Value) -> States:
        """States of a pack that has rested at ``soc``."""
        own: list[Value] = [value + 0.0 * soc for effect in self.effects for value in effect.start()]
        return (*self.cell.rest(soc), *own)

    def start(self, soc: Value) -> States:
        """States of a rested pack of which ``soc`` is assumed: the effects may know better."""
        for effect, _ in self._soc0:
            soc = effect.initial_soc(soc)
        return self.rest(soc)

    def spreads(self) -> list[tuple[int, Spread]]:
        """What effects say of how uncertain a filter is of their states, with the states' columns."""
        return [(where.start + k, said) for effect, where in self._slices for k, said in enumerate(effect.spread())]

    def open_circuit(self, soc: Value) -> Value:
        """Voltage of the rested pack at ``soc``, effects aside. [V]"""
        return self.series * self.cell.open_circuit(soc)

    def _known(self, states: States, temperature: Value | None) -> Value:
        """Temperature of the cells: measured, or a state of an effect, or that of their identification. [K]"""
        if temperature is None:
            for effect, where in self._carrying:
                temperature = effect.cell_temperature(states[where])
        known: Value = REFERENCE_TEMPERATURE_K if temperature is None else temperature
        for effect, where in self._rising:
            known = known + effect.temperature_rise(states[where])
        return np.minimum(np.maximum(known, _COLDEST_K), _HOTTEST_K) if self._carrying or self._rising else known

    @property
    def carries_temperature(self) -> bool:
        """Whether an effect has the pack's temperature as a state."""
        return bool(self._carrying)

    def carried_temperature(self, states: Array) -> Array:
        """That temperature, where a sensor would sit [K]; ``states`` (..., n_states)."""
        effect, where = self._carrying[-1]
        return np.asarray(effect.cell_temperature(_columns(states)[where]))

    def modifiers(self, states: States, temperature: Value | None, current: Value = 0.0) -> Modifiers:
        """What the effects together lay on the cells under a true pack current [A]."""
        return self._modifiers(states, self._known(states, temperature), current / self.parallel)

    def _modifiers(self, states: States, known: Value, cell_current: Value) -> Modifiers:
        total = UNMODIFIED
        if self._modifying:
            at = Conditions(known, states[0], cell_current, self.cell)
            for effect, where in self._modifying:
                own = effect.modifiers(states[where], at)
                total = own if total is UNMODIFIED else total.times(own)
        return total

    # ---- moving -------------------------------------------------------------------------------------------------

    def step(
        self, states: Array, dt: Value, begin: Value, end: Value | None = None, temperature: Value | None = None
    ) -> Array:
        """Move states over ``dt`` seconds.

        Parameters
        ----------
        states : array (..., n_states)   sigma points or samples.
        dt : float or array (...,)       length of the interval, not negative. [s]
        begin, end : float or array      measured pack current at both ends; ``end`` left out: held. [A]
        temperature : float              of the pack, None where it is not known. [K]

        Returns
        -------
        array (..., n_states)
        """
        columns = _columns(states)
        moved = self._advance(Step(dt), columns, columns, begin, begin if end is None else end, temperature)
        result = np.empty_like(states)
        for k, column in enumerate(moved):
            result[..., k] = column
        return result

    def _advance(
        self,
        solver: Solver,
        start: States,
        before: States,
        begin: Value,
        end: Value,
        temperature: Value | None,
        apart: Apart | None = None,
    ) -> States:
        """``start``: states before the first interval; ``before``: at the beginning of each (for one step the same)."""
        for effect, _ in self._current:
            begin, end = effect.true_current(begin), effect.true_current(end)
        n = self._n_cell
        begin, end = begin / self.parallel, end / self.parallel
        known = self._known(before, temperature)
        by = self._modifiers(before, known, 0.5 * (begin + end)) if self._modifying else UNMODIFIED
        if by.area is not UNMODIFIED.area:  # hardly any pack: the others are spared the divisions
            begin, end = begin / by.area, end / by.area
        cell = self.cell.advance(solver, start[:n], begin, end, by)
        if len(start) == n:
            return cell
        ends = [*cell, *start[n:]]
        interval = Interval(begin, end, by, solver.begin(start[0], cell[0]), known, 0.0, self.cell)
        for effect, where in self._calm:
            ends[where] = effect.advance(solver, start[where], interval)
        if self._fed:
            # Heat is taken from where the others now are, not from where they were a sweep ago.
            now = list(before)
            for k in (*range(n), *self._calm_states):
                now[k] = solver.begin(start[k], ends[k])
            interval = interval._replace(losses=self._losses(tuple(now), begin, known, by))
        for effect, where in self._fed:
            if apart is None:
                ends[where] = effect.advance(solver, start[where], interval)
            else:
                ends[where] = apart.advance(effect, before[where], interval)
        return tuple(ends)

    def _losses(self, states: States, cell_current: Value, known: Value, by: Modifiers) -> Value:
        cell = states[: self._n_cell]
        instant = cell_current * self.cell.series_resistance(by)
        drop = self.cell.polarisation(cell, by) + instant
        losses = self.series * self._abreast(by) * cell_current * drop
        if self._heating or self._lagging:
            now = self._instant(states, cell_current, known, by)
            if self._lagging:
                losses = losses - now.current * self._by_lag(now)
            for effect, where in self._heating:
                losses = losses + effect.heat(states[where], now)
        return losses

    def _instant(self, states: States, cell_current: Value, known: Value, by: Modifiers) -> Instant:
        """``cell_current`` is what one of the cells carries that stand side by side (`_abreast`)."""
        abreast = self._abreast(by)
        drawn = cell_current * abreast
        lag: Value = 0.0
        for effect, where in self._lagging:
            lag = lag + effect.curve_lag(states[where])
        return Instant(drawn, cell_current, states[0], known, self.series, abreast, self.cell, by, lag)

    def _by_lag(self, now: Instant) -> Value:
        """What is added to the pack's voltage as its curve is read at the surface's charge. [V]"""
        added: Value = self.series * (self.cell.open_circuit(now.soc - now.curve_lag) - self.cell.open_circuit(now.soc))
        return added

    def _abreast(self, by: Modifiers) -> Value:
        """Cells side by side; what has lost area counts as fewer, each of them whole."""
        return self.parallel if by.area is UNMODIFIED.area else self.parallel * by.area

    # ---- voltage ------------------------------------------------------------------------------------------------

    def voltage(self, states: Array, current: Value, temperature: Value | None = None) -> Array:
        """Voltage that the sensor reads [V]; ``states`` (..., n_states), ``current`` as measured [A]."""
        return np.asarray(self._voltage(_columns(states), current, temperature))

    def _voltage(self, states: States, current: Value, temperature: Value | None) -> Value:
        current = self.true_current(current)
        emf, resistance = self._source(states, current, temperature)
        total = emf - resistance * current
        for effect, _ in self._sensing:
            total = effect.measured_voltage(total)
        return total

    def below_average(self, states: Array, current: Value, temperature: Value | None = None) -> Value:
        """By what the pack would read less if all its cells were like the lowest [V]; arguments as for `voltage`."""
        if not self._uneven:
            return 0.0
        columns = _columns(states)
        drawn = self.true_current(current)
        known = self._known(columns, temperature)
        by = self._modifiers(columns, known, drawn / self.parallel)
        now = self._instant(columns, drawn / self._abreast(by), known, by)
        below: Value = 0.0
        for effect, where in self._uneven:
            odd = effect.odd_cell(columns[where], now)
            # All like the one that is low, or like the others of one that is high.
            others = self.series - 1
            below = below + others * np.maximum(-odd, odd / max(others, 1))
        return below

    def true_current(self, current: Value) -> Value:
        """Current that flows when ``current`` is read. [A]"""
        for effect, _ in self._current:
            current = effect.true_current(current)
        return current

    def _source(self, states: States, current: Value, temperature: Value | None) -> tuple[Value, Value]:
        """The pack as a source: voltage ahead of the drop that follows the current at once, and that resistance."""
        known = self._known(states, temperature)
        by = self._modifiers(states, known, current / self.parallel) if self._modifying else UNMODIFIED
        cell = states[: self._n_cell]
        emf = self.series * self.cell.emf(cell, by)
        abreast = self._abreast(by)
        resistance = self.series * self.cell.series_resistance(by) / abreast
        if self._adding or self._resisting or self._lagging:
            now = self._instant(states, current / abreast, known, by)
            if self._lagging:
                emf = emf + self._by_lag(now)
            for effect, where in self._adding:
                emf = emf + effect.extra_voltage(states[where], now)
            for effect, where in self._resisting:
                resistance = resistance + effect.series_resistance(states[where], now)
        return emf, resistance

    def current_at_power(
        self, states: Array, power: Value, guess: Value, temperature: Value | None = None
    ) -> tuple[Array, Flags]:
        """Current that draws ``power`` [W], both as the sensors read them, and whether the pack can deliver it.

        With E the voltage ahead of the instant drop, V = (E + sqrt(E^2 - 4 R P)) / 2; a negative discriminant is a
        power that cannot be delivered, and the current returned is then that of the largest power, E / 2R.
        ``guess`` [A] only serves effects whose voltage or modifiers bend with the current.
        """
        columns = _columns(states)
        emf, resistance = self._source(columns, self.true_current(guess), temperature)
        if self._current:  # sensors read straight lines: E and R stay a straight line's
            idle = self.true_current(0.0)
            emf, resistance = emf - resistance * idle, resistance * (self.true_current(1.0) - idle)
        for effect, _ in self._sensing:
            offset = effect.measured_voltage(0.0)
            gain = effect.measured_voltage(1.0) - offset
            emf, resistance = gain * emf + offset, gain * resistance
        discriminant = emf * emf - 4.0 * resistance * power
        deliverable = (discriminant >= 0.0) & (emf > 0.0)
        volts = 0.5 * (emf + np.sqrt(np.maximum(discriminant, 0.0)))
        return np.asarray(power / np.maximum(volts, 0.1 * self.series)), np.asarray(deliverable)

    # ---- whole recordings ---------------------------------------------------------------------------------------

    def simulate(
        self,
        time_s: Array,
        current_a: Array,
        soc: Value,
        temperature_k: Array | None = None,
        near: Swept | None = None,
    ) -> Simulation:
        """Run along a recording, open loop, from rest.

        Parameters
        ----------
        time_s : array (..., T)      not falling. [s]
        current_a : array (..., T)   measured pack current, straight between samples. [A]
        soc : float or array (..., 1)   state of charge assumed at the first sample.
        temperature_k : array (..., T) or None   of the pack. [K]
        near : Swept (..., T)        of runs that these differ from by steps of differences: where feedback starts.

        Parameters of the cell and of the effects may carry leading axes as well, then with a last axis of one.
        """
        start = self.start(soc)
        dt, begin, end = np.diff(time_s), current_a[..., :-1], current_a[..., 1:]
        temperature = None if temperature_k is None else temperature_k[..., 1:]
        ends: States
        following: tuple[Array, ...] = ()
        if self.has_feedback:
            feedback = Feedback(self._advance, self._n_cell, self._fed_states, -1.0 / self.capacity_c)
            ends, following = feedback.swept(dt, start, begin, end, temperature, near)
        else:
            ends = self._advance(Course(dt), start, start, begin, end, temperature)
        states = tuple(_from_start(s, e, time_s.shape[-1]) for s, e in zip(start, ends, strict=True))
        voltage = np.asarray(self._voltage(states, current_a, temperature_k))
        known = self._known(states, temperature_k)
        return Simulation(voltage=voltage, soc=states[0], temperature=known, swept=Swept(states, following))


def _places(effects: Iterable[tuple[Effect, slice]]) -> list[int]:
    """Columns of the states that effects have."""
    return [k for _, where in effects for k in range(where.start, where.stop)]


def _columns(states: Array) -> States:
    """The last axis taken apart; ``T`` is quicker than ``moveaxis`` and the same for what is stepped."""
    return tuple(states.T) if states.ndim <= 2 else tuple(np.moveaxis(states, -1, 0))


def _from_start(start: Value, ends: Value, length: int) -> Array:
    """The start and the ends of all intervals in one array (..., T)."""
    shape = np.broadcast_shapes(np.shape(ends)[:-1], np.shape(start)[:-1])
    joined = np.empty((*shape, length))
    joined[..., :1] = start
    joined[..., 1:] = ends
    return joined
