"""All flights under one hypothesis: the model run along every flight for many candidate vectors at once."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from bhm_service.battery.effects.base import Effect
from bhm_service.battery.pack import PackModel, Simulation
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.lab import BEND_SOC, Lab, LabError, hats, lagging
from bhm_service.discrepancy.noise import Noise
from bhm_service.identification.unknowns import Block, Unknowns, joined, numbers
from bhm_service.units import Array, Flags

# Of the state of charge at the start: charged full, by a gauge, and of a pack that nobody identified.
FULL_SD, GAUGE_SD, GENERIC_SD = 0.01, 0.02, 0.08
_REST_SD_V = 0.002  # of a cell, beside what the open-circuit curve is known to
_STEP = 1e-3  # of finite differences, in standard deviations of what was known before
_STARTS = "start_soc"
_PACKS = "pack_resistance"
_PACKS_SD = 0.1  # of the logarithm: packs of one kind that nobody identified, from flight to flight

Places: TypeAlias = NDArray[np.intp]

# No equation of the catalogue is exact. What a member adds to the voltage may be off by these shares: from flight to
# flight, over the state of charge, in how it grows with the load, and in how fast it follows it. A second effect has
# to beat that.
_FORM_FLIGHT_SD, _FORM_SOC_SD, _FORM_LOAD_SD, _FORM_LAG_SD = 0.08, 0.12, 0.3, 0.2
_FORM_MEAN_SD = 0.02  # of all flights, and of all charges: what is off alike everywhere is the member's own size
_FORM_SOC = np.array([0.15, 0.4, 0.65, 0.95])
_FORM_LAG_S = (1.0, 10.0, 60.0)


@dataclass(frozen=True, slots=True)
class Predicted:
    """One flight under a hypothesis, for some vectors of which the first is the one in question."""

    voltage: Array  # [V] (M, T)
    rested: Array | None  # [V] (M, 1)
    soc: Array  # (T,) of the first vector
    members: Array  # [V] what each member adds to the voltage (members, T)
    places: Places  # which numbers of the vector only add to the voltage
    added: Array  # [V] what one of each of them adds (numbers, T)


@dataclass(frozen=True)
class Joint:
    """A hypothesis over flights: the lab's errors, each flight's start and the members' unknowns in one vector."""

    lab: Lab
    flights: tuple[FlightData, ...]
    members: tuple[Candidate, ...] = ()
    start_sd: tuple[float, ...] = field(default=())  # per flight; by what is known of its start where not given

    @cached_property
    def unknowns(self) -> Unknowns:
        """Everything that is looked for."""
        mean = np.array([1.0 if f.reading is None else f.reading for f in self.flights])
        sd = np.array(self.start_sd or [self._start_sd(f) for f in self.flights])
        starts = Block(
            name=_STARTS, start=mean, low=np.full(mean.size, 0.02), high=np.full(mean.size, 1.06), prior=mean, sd=sd
        )
        packs = [] if self.lab.identified else [_about_zero(_PACKS, len(self.flights), _PACKS_SD)]
        members = [b for c in self.members for b in c.blocks(len(self.flights))]
        forms = [b for c in self.members for b in self._form_blocks(c.id)]
        return joined(self.lab.blocks(), [starts], packs, members, self.lab.additions(), forms)

    @cached_property
    def _adding(self) -> frozenset[str]:
        """Blocks that only add to the voltage: their derivatives need no run."""
        forms = [b.name for c in self.members for b in self._form_blocks(c.id)]
        return frozenset([b.name for b in self.lab.additions()] + forms)

    def _form_blocks(self, name: str) -> list[Block]:
        return [
            _about_zero(f"form_flight.{name}", len(self.flights), _FORM_FLIGHT_SD),
            _about_zero(f"form_soc.{name}", _FORM_SOC.size, _FORM_SOC_SD),
            _about_zero(f"form_load.{name}", 1, _FORM_LOAD_SD),
            _about_zero(f"form_lag.{name}", len(_FORM_LAG_S), _FORM_LAG_SD),
        ]

    def _start_sd(self, flight: FlightData) -> float:
        if not self.lab.identified:
            return GENERIC_SD
        return FULL_SD if flight.reading is None else GAUGE_SD

    @cached_property
    def per_flight(self) -> frozenset[str]:
        """Blocks that hold one number for every flight."""
        own = {u.name for c in self.members for u in c.unknowns if u.per_flight}
        return frozenset({_STARTS, _PACKS} | own | {f"form_flight.{c.id}" for c in self.members})

    @cached_property
    def _columns(self) -> list[Places]:
        """For each flight, the numbers of the vector that a run of it depends on."""
        return [
            np.concatenate([self._of(b, k) for b in self.unknowns.blocks if b.name not in self._adding])
            for k in range(len(self.flights))
        ]

    @cached_property
    def _additions(self) -> list[Places]:
        """For each flight, the numbers of the vector that only add to its voltage, in the order of their shapes."""
        blocks = [*self.lab.additions(), *(b for c in self.members for b in self._form_blocks(c.id))]
        return [np.concatenate([self._of(b, k) for b in blocks]) for k in range(len(self.flights))]

    def _of(self, block: Block, flight: int) -> Places:
        return self._of_name(block.name, flight)

    def _of_name(self, name: str, flight: int) -> Places:
        where = np.arange(self.places[name].start, self.places[name].stop)
        return where[flight : flight + 1] if name in self.per_flight else where

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where each block stands in the vector."""
        return {b.name: self.unknowns.slice_of(b.name) for b in self.unknowns.blocks}

    @cached_property
    def _followed(self) -> list[Array]:
        return [self.lab.followed(f.time_s, f.current_a) for f in self.flights]

    @cached_property
    def scale(self) -> Array:
        """Standard deviation of what was known before, of every number."""
        return np.concatenate([b.sd for b in self.unknowns.blocks])

    def values(self, x: Array) -> dict[str, Array]:
        """Blocks of vectors (M, n) by name, each (M, size), in their own units."""
        return {b.name: b.outer(x[:, self.places[b.name]]) for b in self.unknowns.blocks}

    def effects(self, x: Array, flight: int) -> list[Effect]:
        """All effects of one flight for vectors (M, n)."""
        values = self.values(x)
        return [
            *self.lab.effects,
            LabError(values, values[_PACKS][:, flight : flight + 1] if _PACKS in values else 0.0),
            *(e for c in self.members for e in c.effects(values, flight)),
        ]

    def pack(self, x: Array, flight: int) -> PackModel:
        """The pack of one flight for vectors (M, n)."""
        return PackModel(self.lab.cell, self.lab.series, self.lab.parallel, self.effects(x, flight))

    def simulated(self, x: Array, flight: int, pack: PackModel | None = None) -> Simulation:
        """One flight for vectors (M, n)."""
        data = self.flights[flight]
        start = x[:, self.places[_STARTS]][:, flight : flight + 1]
        return (pack or self.pack(x, flight)).simulate(data.time_s, data.current_a, start, data.temperature_k)

    def without(self, x: Array) -> Array:
        """For each member, a vector with its effect taken away; (members, n)."""
        bare = np.tile(x, (len(self.members), 1))
        for row, member in zip(bare, self.members, strict=True):
            for u in member.amplitudes():
                assert u.declared.absent is not None
                row[self.places[u.name]] = np.log(u.declared.absent) if u.log else u.declared.absent
        return bare

    @cached_property
    def misfits(self) -> list[Array]:
        """What every flight's voltage is off by [V] under what was known before; nan where none was read."""
        bare = self.unknowns.start[None, :]
        return [f.voltage_v - self.predicted(bare, k).voltage[0] for k, f in enumerate(self.flights)]

    def predicted(self, points: Array, flight: int, forms: bool = True) -> Predicted:
        """One flight's voltages for vectors (M, n), and the voltage rested after it where the sidecar has one.

        What only adds is taken along the first vector's charge: the others differ from it by steps of differences.
        Without ``forms`` the members are taken by their equations alone.
        """
        data = self.flights[flight]
        everything = np.vstack([points, self.without(points[0])])
        pack = self.pack(everything, flight)
        run = self.simulated(everything, flight, pack)
        wide = np.broadcast_to(run.voltage, (everything.shape[0], data.time_s.size))
        soc = np.broadcast_to(run.soc, wide.shape)[0]
        members = wide[0] - wide[points.shape[0] :]
        lab = self.lab.added(self._followed[flight], data.current_a, soc)
        rows = [lab, *(np.swapaxes(_form_shapes(members, data, soc), 0, 1) if self.members else ())]
        added, places = np.concatenate(rows), self._additions[flight]
        count = places.size if forms else rows[0].shape[0]
        voltage = wide[: points.shape[0]] + points[:, places[:count]] @ added[:count]
        if forms:
            self._follow(voltage, points, wide, flight, soc)
        rested = None
        if data.notes.rest_voltage_v is not None:
            bends = points[:, places[: BEND_SOC.size]] @ added[: BEND_SOC.size, -1:]
            rested = self._rested(pack, flight, run)[: points.shape[0]] + bends
        return Predicted(voltage, rested, soc, members, places, added)

    def _follow(self, voltage: Array, points: Array, wide: Array, flight: int, soc: Array) -> None:
        """Let what a member's form adds follow the member: without it the slopes along its numbers are not true."""
        for member in self.members:
            own = np.concatenate([self._of_name(u.name, flight) for u in member.unknowns])
            form = np.concatenate([self._of(b, flight) for b in self._form_blocks(member.id)])
            moved = np.flatnonzero((points[:, own] != points[0, own]).any(axis=1))
            if moved.size and points[0, form].any():
                shapes = _form_shapes(wide[moved] - wide[0], self.flights[flight], soc)
                voltage[moved] += np.tensordot(points[0, form], shapes, 1)

    def _rested(self, flown: PackModel, flight: int, run: Simulation) -> Array:
        """After landing the pack is unplugged: nothing flows, and another meter reads it."""
        data = self.flights[flight]
        kept = [
            e
            for e in flown.effects
            if type(e).true_current is Effect.true_current and type(e).measured_voltage is Effect.measured_voltage
        ]
        pack = PackModel(self.lab.cell, self.lab.series, self.lab.parallel, kept)
        names = dict(zip(flown.state_names, run.states, strict=True))
        last = [np.broadcast_to(names[n], np.broadcast_shapes(names[n].shape, run.voltage.shape))[..., -1]
                for n in pack.state_names]  # fmt: skip
        kelvin = None if data.temperature_k is None else float(data.temperature_k[-1])
        rested = pack.step(np.stack(last, axis=-1)[:, None, :], data.notes.rest_s, 0.0, 0.0, kelvin)
        return np.asarray(pack.voltage(rested, 0.0, kelvin))

    def whitened(self, series: Array, flight: int, noise: Noise) -> Array:
        """What is in a flight's voltages (.., T), in standard deviations of noise and of what a sample cannot tell."""
        beside = noise.sudden * self.sudden[flight] / noise.sigma_v
        return noise.whitened(series) / np.sqrt(1.0 + beside**2)

    @cached_property
    def sudden(self) -> list[Array]:
        """For each flight, the ohmic drop [V] of changes of current that are as fast as the samples."""
        ohm = self.lab.ohm * self.lab.ohmic_share * self.lab.series / self.lab.parallel
        found = []
        for f in self.flights:
            change = np.abs(np.diff(f.current_a, prepend=f.current_a[0]))
            found.append(ohm * np.maximum(change, np.concatenate([[0.0], change[:-1]])))
        return found

    def _whitened(self, modelled: Predicted, flight: int, noise: Noise) -> Array:
        data = self.flights[flight]
        misfit = data.voltage_v - modelled.voltage
        known = np.isfinite(data.voltage_v)
        if not known.all():
            at = np.arange(known.size)
            misfit = np.array([np.interp(at, at[known], row[known]) for row in misfit])
        white = self.whitened(misfit, flight, noise)
        if not known.all():
            white[:, ~known] = 0.0
        if modelled.rested is None:
            return white
        assert data.notes.rest_voltage_v is not None
        return np.concatenate([white, (data.notes.rest_voltage_v - modelled.rested) / self._rest_sd_v], axis=1)

    @property
    def _rest_sd_v(self) -> float:
        return self.lab.series * _REST_SD_V

    def residuals(self, x: Array, noise: Noise) -> list[Array]:
        """Whitened residuals of every flight, and of the voltage rested after it."""
        return [self._whitened(self.predicted(x[None, :], k), k, noise)[0] for k in range(len(self.flights))]

    def linearised(self, x: Array, noise: Noise, only: Flags | None = None) -> tuple[list[Array], list[Array]]:
        """Whitened residuals of every flight, and their derivatives (rows, n) by the vector in standard deviations.

        ``only`` those numbers (n,) that it marks are looked at; the others' derivatives are left at nothing.
        """
        rows, slopes = [], []
        for k, every in enumerate(self._columns):
            used = every if only is None else every[only[every]]
            points = np.tile(x, (used.size + 1, 1))
            steps = self._steps(x)[used]
            points[np.arange(1, used.size + 1), used] += steps
            modelled = self.predicted(points, k)
            found = self._whitened(modelled, k, noise)
            slope = np.zeros((found.shape[1], x.size))
            slope[:, used] = ((found[1:] - found[0]) / (steps / self.scale[used])[:, None]).T
            places, added = modelled.places, modelled.added
            slope[: added.shape[1], places] = -self.whitened(added, k, noise).T * self.scale[places]
            if found.shape[1] > added.shape[1]:
                bends = places[: BEND_SOC.size]
                slope[-1, bends] = -added[: BEND_SOC.size, -1] * self.scale[bends] / self._rest_sd_v
            unseen = ~np.isfinite(self.flights[k].voltage_v)
            slope[: unseen.size][unseen] = 0.0
            rows.append(found[0])
            slopes.append(slope)
        return rows, slopes

    def _steps(self, x: Array) -> Array:
        """Steps of the differences, turned round at an upper bound."""
        step = _STEP * self.scale
        return np.where(x + step > self.unknowns.high, -step, step)

    def pulls(self, x: Array) -> Array:
        """How far a vector is from what was known before, number by number and of their sums."""
        single = self.unknowns.pulls(x)[0]
        return np.concatenate([single, self.ties @ single])

    @cached_property
    def of_lab(self) -> Flags:
        """Which numbers of the vector are errors of the lab."""
        return np.concatenate([np.full(b.size, b.name.startswith("lab_")) for b in self.unknowns.blocks])

    @cached_property
    def ties(self) -> Array:
        """What is known of sums of numbers: the lab's, and that a form changes no member's size as a whole."""
        rows = [self.lab.ties(self.unknowns)]
        for member in self.members:
            for name in (f"form_flight.{member.id}", f"form_soc.{member.id}"):
                row = np.zeros((1, self.scale.size))
                sds = self.scale[self.places[name]]
                row[0, self.places[name]] = sds / (_FORM_MEAN_SD * sds.size)
                rows.append(row)
        return np.concatenate(rows)

    @cached_property
    def known(self) -> Array:
        """Curvature of what was known before, by the vector in its standard deviations."""
        return np.asarray(np.eye(self.scale.size) + self.ties.T @ self.ties)


def _form_shapes(added: Array, data: FlightData, soc: Array) -> Array:
    """By which shapes what members add to the voltage (M, T) may be off (.., M, T), in the order of the form blocks."""
    usual = float(np.mean(np.abs(data.current_a))) + 1e-9
    light = added * np.clip(1.0 - np.abs(data.current_a) / usual, -1.0, 1.0)
    late = [lagging(data.time_s, added, tau) - added for tau in _FORM_LAG_S]
    return np.stack([added, *(added * hat for hat in hats(_FORM_SOC, soc)), light, *late])


def _about_zero(name: str, size: int, sd: float) -> Block:
    return numbers(name, np.zeros(size), sd, 5.0 * sd)
