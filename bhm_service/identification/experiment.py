"""One recording of a cell as the fits use it: thinned where nothing happens, weighted so that rests and loads count."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from bhm_service.units import SECONDS_PER_HOUR, Array, Flags

_STEADY = 0.02  # of the largest current: a change below it does not end a bin
_KEPT_STEP_V, _KEPT_STEP_NOISE = 0.004, 6.0  # [V] and standard deviations of noise: nor does one of the voltage below
_EVEN = 0.1  # of the time between samples: how far it may change where noise is looked for
_LOADED = 0.05  # of the largest current: above, a sample is under load
_LONGEST_WEIGHT_S = 60.0  # a sample does not speak for longer than this


class Kind(Enum):
    """What an experiment was made for (paper section 7)."""

    SLOW = "slow"
    ONE_C = "one-C"
    VARIABLE = "variable"
    RATE = "rate"
    PULSES = "pulses"
    FLIGHT = "flight"


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """A recording of one cell; voltage is NaN where it was not measured (a bridged gap).

    Current is of the pack and positive while discharging, so a cell of this model carries the pack's capacity.
    """

    label: str
    kind: Kind
    time_s: Array
    current_a: Array
    voltage_v: Array
    temperature_k: Array | None = None
    full_at_start: bool = False  # the charge counter of the recording says that it began full

    @property
    def charge_c(self) -> Array:
        """Charge taken out since the first sample. [C]"""
        steps = 0.5 * (self.current_a[1:] + self.current_a[:-1]) * np.diff(self.time_s)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def measured(self) -> Flags:
        """Samples with a voltage."""
        return np.isfinite(self.voltage_v)

    @property
    def loaded(self) -> Flags:
        """Samples under load."""
        return np.abs(self.current_a) > _LOADED * float(np.max(np.abs(self.current_a)))

    @property
    def rest_before(self) -> float | None:
        """Voltage of the rest that the recording begins with [V]; None where it begins under load."""
        count = int(np.argmax(self.loaded)) if self.loaded.any() else self.time_s.size
        resting = self.voltage_v[:count][self.measured[:count]]
        return float(np.mean(resting[-20:])) if resting.size else None

    def weights(self) -> Array:
        """Weight of every sample, in sum one: by the time it speaks for, rests and loads together alike."""
        between = np.minimum(np.gradient(self.time_s), _LONGEST_WEIGHT_S) if self.time_s.size > 1 else np.ones(1)
        weight = np.where(self.measured, between, 0.0)
        for part in (self.loaded, ~self.loaded):
            total = float(weight[part].sum())
            if total > 0.0:
                weight[part] /= total
        whole: Array = weight / max(float(weight.sum()), 1e-300)
        return whole

    def part(self, where: slice) -> Experiment:
        """Some of its samples."""
        kelvin = None if self.temperature_k is None else self.temperature_k[where]
        return replace(
            self,
            time_s=self.time_s[where],
            current_a=self.current_a[where],
            voltage_v=self.voltage_v[where],
            temperature_k=kelvin,
        )

    def without_onset(self) -> Experiment:
        """The same, its first voltage unknown where it begins under load.

        For how long that load had lasted by then is not recorded: a step that shows within milliseconds, and all that a
        model lets follow later, would be told by a rest that nobody saw end.
        """
        if self.time_s.size < 2 or not self.loaded[0]:
            return self
        volts = self.voltage_v.copy()
        volts[0] = np.nan
        return replace(self, voltage_v=volts)

    def thinned(self, most: int = 1500) -> Experiment:
        """The same with runs of steady current drawn together, of up to a ``most``-th of its span each.

        A slow discharge at one hertz says the same thing 180 000 times. A run becomes its first and its last instant,
        with the current that carries the run's charge and the line through the run's voltages, so no charge is lost;
        steps stay as they are.
        """
        if self.time_s.size <= most:
            return self
        edges = self._edges(float(self.time_s[-1] - self.time_s[0]) / most)
        ends = np.append(edges[1:], self.time_s.size) - 1
        charge, span = self.charge_c, self.time_s[ends] - self.time_s[edges]
        run = span > 0.0
        held = np.where(run, (charge[ends] - charge[edges]) / np.where(run, span, 1.0), self.current_a[edges])
        first_v, last_v = _lines(self.time_s, self.voltage_v, edges, ends)
        kept = np.column_stack([np.ones(edges.size, dtype=bool), run]).ravel()

        def pairs(first: Array, last: Array) -> Array:
            both: Array = np.column_stack([first, last]).ravel()[kept]
            return both

        kelvin = self.temperature_k
        return replace(
            self,
            time_s=pairs(self.time_s[edges], self.time_s[ends]),
            current_a=pairs(held, held),
            voltage_v=pairs(first_v, last_v),
            temperature_k=None if kelvin is None else pairs(kelvin[edges], kelvin[ends]),
        )

    def _noise_v(self, tolerance_a: float) -> float:
        """Standard deviation of voltages about their neighbours', where current and sampling are steady. [V]"""
        between = np.diff(self.time_s)
        same = np.abs(np.diff(self.current_a)) <= tolerance_a
        steady = same[1:] & same[:-1] & (np.abs(np.diff(between)) <= _EVEN * between[1:])
        bends = np.diff(self.voltage_v, 2)[steady]
        bends = bends[np.isfinite(bends)]
        return 1.48 * float(np.median(np.abs(bends))) / 6.0**0.5 if bends.size else 0.0

    def _edges(self, longest_s: float) -> np.ndarray:
        """First samples of runs of steady current and voltage."""
        tolerance = _STEADY * float(np.max(np.abs(self.current_a)))
        kept_step = max(_KEPT_STEP_V, _KEPT_STEP_NOISE * self._noise_v(tolerance))
        edges, begin = [0], 0
        t, i, v = self.time_s.tolist(), self.current_a.tolist(), self.voltage_v.tolist()
        for k in range(1, len(t)):
            jump = abs(i[k] - i[begin]) > tolerance or not abs(v[k] - v[begin]) < kept_step
            if jump or t[k] - t[begin] >= longest_s:
                edges.append(k)
                begin = k
        return np.array(edges)


