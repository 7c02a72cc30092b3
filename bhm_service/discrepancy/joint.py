"""All flights under one hypothesis: the model run along every flight for many candidate vectors at once."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property
from math import prod

import numpy as np

from bhm_service.battery.effects.base import Effect
from bhm_service.battery.effects.slow_diffusion import SlowDiffusion
from bhm_service.battery.effects.time_skew import TimeSkew
from bhm_service.battery.feedback import Swept
from bhm_service.battery.pack import PackModel, Simulation
from bhm_service.discrepancy import forms as form
from bhm_service.discrepancy.abreast import Abreast, abreast
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.hypothesis import PACKS, STARTS, Hypothesis
from bhm_service.discrepancy.lab import BEND_SOC, LabError
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.slopes import Slopes
from bhm_service.units import Array, Places, Value

_REST_SD_V = 0.002  # of a cell, beside what the open-circuit curve is known to
_STEP = 1e-3  # of finite differences, in standard deviations of what was known before
_HALF = 0.5  # of charge: what a pack can be asked at for all of it
_AT_ONCE = 16  # vectors far from each other that are run side by side: more take more memory, and no less time
_NEAR_STEP = 1e-6  # of finite differences over the charge, and over what the drop has grown to


@dataclass(frozen=True, slots=True)
class Predicted:
    """One flight under a hypothesis, for some vectors of which the first is the one in question."""

    voltage: Array  # [V] (M, T)
    rested: Array | None  # [V] (M, 1)
    soc: Array  # (T,) of the first vector
    members: Array  # [V] what each member adds to the voltage (members, T)


@dataclass(frozen=True, slots=True)
class _Run:
    """The same of F flights side by side."""

    voltage: Array  # (M, F, T)
    rested: Array | None  # (M, F), of all where any has it
    soc: Array  # (F, T)
    members: Array  # (members, F, T)
    grown: Array | None  # times what the drop is in the lab, at once and later (2, F, T); None where it is that

    def of(self, row: int, data: FlightData) -> Predicted:
        """One of the flights."""
        size = data.time_s.size
        rested = None if self.rested is None or data.notes.rest_voltage_v is None else self.rested[:, row : row + 1]
        return Predicted(self.voltage[:, row, :size], rested, self.soc[row, :size], self.members[:, row, :size])


@dataclass(frozen=True)
class Joint(Hypothesis):
    """A hypothesis run along all its flights."""

    # By flights, the vectors that were run along them last where states act on what moves them, and their states: a
    # fit asks for a vector's residuals, and when it has taken it for their slopes.
    _last: dict[bytes, tuple[bytes, Swept]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def _pack(self, x: Array, flights: Places) -> PackModel:
        """The pack of some flights for vectors (M, n); its numbers are (M, flights, 1)."""
        values = self.values(x)
        packs = values[PACKS][:, flights, None] if PACKS in values else 0.0
        lab = {b.name: values[b.name][:, :, None] for b in self.lab.blocks()}
        members = [e for c in self.members for e in c.effects(values, flights)]
        effects = [*self.lab.effects, LabError(lab, packs), *members]
        # A skew is of the current that the pack is run with: see `_skew_s`.
        effects = [e for e in effects if not isinstance(e, TimeSkew)]
        return PackModel(self.lab.cell, self.lab.series, self.lab.parallel, effects)

    def _skew_s(self, x: Array) -> Array:
        """How much later the voltage is read than the current, for vectors (M, n); (M,).

        A recording tells what flowed before and after each sample, so the whole pack is run with the current of the
        instant at which the voltage was read. What an effect's own states can do, step by step, is a relaxation of the
        ohmic drop: nothing tells that from what a cell relaxes within a second.
        """
        told = [x[:, self.places[u.name]][:, 0] for c in self.members for u in c.unknowns if u.effect == TimeSkew.id]
        known = sum(float(np.ravel(e.skew)[0]) for e in self.lab.effects if isinstance(e, TimeSkew))
        return np.asarray(sum(told, start=np.full(x.shape[0], known)))

    def _simulated(self, x: Array, group: Abreast, pack: PackModel, leading: Places | None = None) -> Simulation:
        """The pack of vectors (M, n) along flights; ``leading`` are the ones that each hardly differs from."""
        near = None
        if pack.has_feedback and leading is not None:
            first, of = np.unique(leading, return_inverse=True)
            if first.size < leading.size:
                led, among = self._led(x[first], group), (first.size, len(group.places))
                near = Swept(
                    *(
                        tuple(np.broadcast_to(one, (*among, np.shape(one)[-1]))[of] for one in own)
                        for own in (led.states, led.following)
                    )
                )
        start = x[:, self.places[STARTS]][:, group.places, None]
        skew_s = self._skew_s(x)
        current_a = group.current_at(skew_s) if skew_s.any() else group.current_a
        run = pack.simulate(group.time_s, current_a, start, group.temperature_k, near)
        if pack.has_feedback and near is None:
            self._last[group.places.tobytes()] = x.tobytes(), run.swept
        return run

    def _led(self, x: Array, group: Abreast) -> Swept:
        """States of vectors (M, n) along flights, from which others are swept."""
        known, swept = self._last.get(group.places.tobytes(), (b"", None))
        return swept if swept and known == x.tobytes() else self._simulated(x, group, self._pack(x, group.places)).swept

    def temperature(self, x: Array, flight: int) -> Array:
        """Temperature of the pack [K] along one flight for vectors (M, n): measured, or as the members have it."""
        group = self._single(flight)
        kelvin = self._simulated(x, group, self._pack(x, group.places)).temperature
        return np.broadcast_to(kelvin, (x.shape[0], 1, self.flights[flight].time_s.size))[:, 0]

    def counted_c(self, points: Array, flight: int) -> Array:
        """Charge [C] that the sensor counts from full to empty at one flight's mean load, for vectors (M, n); (M,)."""
        data = self.flights[flight]
        told = float(np.mean(data.flown_a))
        kelvin = None if data.temperature_k is None else float(np.mean(data.temperature_k))
        pack = self._pack(points, np.array([flight]))
        drawn = pack.true_current(told)
        by = pack.modifiers(pack.start(np.full((points.shape[0], 1, 1), _HALF)), kelvin, drawn)
        counted = pack.capacity_c * by.capacity * by.area * told / drawn
        return np.asarray(np.broadcast_to(counted, (points.shape[0], 1, 1)))[:, 0, 0]

    def _single(self, flight: int) -> Abreast:
        return Abreast(np.array([flight]), (self.flights[flight],))

    def _without(self, points: Array) -> Array:
        """For each member, vectors (M, n) with its effect taken away; (members, M, n)."""
        bare = np.tile(points, (len(self.members), 1, 1))
        for rows, member in zip(bare, self.members, strict=True):
            for u in member.amplitudes():
                rows[:, self.places[u.name]] = u.declared.absent
        return bare

    @cached_property
    def misfits(self) -> list[Array]:
        """What every flight's voltage is off by [V] under what was known before; nan where none was read."""
        return [f.voltage_v - volts for f, volts in zip(self.flights, self.expected_v, strict=True)]

    @cached_property
    def expected_v(self) -> list[Array]:
        """Voltage of every flight [V] under what was known before."""
        return [modelled.voltage[0] for modelled in self.all_predicted(self.unknowns.start[None, :])]

    def predicted(self, points: Array, flight: int, forms: bool = True) -> Predicted:
        """One flight's voltages for vectors (M, n), and the voltage rested after it where the sidecar has one.

        The lab's errors over the charge are taken to first order about the first vector's, from which the others
        differ by steps of differences. Without ``forms`` the members are taken by their equations alone.
        """
        return self._run(points, self._single(flight), forms).of(0, self.flights[flight])

    def all_predicted(self, points: Array) -> list[Predicted]:
        """The same of every flight."""
        found: dict[int, Predicted] = {}
        for group in abreast(self.flights):
            run = self._run(points, group)
            found |= {int(k): run.of(row, self.flights[k]) for row, k in enumerate(group.places)}
        return [found[k] for k in range(len(self.flights))]

    def _run(self, points: Array, group: Abreast, forms: bool = True, far: bool = False) -> _Run:
        """Of vectors (M, n) that hardly differ from the first, or are ``far`` from each other."""
        count = points.shape[0]
        formed = forms and any(points[:, own].any() for own in self.forms_by_flight)
        bare, of = self._bare(points if formed else points[:1])
        everything = np.vstack([points, bare])
        leading = np.zeros(everything.shape[0], dtype=np.intp)
        leading[count + of] = count + of[:, :1]
        pack = self._pack(everything, group.places)
        run = self._simulated(everything, group, pack, None if far else leading)
        wide = np.broadcast_to(run.voltage, (everything.shape[0], *group.time_s.shape))
        soc = np.broadcast_to(run.soc, wide.shape)[:count]
        grown = self._grown(pack, run, group, everything.shape[0], count)
        voltage = wide[:count] + self._beside(points, group, soc, grown, far)
        members = [wide[: rows.size] - wide[count + rows] for rows in of]
        if formed:
            for charges, own, added in zip(self.form_knots, self.forms_by_flight, members, strict=True):
                voltage += form.formed(charges, points[:, own[group.places]], added, group, soc)
        rested = self._rested(pack, group, run)
        if rested is not None:
            rested = rested[:count] + self.lab.bent_v(points[:, self.lab_adding], soc[:, :, -1])
        added = np.array([added[0] for added in members]).reshape(-1, *soc.shape[1:])
        return _Run(voltage, rested, soc[0], added, None if grown is None else grown[:, 0])

    def _bare(self, points: Array) -> tuple[Array, Places]:
        """The different ones of the vectors without each member, and which of them it is; (members, M)."""
        bare, of = _different(self._without(points).reshape(-1, points.shape[1]))
        return bare, of.reshape(len(self.members), points.shape[0])

    def _beside(self, points: Array, group: Abreast, soc: Array, grown: Array | None, far: bool) -> Array:
        """What the lab's errors that only add do add to the voltage (M, F, T), near the first vector's charges.

        Likewise near what its members make of the drop. Of vectors that are ``far`` from it, each at its own.
        """
        rows, of = _different(np.column_stack([self._skew_s(points), points[:, self.lab_adding]]))
        along = [group.followed_at(float(skew)) for skew in rows[:, 0]]
        if far:
            total = np.empty(soc.shape)
            for k, (row, (late, now)) in enumerate(zip(rows, along, strict=True)):
                those = of == k
                by = None if grown is None else grown[:, those]
                total[those] = self.lab.beside(row[1:], late[:, None], now, soc[those], by)
            return total
        first = None if grown is None else grown[:, 0]
        own = np.stack([self.lab.beside(row[1:], *late, soc[0], first) for row, late in zip(rows, along, strict=True)])
        total = own[of]
        if points.shape[0] == 1:
            return total
        moved: list[tuple[Array, float, Value]] = [(soc - soc[0], _NEAR_STEP, 0.0)]
        if grown is not None:
            steps = _NEAR_STEP * np.eye(2)[:, :, None, None]
            moved += [(times - times[0], 0.0, step) for times, step in zip(grown, steps, strict=True)]
        for apart, charge, times in moved:
            low, high = (
                self.lab.beside(
                    rows[0, 1:], *along[0], soc[0] + side * charge, first if first is None else first + side * times
                )
                for side in (-1.0, 1.0)
            )
            total += (high - low) / (2.0 * _NEAR_STEP) * apart
        return total

    def _grown(self, pack: PackModel, run: Simulation, group: Abreast, rows: int, count: int) -> Array | None:
        """Times what the cells' drop is in the lab, of the first vectors: at once and later (2, M, F, T).

        What the lab told that its model's form is off by is a share of the drop, so it grows with that in the cold,
        which slows down all that a cell does: two to four times. Where diffusion is slower than in the lab, what comes
        later grows with it. What else makes resistance grow has a place of its own. Of what no lab told nothing is
        known at the lab's temperature: it is what flights make it.
        """
        if not self.lab.form_told:
            return None
        # None with states of its own (a core's lag) lays anything on the cells.
        cold = [effect for effect in pack.effects if "temperature" in effect.drivers and not effect.state_names]
        bare = PackModel(pack.cell, pack.series, pack.parallel, cold)
        by = bare.modifiers(run.states, run.temperature, group.current_a)
        slower = [effect.slowing for effect in pack.effects if isinstance(effect, SlowDiffusion)]
        times = (by.resistance, prod(slower, start=1.0 / by.diffusion))
        if all(np.ndim(t) == 0 and t == 1.0 for t in times):
            return None
        return np.stack([np.broadcast_to(t, (rows, *group.time_s.shape))[:count] for t in times])

    def _added(self, run: _Run, group: Abreast, skew_s: float) -> Array:
        """What one of each number of `additions` adds to the voltage; (numbers, F, T)."""
        lab = self.lab.added(*group.followed_at(skew_s), run.soc, run.grown)
        knots = zip(self.form_knots, run.members, strict=True)
        forms = [form.shapes(charges, own, group, run.soc) for charges, own in knots]
        return np.concatenate([lab, *forms])

    def _rested(self, flown: PackModel, group: Abreast, run: Simulation) -> Array | None:
        """After landing, unplugged: nothing flows, and another meter reads it; (M, F), None where none did."""
        if all(f.notes.rest_voltage_v is None for f in group.flights):
            return None
        kept = [
            e
            for e in flown.effects
            if type(e).true_current is Effect.true_current and type(e).measured_voltage is Effect.measured_voltage
        ]
        pack = PackModel(self.lab.cell, self.lab.series, self.lab.parallel, kept)
        names = dict(zip(flown.state_names, run.states, strict=True))
        shape = np.broadcast_shapes(run.voltage.shape, *(names[n].shape for n in pack.state_names))
        last = np.stack([np.broadcast_to(names[n], shape)[..., -1] for n in pack.state_names], axis=-1)
        kelvin = None if group.temperature_k is None else group.temperature_k[:, -1:]
        rest_s = np.array([[f.notes.rest_s] for f in group.flights])
        rested = pack.step(last[:, :, None, :], rest_s, 0.0, 0.0, kelvin)
        return np.asarray(pack.voltage(rested, 0.0, kelvin))[..., 0]

    def whitened(self, series: Array, flight: int, noise: Noise) -> Array:
        """What is in a flight's voltages (.., T), in standard deviations of noise and of what a sample cannot tell."""
        return self._whitened(series[..., None, :], self._single(flight), noise)[..., 0, :]

    def _whitened(self, series: Array, group: Abreast, noise: Noise) -> Array:
        """The same of flights side by side (.., F, T)."""
        return noise.whitened(series, self._beside_noise(group, noise))

    def _beside_noise(self, group: Abreast, noise: Noise) -> Array:
        """How many times an innovation's own size it is doubted for what a sample cannot tell; (F, T)."""
        return noise.beside(self.lab.ohmic * group.sudden_a)

    def log_scale(self, noise: Noise) -> float:
        """Sum over all samples read of the log of the volts that a whitened residual of one stands for."""
        total = 0.0
        for group in abreast(self.flights):
            beside = self._beside_noise(group, noise)
            read = np.arange(beside.shape[-1]) < np.array([[f.time_s.size] for f in group.flights])
            total += float(np.sum(np.log(noise.scale_v * beside)[read & ~group.unread]))
        return total

    def _rows(self, run: _Run, group: Abreast, noise: Noise) -> list[Array]:
        """Whitened residuals of each flight, nothing where no voltage was read, and the rested one; (M, rows) each."""
        misfit = group.voltage_v - run.voltage
        at = np.arange(misfit.shape[-1])
        for k in np.flatnonzero(group.unread.any(axis=-1)).tolist():
            read = ~group.unread[k]
            misfit[:, k] = [np.interp(at, at[read], row[read]) for row in misfit[:, k]]
        white = self._whitened(misfit, group, noise)
        white[:, group.unread] = 0.0
        found = []
        for k, data in enumerate(group.flights):
            rows = white[:, k, : data.time_s.size]
            if data.notes.rest_voltage_v is not None:
                assert run.rested is not None
                rest = (data.notes.rest_voltage_v - run.rested[:, k : k + 1]) / self._rest_sd_v
                rows = np.concatenate([rows, rest], axis=1)
            found.append(rows)
        return found

    @property
    def _rest_sd_v(self) -> float:
        return self.lab.series * _REST_SD_V

    def residuals(self, x: Array, noise: Noise) -> list[Array]:
        """Whitened residuals of every flight, and of the voltage rested after it."""
        found: dict[int, Array] = {}
        for group in abreast(self.flights):
            rows = self._rows(self._run(x[None, :], group), group, noise)
            found |= {int(k): own[0] for k, own in zip(group.places, rows, strict=True)}
        return [found[k] for k in range(len(self.flights))]

    def each_residuals(self, points: Array, noise: Noise) -> list[list[Array]]:
        """The residuals of vectors (M, n) that may be far from each other, sooner than of one after the other."""
        found: list[list[Array]] = []
        for few in np.split(points, range(_AT_ONCE, points.shape[0], _AT_ONCE)):
            rows: dict[int, Array] = {}
            for group in abreast(self.flights):
                whitened = self._rows(self._run(few, group, far=True), group, noise)
                rows |= zip(group.places.tolist(), whitened, strict=True)
            found += [[rows[flight][k] for flight in range(len(self.flights))] for k in range(few.shape[0])]
        return found

    def linearised(
        self, x: Array, noise: Noise, moving: Collection[str] | None = None
    ) -> tuple[list[Array], list[Slopes]]:
        """Whitened residuals of every flight, and their derivatives by the vector in standard deviations.

        By the blocks named, or by all of them.
        """
        found: dict[int, tuple[Array, Slopes]] = {}
        used, asked = self._asked(moving)
        points, steps = self.moved(x, used)
        bends = np.flatnonzero(asked < BEND_SOC.size)
        for group in abreast(self.flights):
            run = self._run(points, group)
            added = np.empty((0, *group.time_s.shape))
            if asked.size:
                added = self._added(run, group, float(self._skew_s(x[None, :])[0]))[asked]
            white = self._whitened(added, group, noise)
            parts = zip(group.places.tolist(), group.flights, self._rows(run, group, noise), strict=True)
            for k, (flight, data, rows) in enumerate(parts):
                count, moved, places = data.time_s.size, used[flight], self.additions[flight, asked]
                # A number's slopes lie side by side: they are made so.
                slope = np.zeros((moved.size + places.size, rows.shape[1]))
                adding = slope[moved.size :]
                slope[: moved.size] = (rows[1:] - rows[0]) * (self.scale[moved] / steps[moved])[:, None]
                adding[:, :count] = white[:, k, :count] * -self.scale[places][:, None]
                slope[:, :count][:, group.unread[k, :count]] = 0.0
                if rows.shape[1] > count:
                    adding[bends, -1] = -added[bends, k, count - 1] * self.scale[places[bends]] / self._rest_sd_v
                found[flight] = rows[0], Slopes(slope.T, np.concatenate([moved, places]), x.size)
        return [found[k][0] for k in range(len(self.flights))], [found[k][1] for k in range(len(self.flights))]

    def _asked(self, moving: Collection[str] | None) -> tuple[Places, Places]:
        """Of some blocks, or of all, the numbers that `columns` has (flights, ..), and which `additions` are theirs."""
        if moving is None:
            return self.columns, np.arange(self.additions.shape[1])
        numbers = [np.arange(p.start, p.stop) for name, p in self.places.items() if name in moving]
        theirs = np.concatenate([np.zeros(0, dtype=np.intp), *numbers])
        used = self.columns[:, np.isin(self.columns[0], theirs)]
        return used, np.flatnonzero(np.isin(self.additions[0], theirs))

    def slopes_of(self, member: Candidate, x: Array, noise: Noise) -> list[Array]:
        """Derivatives (rows, numbers) of every flight's whitened residuals by the numbers of one member's effects."""
        used = self.places_by_flight([u.name for u in member.unknowns])
        own = np.unique(used)
        points, steps = self.moved(x, used)
        found: dict[int, Array] = {}
        for group in abreast(self.flights):
            rows = self._rows(self._run(points, group), group, noise)
            for flight, off in zip(group.places.tolist(), rows, strict=True):
                moved = used[flight]
                slope = np.zeros((own.size, off.shape[1]))
                slope[np.searchsorted(own, moved)] = (off[1:] - off[0]) * (self.scale[moved] / steps[moved])[:, None]
                found[flight] = slope.T
        return [found[k] for k in range(len(self.flights))]

    def moved(self, x: Array, used: Places) -> tuple[Array, Array]:
        """A vector, then the same with each number moved of those that are used (flights, numbers); and the steps (n,).

        What belongs to a flight moves no other: such numbers of all flights are moved at once.
        """
        step = _STEP * self.scale
        steps = np.where(x + step > self.unknowns.high, -step, step)  # turned round at an upper bound
        points = np.tile(x, (used.shape[1] + 1, 1))
        points[np.arange(1, used.shape[1] + 1), used] += steps[used]
        return points, steps


def _different(rows: Array) -> tuple[Array, Places]:
    """The different ones of some rows (M, n), in the order in which they come, and which of them each is."""
    places: dict[bytes, int] = {}
    of = np.array([places.setdefault(row.tobytes(), len(places)) for row in rows], dtype=np.intp)
    first = np.unique(of, return_index=True)[1]
    return rows[first], of
