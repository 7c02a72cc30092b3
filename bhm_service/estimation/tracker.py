"""One pack, one filter: from samples to a belief about the pack's state.

`Tracker.step` maps a track and a sample to the next track and an estimate; it keeps nothing itself. What it does
where the paper's filters failed: samples are checked and gated, any interval is taken, rests only propagate and
observe, the charge at the start comes from the voltage with its uncertainty, and a filter that lost the pack starts
over and says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from bhm_service.battery.cell import CellModel
from bhm_service.battery.effects.base import Effect
from bhm_service.battery.pack import PackModel
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.estimation.drift import Drift
from bhm_service.estimation.ukf import Belief, FilterDivergedError, UnscentedFilter
from bhm_service.messages import BatterySample, Model, Rejection, StateEstimate
from bhm_service.units import SECONDS_PER_HOUR, Array

_Z90 = 1.6448536269514722  # a 90 % band of a Gaussian is this many standard deviations to each side


# Standard deviations of what no battery file knows, calibrated on the recorded flights in ../shared/data/flights:
# with them the mean of NIS is between 0.2 and 1.5 on all of them. Voltages are per cell.
_VOLTAGE_NOISE_V = 0.004  # of one sample
_LOAD_NOISE = 0.04  # of one sample, times the drop under load: gusts between the current and the voltage sample
_SKEW_NOISE = 0.25  # likewise, times the drop of what the current changed since the last sample
_POLARISATION_NOISE = 0.006  # of the settled drop, per root second
_RESISTANCE_DRIFT = 0.006  # of the logarithm of the resistance, per root second of flight
_CHARGE_BETWEEN = 0.1  # of the current, unseen between samples

# What no multirotor pack does, so what is a fault of the reading. Currents in multiples of the capacity per hour;
# a little below zero is the sensor's noise around it, more has to be seen in the voltage as well.
_CELL_V = (1.0, 5.0)
_MOST_C, _NOISE_C = 100.0, 0.05
_SPEAKS_NATS = 3.0  # of a voltage for one current and against another
_REST_C = 0.2  # below this the pack rests: its voltage says nothing of its resistance
_GATE = 25.0  # innovations beyond five standard deviations are not used
_PATIENCE_S, _PATIENCE_SAMPLES = 8.0, 5  # refused for so long, the filter is what is wrong
_THERMOMETER_K, _THERMOMETER_S = 1.0, 20.0  # how far a reading is from the cells, and for how long by the same amount
_NIS_MEMORY_S = 20.0
_FAR = 4.0  # standard deviations of the model's voltage error: further off, the belief is what is wrong
_SETTLE_S = 20.0  # a new belief is left alone for so long
_LOAD_MEMORY_S = 30.0
_UNEXPLAINED = 6.0  # standard deviations between a voltage and the nearest that a charge explains
_UNSEEN_S = 10.0  # longer between samples, the load may have been anything
_BLIND_S = 30.0  # without current or voltage for longer, there is no estimate
_WORST_SOC_SD = 0.20  # nor with a larger uncertainty
# Slightly beyond full and empty: a pack may hold more than its label says, and a clipped belief creeps inwards.
_SOC_LOW, _SOC_HIGH = -0.05, 1.05
_GRID = np.linspace(0.0, _SOC_HIGH, 421)  # a start below empty is a faulty reading


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """Everything that a tracker remembers from one sample to the next."""

    belief: Belief
    time_s: float  # of the belief
    current_a: float  # last one measured
    load_a: float  # running mean of it: what is assumed while none is measured
    used_s: float  # when voltage and current were last used together
    started_s: float  # when it began, or began again
    nis: float = 1.0  # running mean of the innovations' squares over their expectation
    refused: int = 0  # samples in a row
    refused_since_s: float = 0.0
    restarts: int = 0


class Tracker:
    """A filter for one cell model in one pack."""

    def __init__(
        self,
        model: Model,
        cell: CellModel,
        series: int,
        parallel: float,
        effects: tuple[Effect, ...] = (),
        uncertainty: Uncertainty | None = None,
    ) -> None:
        self.model = model
        self.uncertainty = uncertainty if uncertainty is not None else Uncertainty()
        self.drift = Drift(capacity_c=cell.capacity_c)
        self._parallel = parallel
        self.pack = PackModel(cell, series, parallel, (*effects, self.drift))
        self._capacity_c = float(np.asarray(self.pack.capacity_c))
        self._capacity_a = self._capacity_c / SECONDS_PER_HOUR
        n = self.pack.n_states
        self._log_r, self._log_p, self._log_c, self._error = range(n - 4, n)
        self._low, self._high = np.full(n, -np.inf), np.full(n, np.inf)
        self._low[0], self._high[0] = _SOC_LOW, _SOC_HIGH
        self._low[self._log_r : self._error], self._high[self._log_r : self._error] = (
            (-3.0, -3.0, -1.0),
            (3.0, 3.0, 0.5),
        )
        # States of effects that are no voltages say themselves how uncertain they are.
        self._spreads = self.pack.spreads()
        self._filter = UnscentedFilter(n, constrain=self._constrain)
        self._full_v = float(np.asarray(self.pack.open_circuit(1.0)))
        self._rest_states = np.array([np.broadcast_to(v, _GRID.shape) for v in self.pack.rest(_GRID)]).T
        # Resistance of the pack in the first seconds of a load, and after minutes of it.
        self._prompt_ohm = self._drop_ohm(self._capacity_a, 1.0)
        self._settled_ohm = self._drop_ohm(1e-3 * self._capacity_a, 600.0)

    def overfull_v(self, voltage_v: float) -> float:
        """By how much a cell shows more than a full one of the battery file. [V]"""
        return (voltage_v - self._full_v) / self.pack.series

    def _drop_ohm(self, current: float, seconds: float) -> float:
        """Drop under a current that has run for so long, against none: loads past the sensor are in both. [Ohm]"""
        states = np.array([self.pack.rest(0.5)], dtype=float)
        idle, loaded = (float(self.pack.voltage(self.pack.step(states, seconds, i), i)[0]) for i in (0.0, current))
        return (idle - loaded) / current

    # ---- beginning ----------------------------------------------------------------------------------------------

    def start(self, sample: BatterySample, before: Track | None = None) -> Track:
        """A track from one sample: the charge that its voltage speaks for, with what it leaves open.

        The voltage is read through the open-circuit curve after adding the drop under load, which lies between that
        of the first seconds and the settled one. What an earlier track learnt of resistance and capacity is kept.
        Both measurements must be known. Raises FilterDivergedError when no charge explains them.
        """
        assert sample.voltage_v is not None and sample.current_a is not None
        u = self.uncertainty
        n = self.pack.n_states
        mean = np.zeros(n)
        covariance = np.zeros((n, n))
        log_r, var_log_r = 0.0, u.resistance**2
        log_p, var_log_p = 0.0, u.polarisation**2
        log_c, var_log_c = 0.0, u.capacity**2
        if before is not None:
            log_r, var_log_r = self._kept(before, self._log_r, var_log_r)
            log_p, var_log_p = self._kept(before, self._log_p, var_log_p)
            log_c, var_log_c = self._kept(before, self._log_c, var_log_c)

        series, current = self.pack.series, sample.current_a
        ohmic = self._prompt_ohm * current * math.exp(log_r)
        polarised = 0.5 * (self._settled_ohm - self._prompt_ohm) * current * math.exp(log_p)
        drop = ohmic + polarised
        sd_error = series * u.voltage_error_v
        sd_other = math.hypot(series * _VOLTAGE_NOISE_V, polarised * (1.0 + math.sqrt(var_log_p)))
        sd_drop = abs(ohmic) * math.sqrt(var_log_r)
        total = math.sqrt(sd_error**2 + sd_other**2 + sd_drop**2)

        curve = self.pack.voltage(self._rest_states, 0.0)
        distance = (sample.voltage_v + drop - curve) / total
        if float(np.min(np.abs(distance))) > _UNEXPLAINED:
            raise FilterDivergedError(f"{sample.voltage_v:.2f} V is what no charge of this pack explains")
        weight = np.exp(-0.5 * np.minimum(distance**2 - np.min(distance**2), 700.0))
        weight /= weight.sum()
        soc = float(weight @ _GRID)
        soc_sd = max(math.sqrt(float(weight @ (_GRID - soc) ** 2)), 0.005)

        mean[:] = self.pack.rest(soc)
        mean[0] = soc
        mean[self._log_r], mean[self._log_p], mean[self._log_c] = log_r, log_p, log_c
        if abs(drop) > 0.0:
            # The slow states take the share of a settled load that the spread stands for.
            states = np.array([mean])
            mean = self.pack.step(states, 20.0, current, temperature=sample.temperature_k)[0]
            mean[0] = soc
        diagonal = np.full(n, (0.5 * polarised / series) ** 2 + 1e-8)
        for k, spread in self._spreads:
            diagonal[k] = spread.start**2
        diagonal[0] = soc_sd**2
        diagonal[self._log_r] = var_log_r
        diagonal[self._log_p] = var_log_p
        diagonal[self._log_c] = var_log_c
        diagonal[self._error] = u.voltage_error_v**2
        covariance[np.diag_indices(n)] = diagonal
        # A voltage error or a wrong resistance was read as charge: the belief knows that they hang together.
        self._correlate(covariance, self._error, -sd_error / total * soc_sd)
        self._correlate(covariance, self._log_r, math.copysign(sd_drop / total, drop) * soc_sd)
        return Track(
            belief=self._felt(Belief(mean, covariance), sample, _THERMOMETER_S),
            time_s=sample.time_s,
            current_a=current,
            load_a=current if before is None else before.load_a,
            used_s=sample.time_s,
            started_s=sample.time_s,
            restarts=0 if before is None else before.restarts + 1,
        )

    @staticmethod
    def _correlate(covariance: Array, k: int, part: float) -> None:
        shared = 0.98 * part * math.sqrt(covariance[k, k])
        covariance[0, k] = covariance[k, 0] = shared

    @staticmethod
    def _kept(before: Track, k: int, prior: float) -> tuple[float, float]:
        mean, variance = float(before.belief.mean[k]), float(before.belief.covariance[k, k])
        return (mean, min(4.0 * variance, prior)) if math.isfinite(mean + variance) else (0.0, prior)

    # ---- one sample ---------------------------------------------------------------------------------------------

    def step(self, track: Track | None, sample: BatterySample) -> tuple[Track | None, StateEstimate | None]:
        """Take one sample into a track. No estimate comes before the first usable sample."""
        why = self._refused(track, sample)
        if track is None:
            if why is not None:
                return None, None
            return self._begin(sample, None)
        if sample.time_s < track.time_s:
            return track, self._estimate(track, sample, Rejection.OUT_OF_ORDER, None)
        try:
            return self._advance(track, sample, why)
        except FilterDivergedError:
            return (None, None) if why is not None else self._begin(sample, track)

    def _begin(self, sample: BatterySample, before: Track | None) -> tuple[Track | None, StateEstimate | None]:
        try:
            track = self.start(sample, before)
        except FilterDivergedError:
            return None, None
        return track, self._estimate(track, sample, None, None)

    def _advance(self, track: Track, sample: BatterySample, why: Rejection | None) -> tuple[Track, StateEstimate]:
        current = sample.current_a if why is None or why is Rejection.NO_VOLTAGE else None
        belief = self._propagate(track, sample, current)
        moved = replace(
            track,
            belief=belief,
            time_s=sample.time_s,
            current_a=track.current_a if current is None else current,
            load_a=track.load_a if current is None else self._load(track, current, sample.time_s - track.time_s),
        )
        if why is not None:
            return moved, self._estimate(moved, sample, why, None)
        assert sample.voltage_v is not None and current is not None
        innovation = self._filter.innovate(
            belief,
            lambda points: self.pack.voltage(points, current, sample.temperature_k),
            sample.voltage_v,
            self._noise(moved.belief, track.current_a, current, sample.time_s - track.time_s) * max(1.0, track.nis),
        )
        seen = (innovation.expected, math.sqrt(innovation.variance), innovation.nis)
        if innovation.nis > _GATE:
            since = track.refused_since_s if track.refused else sample.time_s
            count = track.refused + 1
            refused = replace(moved, refused=count, refused_since_s=since)
            if count >= _PATIENCE_SAMPLES and sample.time_s - since >= _PATIENCE_S:
                again, estimate = self._begin(sample, moved)
                if again is not None and estimate is not None:
                    return again, estimate
            return refused, self._estimate(refused, sample, Rejection.SURPRISING, seen)
        forget = math.exp(-max(sample.time_s - track.time_s, 0.1) / _NIS_MEMORY_S)
        used = replace(
            moved,
            belief=self._filter.update(
                innovation, held=(self._log_r,) if abs(current) < _REST_C * self._capacity_a else ()
            ),
            used_s=sample.time_s,
            nis=forget * track.nis + (1.0 - forget) * innovation.nis * max(1.0, track.nis),
            refused=0,
        )
        if self._implausible(used):
            again, estimate = self._begin(sample, replace(used, belief=self._forgetful(used.belief)))
            if again is not None and estimate is not None:
                return again, estimate
        return used, self._estimate(used, sample, None, seen)

    def _implausible(self, track: Track) -> bool:
        """Whether the voltages are only explained by a model far worse than its file says: then the charge is wrong."""
        error = abs(float(track.belief.mean[self._error]))
        settled = track.time_s - track.started_s > _SETTLE_S
        return settled and error > _FAR * self.uncertainty.voltage_error_v

    def _forgetful(self, belief: Belief) -> Belief:
        """What was learnt of the pack on a wrong charge is as wrong: back to what its file says."""
        mean, covariance = belief.mean.copy(), belief.covariance.copy()
        u = self.uncertainty
        for k, sd in ((self._log_r, u.resistance), (self._log_p, u.polarisation), (self._log_c, u.capacity)):
            mean[k], covariance[k, k] = 0.0, sd * sd
        return Belief(mean, covariance)

    def _propagate(self, track: Track, sample: BatterySample, current: float | None) -> Belief:
        dt = sample.time_s - track.time_s
        if dt <= 0.0:
            return track.belief
        return self._felt(self._moved(track, sample, current, dt), sample, dt)

    def _felt(self, belief: Belief, sample: BatterySample, dt: float) -> Belief:
        """The belief with a measured temperature taken in, if it has a temperature at all."""
        if sample.temperature_k is None or not self.pack.carries_temperature:
            return belief
        variance = _THERMOMETER_K**2 * max(1.0, _THERMOMETER_S / max(dt, 0.05))
        seen = self._filter.innovate(belief, self.pack.carried_temperature, sample.temperature_k, variance)
        return self._filter.update(seen)

    def _moved(self, track: Track, sample: BatterySample, current: float | None, dt: float) -> Belief:
        begin, end = (track.load_a, track.load_a) if current is None else (track.current_a, current)
        return self._filter.predict(
            track.belief,
            lambda points: self.pack.step(points, dt, begin, end, sample.temperature_k),
            self._process_noise(begin, end, dt, blind_s=sample.time_s - track.used_s if current is None else 0.0),
        )

    @staticmethod
    def _load(track: Track, current: float, dt: float) -> float:
        keep = math.exp(-max(dt, 0.0) / _LOAD_MEMORY_S)
        return keep * track.load_a + (1.0 - keep) * max(current, 0.0)  # what flows back is no load

    # ---- noise --------------------------------------------------------------------------------------------------

    def _noise(self, belief: Belief, before: float, current: float, dt: float) -> float:
        """Variance of one voltage sample [V^2]. More than one sample a second tells no more than one does."""
        ohm = self._ohm(belief)
        sd = math.hypot(
            self.pack.series * _VOLTAGE_NOISE_V,
            _LOAD_NOISE * ohm * current,
            _SKEW_NOISE * ohm * (current - before),
        )
        return sd * sd * max(1.0, 1.0 / max(dt, 0.05))

    def _ohm(self, belief: Belief) -> float:
        """Resistance that the pack is believed to have in the first seconds of a load."""
        return self._prompt_ohm * math.exp(min(max(float(belief.mean[self._log_r]), -3.0), 3.0))

    def _process_noise(self, begin: float, end: float, dt: float, blind_s: float) -> Array:
        load = max(abs(begin), abs(end))
        unseen = _CHARGE_BETWEEN * load * math.sqrt(dt * min(dt, _UNSEEN_S)) + 0.5 * abs(end - begin) * min(
            dt, _UNSEEN_S
        )
        # While nothing is measured the load may be half as large again or as small, and stay so: its charge is as
        # uncertain as the square of the time, not as the time.
        alone_s = max(blind_s, dt if dt > _UNSEEN_S else 0.0)
        if alone_s > 0.0:
            doubt = 0.5 * max(load, 0.2 * self._capacity_a)
            unseen = math.hypot(unseen, doubt * math.sqrt(alone_s**2 - max(alone_s - dt, 0.0) ** 2))
        flying = min(load / self._capacity_a, 1.0)
        noise = np.full(
            self.pack.n_states, (_POLARISATION_NOISE * self._settled_ohm * load / self.pack.series) ** 2 * min(dt, 60.0)
        )
        noise += 1e-12 * dt
        for k, spread in self._spreads:
            noise[k] = spread.drift**2 * dt
        noise[0] = (unseen / self._capacity_c) ** 2 + 1e-12 * dt
        noise[self._log_r] = _RESISTANCE_DRIFT**2 * dt * flying + 1e-10 * dt
        noise[self._log_p] = noise[self._log_r]
        noise[self._log_c] = 1e-12 * dt
        kept = math.exp(-dt / float(self.drift.error_tau(0.5 * (begin + end) / self._parallel)))
        noise[self._error] = self.uncertainty.voltage_error_v**2 * (1.0 - kept * kept)
        return np.diag(noise)

    # ---- limits -------------------------------------------------------------------------------------------------

    def _constrain(self, points: Array) -> Array:
        inside: Array = np.minimum(np.maximum(points, self._low), self._high)
        return inside

    def _refused(self, track: Track | None, sample: BatterySample) -> Rejection | None:
        volts, amps = sample.voltage_v, sample.current_a
        if amps is None:
            return Rejection.NO_CURRENT
        if volts is None:
            return Rejection.NO_VOLTAGE
        if not (math.isfinite(volts) and math.isfinite(amps) and math.isfinite(sample.time_s)):
            return Rejection.NOT_FINITE
        cell = volts / self.pack.series
        if not _CELL_V[0] <= cell <= _CELL_V[1]:
            return Rejection.IMPLAUSIBLE
        if not -_MOST_C * self._capacity_a <= amps <= _MOST_C * self._capacity_a:
            return Rejection.IMPLAUSIBLE
        if amps < -_NOISE_C * self._capacity_a and not self._flows_back(track, sample):
            return Rejection.IMPLAUSIBLE
        return None

    def _flows_back(self, track: Track | None, sample: BatterySample) -> bool:
        """Whether the voltage speaks for the negative current, and clearly against the load that there was.

        A sensor that does not measure says a negative current whatever flows; a pack that is fed rises.
        """
        if track is None or sample.voltage_v is None or sample.current_a is None:
            return False
        volts, amps, dt = sample.voltage_v, sample.current_a, max(sample.time_s - track.time_s, 0.0)

        def square(begin: float, end: float) -> float:
            moved = self.pack.step(track.belief.mean[None, :], dt, begin, end, sample.temperature_k)
            return float(volts - self.pack.voltage(moved, end, sample.temperature_k)[0]) ** 2

        variance = self._noise(track.belief, amps, amps, dt) * max(1.0, track.nis)
        speaks = square(track.load_a, track.load_a) - square(track.current_a, amps)
        return 0.5 * speaks / variance > _SPEAKS_NATS

    # ---- saying -------------------------------------------------------------------------------------------------

    def _estimate(
        self,
        track: Track,
        sample: BatterySample,
        rejected: Rejection | None,
        seen: tuple[float, float, float] | None,
    ) -> StateEstimate:
        mean, covariance = track.belief.mean, track.belief.covariance
        soc = min(max(float(mean[0]), 0.0), 1.0)
        sd = math.sqrt(max(float(covariance[0, 0]), 0.0))
        at_load = float(self.pack.voltage(mean[None, :], track.current_a, sample.temperature_k)[0])
        blind = sample.time_s - track.used_s
        return StateEstimate(
            time_s=sample.time_s,
            model=self.model,
            valid=sd < _WORST_SOC_SD and blind < _BLIND_S,
            soc=soc,
            soc_sd=sd,
            soc_low=min(max(soc - _Z90 * sd, 0.0), 1.0),
            soc_high=min(max(soc + _Z90 * sd, 0.0), 1.0),
            soe=soc * min(max(at_load / self._full_v, 0.0), 1.0),
            voltage_expected_v=None if seen is None else seen[0],
            voltage_expected_sd_v=None if seen is None else seen[1],
            voltage_measured_v=sample.voltage_v,
            nis=None if seen is None else seen[2],
            rejected=rejected,
            mean=tuple(mean.tolist()),
            covariance=tuple(map(tuple, covariance.tolist())),
        )
