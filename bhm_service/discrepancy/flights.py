"""Recorded flights as the search uses them: gaps closed, temperature smoothed, the unusable left out and named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from bhm_service.discrepancy.readings import before_unseen_landing, of_a_part, without_spikes
from bhm_service.discrepancy.sidecar import Notes
from bhm_service.errors import BadInputError
from bhm_service.mavlink.log import read_log
from bhm_service.mavlink.recording import Recording, battery_ids, record
from bhm_service.units import SECONDS_PER_HOUR, Array, Flags

_SHORTEST_S = 60.0
_LONGEST_GAP_S = 30.0  # over which a current is carried on
_UNUSABLE_SHARE = 0.2  # of samples without current
_GAUGE_LOW, _GAUGE_HIGH = 0.05, 0.97  # a gauge that says more than this at the start says "full"
_TEMPERATURE_S = 60.0  # a pack's temperature does not move faster; one degree of rounding does
_CELL_V = (2.3, 4.45)
_CHARGED_V = 3.3  # of a cell that anybody takes off with
_PARTIAL = "{} of its {} voltages, at rest and below what it reads under load later: a cell was not connected"
_UNSEEN = "its last {:.0f} s: the load ended within {:.0f} s of which nothing is recorded"
_SHIFT_S = 0.5  # between the instants that a current is kept at beside its own
SHIFTS_S = _SHIFT_S * np.arange(-7, 8)  # one beyond what a skew may be


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightData:
    """One discharge of one pack: a log, or a log's part between changes of pack."""

    label: str
    time_s: Array  # from zero
    current_a: Array  # measured, positive while discharging
    voltage_v: Array  # of the pack; NaN where it was not measured
    temperature_k: Array | None
    airborne: Flags
    altitude_m: Array  # NaN where not recorded
    climb_mps: Array
    speed_mps: Array
    pressure_pa: Array
    reading: float | None = None  # state of charge at the start that a gauge gives, None: taken as full
    notes: Notes = Notes()
    cold_board_k: float | None = None  # of the barometer's board, soon after the autopilot's boot
    board_k: Array | None = None  # the same all along; NaN where not recorded
    cells_v: Array | None = None  # of each cell (T, series), NaN where not measured; None: of the pack only
    shifts_a: Array | None = None  # (shifts, T), see `shifted_a`; None: the samples' own tell it

    @property
    def shifted_a(self) -> Array:
        """The current as it is `SHIFTS_S` later than each sample; (shifts, T). [A]

        Of means over neighbours nobody can tell it any more: they bring it along.
        """
        if self.shifts_a is not None:
            return self.shifts_a
        return np.stack([np.interp(self.time_s + s, self.time_s, self.current_a) for s in SHIFTS_S])

    @property
    def charge_c(self) -> Array:
        """Charge counted out since the first sample. [C]"""
        steps = 0.5 * (self.current_a[1:] + self.current_a[:-1]) * np.diff(self.time_s)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def flown_a(self) -> Array:
        """Current in the air; all of it where nothing tells when that was. [A]"""
        return self.current_a[self.airborne] if self.airborne.any() else self.current_a

    @property
    def since_takeoff_s(self) -> Array:
        """Time since take-off [s], negative before it."""
        first = int(np.argmax(self.airborne)) if self.airborne.any() else 0
        return np.asarray(self.time_s - self.time_s[first])

    def thinned(self, most: int) -> FlightData:
        """The same with neighbouring samples averaged, where there are more than ``most``."""
        size = -(-self.time_s.size // most)
        if size == 1:
            return self
        count = self.time_s.size // size

        def blocks(series: Array) -> Array:
            return series[: count * size].reshape(count, size)

        def mean(series: Array) -> Array:
            return np.asarray(blocks(series).mean(axis=1))

        cells = None if self.cells_v is None else np.stack([mean(cell) for cell in self.cells_v.T], axis=1)

        return replace(
            self,
            time_s=mean(self.time_s),
            current_a=mean(self.current_a),
            shifts_a=np.stack([mean(row) for row in self.shifted_a]),
            voltage_v=mean(self.voltage_v),
            temperature_k=None if self.temperature_k is None else mean(self.temperature_k),
            airborne=blocks(self.airborne.astype(float)).mean(axis=1) >= 0.5,
            altitude_m=mean(self.altitude_m),
            climb_mps=mean(self.climb_mps),
            speed_mps=mean(self.speed_mps),
            pressure_pa=mean(self.pressure_pa),
            board_k=None if self.board_k is None else mean(self.board_k),
            cells_v=cells,
        )

    def part(self, where: slice) -> FlightData:
        """Some of its samples."""
        cut = {
            name: getattr(self, name)[where]
            for name in (
                "time_s", "current_a", "voltage_v", "airborne", "altitude_m", "climb_mps", "speed_mps", "pressure_pa"
            )
        }  # fmt: skip
        kelvin = None if self.temperature_k is None else self.temperature_k[where]
        board = None if self.board_k is None else self.board_k[where]
        shifts = None if self.shifts_a is None else self.shifts_a[:, where]
        cells = None if self.cells_v is None else self.cells_v[where]
        return replace(self, temperature_k=kelvin, board_k=board, shifts_a=shifts, cells_v=cells, **cut)


def usual_step_s(flights: Sequence[FlightData]) -> float:
    """Time from one sample to the next, as it is in most places. [s]"""
    return float(np.median(np.concatenate([np.diff(f.time_s) for f in flights])))


def at_skew(skew_s: Array) -> Array:
    """Weights of a current at each of `SHIFTS_S` for the current so much later (M,); (M, shifts).

    A cubic through four neighbours [Catmull and Rom 1974]: its slope at no skew is the same from both sides.
    """
    place = np.clip((skew_s - SHIFTS_S[0]) / _SHIFT_S, 1.0, SHIFTS_S.size - 2.0)
    first = np.minimum(place.astype(np.intp), SHIFTS_S.size - 3)
    u = place - first
    near = [-0.5 * u + u**2 - 0.5 * u**3, 1.0 - 2.5 * u**2 + 1.5 * u**3, 0.5 * u + 2.0 * u**2 - 1.5 * u**3,
            -0.5 * u**2 + 0.5 * u**3]  # fmt: skip
    found = np.zeros((skew_s.size, SHIFTS_S.size))
    for k, weight in enumerate(near):
        found[np.arange(skew_s.size), first - 1 + k] = weight
    return found


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A recording that was not used, or part of one, and why."""

    label: str
    because: str


def read_flights(
    logs: Sequence[Path],
    series: int,
    capacity_c: float,
    notes: Mapping[str, Notes],
    battery_id: int | None = None,
) -> tuple[list[FlightData], list[LeftOut]]:
    """All flights of the logs, and what was left out with its reason.

    Raises BadInputError when the pack has another number of cells, or when the sidecar names a log that was not given.
    """
    known = {path.name for path in logs}
    strange = [name for name in notes if name not in known]
    if notes and len(strange) == len(notes):
        raise BadInputError("sidecar", f"none of its files is among the logs; it names {', '.join(strange[:3])}")
    found: list[FlightData] = []
    left_out: list[LeftOut] = []
    for path in logs:
        told = notes.get(path.name, Notes())
        try:
            flights, without = _flights(path, series, capacity_c, told, battery_id)
        except BadInputError as why:
            left_out.append(LeftOut(path.name, why.problem))
            continue
        found += flights
        left_out += without
    _one_pack(found, series)
    return found, left_out


def _flights(
    path: Path, series: int, capacity_c: float, notes: Notes, battery_id: int | None
) -> tuple[list[FlightData], list[LeftOut]]:
    log = read_log(path)
    wanted = battery_id if battery_id is not None else notes.battery_id
    if wanted is None:
        ids = battery_ids(m for _, m in log.messages)
        wanted = 0 if 0 in ids or not ids else min(ids)
    recording = record(log, wanted, series, capacity_c)
    cuts = [0, *np.searchsorted(recording.time_s, [t for t, _ in recording.pack_changes]), recording.time_s.size]
    parts = [(low, high) for low, high in pairwise(cuts) if high - low > 1]
    found, without = [], []
    for number, (low, high) in enumerate(parts, start=1):
        label = path.name if len(parts) == 1 else f"{path.name} [{number}]"
        # The voltage of the sidecar was taken after the log's last landing.
        own = notes if (low, high) == parts[-1] else replace(notes, rest_voltage_v=None)
        data, why = _flight(recording, low, high, label, own, capacity_c)
        if data is not None:
            _consistent(data, path.name)
            found.append(data)
        if why:
            without.append(LeftOut(label, why))
    return found, without


def _flight(
    recording: Recording, low: int, high: int, label: str, notes: Notes, capacity_c: float
) -> tuple[FlightData | None, str]:
    """A flight, and what was left out and why: all of it where there is none."""
    part = slice(low, high)
    time_s, current = recording.time_s[part], recording.current_a[part]
    if time_s[-1] - time_s[0] < _SHORTEST_S:
        return None, f"lasts {time_s[-1] - time_s[0]:.0f} s only; {_SHORTEST_S:.0f} s are needed"
    known = np.isfinite(current)
    if known.sum() < 2 or np.mean(~known) > _UNUSABLE_SHARE:
        return None, "has no measured current" if not known.any() else "its current is missing in too many samples"
    gap = float(np.max(np.diff(time_s[known])))
    usual = float(np.median(np.diff(time_s)))
    if gap > max(_LONGEST_GAP_S, 15.0 * usual):
        return None, f"its current is not known for {gap:.0f} s"
    volts = without_spikes(recording.voltage_v[part], current)
    partial = of_a_part(volts, current)
    volts[partial] = np.nan
    if not np.isfinite(volts).sum() > 20:
        return None, "has no measured voltage"
    used = float(np.ptp(np.concatenate([[0.0], np.cumsum(np.interp(time_s[1:], time_s[known], current[known])
                                                         * np.diff(time_s))])))  # fmt: skip
    if used < 0.02 * capacity_c:
        return None, f"uses {used / SECONDS_PER_HOUR:.2f} Ah only: nothing of the pack can be seen"
    airborne = np.zeros(recording.time_s.size, dtype=bool)
    for flight in recording.flights:
        airborne[flight.begin : flight.end] = True
    data = FlightData(
        label=label,
        time_s=time_s - time_s[0],
        current_a=np.interp(time_s, time_s[known], current[known]),
        voltage_v=volts,
        temperature_k=_smooth(time_s, recording.temperature_k[part]),
        airborne=airborne[part],
        altitude_m=recording.relative_altitude_m[part],
        climb_mps=recording.climb_mps[part],
        speed_mps=np.where(
            np.isfinite(recording.air_speed_mps[part]), recording.air_speed_mps[part], recording.ground_speed_mps[part]
        ),
        pressure_pa=recording.pressure_pa[part],
        reading=_reading(recording.remaining[part]),
        notes=notes,
        cold_board_k=recording.cold_board_k,
        board_k=recording.board_k[part],
        cells_v=None if recording.cells_v is None else recording.cells_v[part],
    )
    without = [_PARTIAL.format(int(partial.sum()), volts.size)] if partial.any() else []
    seen = before_unseen_landing(time_s[known], current[known])
    if seen < known.sum():
        ended_s, next_s = time_s[known][seen - 1 : seen + 1]
        without.append(_UNSEEN.format(time_s[-1] - ended_s, next_s - ended_s))
        # The voltage rested afterwards is of a charge that nobody knows.
        data = replace(data.part(slice(0, int(np.flatnonzero(known)[seen - 1]) + 1)),
                       notes=replace(notes, rest_voltage_v=None))  # fmt: skip
    return data, "; ".join(without)


def _reading(remaining: Array) -> float | None:
    """What a gauge says at the start. An autopilot that counts from boot says full whatever the pack holds."""
    known = remaining[np.isfinite(remaining)]
    if known.size == 0 or not _GAUGE_LOW < known[0] < _GAUGE_HIGH:
        return None
    return float(known[0])


def _smooth(time_s: Array, kelvin: Array) -> Array | None:
    known = np.isfinite(kelvin)
    if known.mean() < 0.5:
        return None
    filled = np.interp(time_s, time_s[known], kelvin[known])
    if np.ptp(filled) == 0.0:
        return filled
    # Forth and back, so that nothing is delayed: rounding to a degree would otherwise look like steps of resistance.
    step = np.median(np.diff(time_s))
    keep = float(np.exp(-step / _TEMPERATURE_S))
    smooth = filled.copy()
    for direction in (slice(None), slice(None, None, -1)):
        run = smooth[direction]
        level = float(run[: max(int(_TEMPERATURE_S / step), 1)].mean())
        for k in range(run.size):
            level = keep * level + (1.0 - keep) * float(run[k])
            run[k] = level
    return smooth


def _consistent(data: FlightData, name: str) -> None:
    rest = data.notes.rest_voltage_v
    if rest is None:
        return
    last = float(np.nanmedian(data.voltage_v[-5:]))
    if abs(rest - last) > 0.25 * last:
        raise BadInputError(
            f"sidecar, {name}", f"rest_voltage_V = {rest:g}, but the log ends at {last:.2f} V: which pack is it of?"
        )


def _one_pack(flights: Sequence[FlightData], series: int) -> None:
    for data in flights:
        volts = data.voltage_v[np.isfinite(data.voltage_v)]
        low, high = float(np.quantile(volts, 0.05)), float(np.quantile(volts, 0.95))
        if low < _CELL_V[0] * series or not _CHARGED_V * series < high < _CELL_V[1] * series:
            likely = round(high / 4.0)
            raise BadInputError(
                data.label,
                f"its voltage runs from {low:.1f} to {high:.1f} V; the battery file has {series} cells "
                f"({_CELL_V[0] * series:.1f} to {_CELL_V[1] * series:.1f} V), the log looks like {likely}",
                "give the battery file of this pack",
            )