def _lines(time_s: Array, voltage_v: Array, first: np.ndarray, last: np.ndarray) -> tuple[Array, Array]:
    """The straight line through the voltages of every run, at its first and at its last sample."""
    count = last - first + 1
    place = time_s - np.repeat(time_s[first], count)

    def sums(values: Array) -> Array:
        return np.asarray(np.add.reduceat(values, first))

    t_mean, v_mean = sums(place) / count, sums(voltage_v) / count
    across = sums(place * voltage_v) / count - t_mean * v_mean
    along = sums(place * place) / count - t_mean**2
    slope = np.where(along > 0.0, across / np.where(along > 0.0, along, 1.0), 0.0)
    return v_mean - slope * t_mean, v_mean + slope * (time_s[last] - time_s[first] - t_mean)


@dataclass(frozen=True, slots=True)
class Discharge:
    """One discharge inside a recording."""

    label: str
    charge_ah: float  # down to the cut-off, or to its end
    begin_v: float
    end_v: float
    seconds: float


def discharges(experiment: Experiment, cutoff_v: float | None = None) -> list[Discharge]:
    """Every uninterrupted discharge of a recording, with its charge down to ``cutoff_v`` of the cell."""
    discharging = experiment.current_a > _LOADED * float(np.max(np.abs(experiment.current_a)))
    starts = np.flatnonzero(discharging & ~np.append(False, discharging[:-1]))
    ends = np.flatnonzero(discharging & ~np.append(discharging[1:], False)) + 1
    found = []
    for begin, end in zip(starts, ends, strict=True):
        piece = experiment.part(slice(max(begin - 1, 0), end))
        charge = piece.charge_c / SECONDS_PER_HOUR
        volts = piece.voltage_v
        last = charge[-1]
        if cutoff_v is not None and np.nanmin(volts) < cutoff_v:
            k = int(np.argmax(volts < cutoff_v))
            share = (volts[k - 1] - cutoff_v) / max(volts[k - 1] - volts[k], 1e-9) if k else 0.0
            last = charge[max(k - 1, 0)] + share * (charge[k] - charge[max(k - 1, 0)])
        found.append(
            Discharge(
                experiment.label,
                float(last),
                float(volts[0]),
                float(volts[-1]),
                float(piece.time_s[-1] - piece.time_s[0]),
            )
        )
    return found
