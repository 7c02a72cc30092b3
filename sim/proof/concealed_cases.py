"""The concealed world as suites: its sheets drawn, one flight of each case kept back, its truth put as an answer.

The world names its true sizes in its own words; what can be compared with a parameter of the catalogue is translated
here, and only here.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sim.concealed.answer import Answer as Truth
from sim.concealed.answer import TrueFlight
from sim.concealed.generate import generate
from sim.concealed.sheets import CaseSheet
from sim.concealed.suites import draw_suite
from sim.proof.cases import Batch, write_pack
from sim.proof.scoring.answers import Answer, Moment, Quantity, Series
from sim.proof.scoring.names import NONE
from sim.proof.shared_cases import first_stamp_s

_SERIES = 6
_ZERO_CELSIUS_K = 273.15


def _as_it_is(value: float) -> float:
    return value


def _times(factor: float) -> Callable[[float], float]:
    return lambda value: factor * value


_TRANSLATED: Mapping[str, Mapping[str, tuple[str, str, Callable[[float], float]]]] = {
    "resistance-temperature": {"activation_energy": ("activation_energy", "kJ/mol", _as_it_is)},
    "capacity-fade": {"capacity_lost": ("fade", "1", _as_it_is)},
    "resistance-growth": {"growth": ("growth", "1", _as_it_is)},
    "cold-capacity": {"per_kelvin": ("per_kelvin", "%/K", _times(100.0))},
    "hysteresis": {"half_loop": ("amplitude", "mV", _as_it_is)},
    "contact-resistance": {"resistance": ("resistance", "mohm", _times(1e3))},
    "intermittent-contact": {"resistance": ("resistance", "mohm", _times(1e3))},
    "weak-cell": {"capacity_lost": ("loss", "1", _as_it_is)},
    "self-discharge": {"per_day": ("rate", "%/day", _times(100.0))},
    "rate-capacity": {"exponent": ("exponent", "1", _as_it_is)},
    "unseen-load": {"current": ("current", "A", _as_it_is)},
    "current-offset": {"offset": ("offset", "A", _times(-1.0))},
    "current-gain": {"gain": ("gain", "1", lambda read_of_true: 1.0 / read_of_true - 1.0)},
    "voltage-gain": {"gain": ("gain", "1", lambda read_of_true: read_of_true - 1.0)},
    "voltage-offset": {"offset": ("offset", "V", _as_it_is)},
    "payload-mass": {"payload": ("payload", "1", _as_it_is)},
    "propulsion-efficiency": {"lost": ("loss", "1", _as_it_is)},
    "time-skew": {"lag": ("skew", "s", _times(-1.0))},
}
"""World's effect and size: the catalogue's parameter, its unit, and how one becomes the other."""


@dataclass(frozen=True, slots=True)
class ConcealedCase:
    """A sheet with one flight more than is shown."""

    sheet: CaseSheet
    held: int  # which flight nobody is shown

    def __call__(self, folder: Path, held: Path) -> list[Answer]:
        """Make the case, keep a flight back, and return the answer."""
        truth = generate(self.sheet, folder / self.sheet.name)
        case = folder / self.sheet.name
        write_pack(case, _SERIES)
        flights = case / "flights"
        starts = {flight.file: first_stamp_s(flights / flight.file) for flight in truth.flights}
        kept = truth.flights[self.held]
        (held / truth.case).mkdir(parents=True)
        shutil.move(flights / kept.file, held / truth.case / kept.file)
        _without_line(flights / "flights.csv", kept.file)
        return [answer_of(truth, self.held, starts)]


def concealed(name: str, seed: int, cases: int) -> list[Batch]:
    """A suite of the concealed world.

    Kept back is the flight that comes next: a repaired battery is that of the pack as it is by now. On a flight from
    before it aged, or before a contact went bad, it would be wrong where it is right.
    """
    return [
        ConcealedCase(replace(sheet, flights=sheet.flights + 1, kept_back=sheet.flights), sheet.flights)
        for sheet in draw_suite(name, seed, cases)
    ]


def answer_of(truth: Truth, held: int, starts_s: Mapping[str, float]) -> Answer:
    """A truth as an answer about the flights that are shown."""
    shown = [flight for k, flight in enumerate(truth.flights) if k != held]
    empty = truth.flights[held]
    hides_temperature = "temperature" in truth.withheld
    accept = tuple(frozenset(entry.split("+")) for entry in truth.accept)
    return Answer(
        case=truth.case,
        kind=truth.kind,
        group=f"{truth.world}, {truth.noise}",
        accept=accept,
        truth=frozenset() if accept == (frozenset({NONE}),) else frozenset(e.name for e in truth.effects),
        ambiguous=truth.kind == "ambiguous",
        snr=min((e.snr for e in truth.effects), default=None),
        parameters=_parameters(truth),
        change_points=tuple(
            Moment(truth.flights[k].file, at_s) for k, at_s in truth.change_points if k != held and at_s > 0.0
        ),
        samples={flight.file: _samples(truth, flight) for flight in shown} if truth.effects else {},
        hidden={flight.file: _core(flight) for flight in shown} if hides_temperature and truth.effects else {},
        starts_s={flight.file: starts_s[flight.file] for flight in shown},
        permitted=frozenset(truth.permitted),
        held=_end_of(empty),
        note="; ".join(f"{e.name} ({e.size})" for e in truth.effects),
    )


def _parameters(truth: Truth) -> dict[str, dict[str, Quantity]]:
    found: dict[str, dict[str, Quantity]] = {}
    for effect in truth.effects:
        for name, (ours, unit, become) in _TRANSLATED.get(effect.name, {}).items():
            if name in effect.parameters:
                value = become(float(effect.parameters[name]["value"]))
                found.setdefault(effect.name, {})[ours] = Quantity(value, unit)
    return found


def _end_of(flight: TrueFlight) -> dict[str, float]:
    """When a flight that nobody is shown would have ended; nothing in a world that cannot tell its last voltages."""
    ends = min(flight.empty_soc_s, flight.empty_voltage_s)
    return {flight.file: ends} if np.isfinite(flight.empty_voltage_s) else {}


def _times_of(flight: TrueFlight) -> np.ndarray:
    return np.arange(len(flight.soc)) * flight.every_s


def _core(flight: TrueFlight) -> Series:
    kelvin = np.array(flight.core_c) + _ZERO_CELSIUS_K
    return {"time_s": tuple(_times_of(flight).tolist()), "temperature_K": tuple(kelvin.tolist())}


def _samples(truth: Truth, flight: TrueFlight) -> Series:
    """Where any of the effects acts in one flight, every half minute."""
    t = _times_of(flight)
    number = truth.flights.index(flight)
    affected = np.zeros(t.size)
    for effect in truth.effects:
        for regime in effect.regimes:
            if regime.flight == number:
                affected[(t >= regime.start_s) & (t <= regime.end_s)] = 1.0
    return {
        "since_takeoff_s": tuple((t - flight.takeoff_s).tolist()),
        "soc": flight.soc,
        "temperature_C": flight.surface_c,
        "affected": tuple(affected.tolist()),
    }


def _without_line(sidecar: Path, file: str) -> None:
    with sidecar.open(newline="") as stream:
        rows = [row for row in csv.reader(stream) if row and row[0] != file]
    with sidecar.open("w", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows(rows)
