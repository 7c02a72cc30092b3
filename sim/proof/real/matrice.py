"""Matrice 100 flights in Antarctica: temperature given, withheld, shuffled, and of another vehicle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomlkit

from bhm_service.config import shipped
from sim.proof.cases import write_pack
from sim.proof.real.bench import WARMTH
from sim.proof.real.recordings import Recording, read_flight, write_flight
from sim.proof.scoring.answers import Answer, Criterion, Names

_SERIES, _CAPACITY_AH, _CAPACITY_SD = 6, 5.4, 0.12  # TB47D and TB48D packs mixed: which flew is not recorded
_FEWEST, _FLOWN_S = 20, 200.0
_ACTIVATION = "parameter.resistance-temperature.activation_energy"
_NOTHING: tuple[Names, ...] = (frozenset({"none"}), frozenset({"unknown"}))
Edit = Callable[[list[Recording], np.random.Generator], list[Recording]]


@dataclass(frozen=True, slots=True, kw_only=True)
class MatriceCase:
    """All usable flights, edited, with the generic battery freed of its own temperature effect."""

    name: str
    group: str
    data: Path
    seed: int
    with_temperature: bool
    accept: tuple[Names, ...]
    criteria: tuple[Criterion, ...]
    edit: Edit | None = None
    may_refuse: bool = False

    def __call__(self, folder: Path, held: Path) -> list[Answer]:
        """Write what may be seen."""
        case = folder / self.name
        write_pack(case, _SERIES)
        (case / "flights").mkdir()
        _write_battery(case)
        flights = usable(self.data)
        if self.edit is not None:
            flights = self.edit(flights, np.random.default_rng(self.seed))
        hidden = {}
        for k, recording in enumerate(flights):
            write_flight(case / "flights" / f"{k:02d}.csv", recording, with_temperature=self.with_temperature)
            if not self.with_temperature:
                hidden[f"{k:02d}.csv"] = recording.hidden_temperature
        right = frozenset() if self.accept == _NOTHING else self.accept[0]
        return [
            Answer(
                case=self.name, kind="withheld" if hidden else "control" if not right else "given", group=self.group,
                accept=self.accept, truth=right, hidden=hidden, criteria=self.criteria, may_refuse=self.may_refuse,
            )
        ]  # fmt: skip


def matrice(data: Path, seed: int, names: Sequence[str]) -> list[MatriceCase]:
    """The five cases made of these flights."""
    given, withheld, shuffled, foreign, mixed = names
    ratio = "heldout_ratio"
    named = Criterion("named.resistance-temperature", at_least=1.0)
    gone = Criterion("named.resistance-temperature", at_most=0.0)

    def case(name: str, words: str, seen: bool, accept: tuple[Names, ...], *criteria: Criterion,
             edit: Edit | None = None, may_refuse: bool = False) -> MatriceCase:  # fmt: skip
        return MatriceCase(
            name=name, group=f"Matrice, {words}", data=data, seed=seed, with_temperature=seen, accept=accept,
            criteria=criteria, edit=edit, may_refuse=may_refuse,
        )  # fmt: skip

    return [
        case(given, "temperature given", True, WARMTH[:1] + WARMTH[2:], named, Criterion(ratio, at_most=0.6),
             Criterion(_ACTIVATION, at_least=15.0, at_most=30.0)),
        case(withheld, "temperature withheld", False, WARMTH, Criterion(ratio, at_most=0.75),
             Criterion("listed.self-heating|resistance-temperature", at_least=1.0),
             # Of the warm-up: how warm all flights were together no flight of a pack without a lab tells.
             Criterion("hidden.temperature_K.r", at_least=0.85),
             Criterion("hidden.temperature_K.change_rmse", at_most=4.0)),
        case(shuffled, "temperatures shuffled between flights", True, _NOTHING, gone, edit=temperatures_shuffled),
        case(foreign, "temperatures of the other vehicle", True, _NOTHING, gone, edit=temperatures_of_others),
        case(mixed, "mixed with flights of a 4S quadrotor", True, _NOTHING, gone, edit=Mixed(data), may_refuse=True),
    ]  # fmt: skip


def usable(data: Path) -> list[Recording]:
    """Flights with a temperature, long enough to tell anything."""
    found = [read_flight(path) for path in sorted((data / "flights" / "wadl_m100").glob("*.csv"))]
    return [r for r in found if _flown_s(r) > _FLOWN_S and np.isfinite(r.temperature_c).sum() >= _FEWEST]


def _flown_s(recording: Recording) -> float:
    flying = recording.time_s[recording.armed > 0.5]
    return float(flying[-1] - flying[0]) if flying.size else 0.0


def temperatures_shuffled(flights: list[Recording], dice: np.random.Generator) -> list[Recording]:
    """Each flight with the temperature of another, by time since its beginning."""
    order = dice.permutation(len(flights))
    while np.any(order == np.arange(len(flights))):
        order = dice.permutation(len(flights))
    return [_with_temperature_of(flights[k], flights[other]) for k, other in enumerate(order)]


def temperatures_of_others(flights: list[Recording], dice: np.random.Generator) -> list[Recording]:
    """Each flight with the temperature of a flight of another vehicle."""
    found = []
    for flight in flights:
        others = [f for f in flights if _vehicle(f) != _vehicle(flight)]
        found.append(_with_temperature_of(flight, others[int(dice.integers(len(others)))]))
    return found


@dataclass(frozen=True, slots=True)
class Mixed:
    """Half the flights are of another vehicle with another pack."""

    data: Path

    def __call__(self, flights: list[Recording], dice: np.random.Generator) -> list[Recording]:
        quad = sorted((self.data / "flights" / "acuasi_quad").glob("*_tlog.csv"))
        others = [read_flight(path) for path in quad]
        ours = [flights[k] for k in dice.permutation(len(flights))[: len(others)]]
        both = ours + others
        return [both[k] for k in dice.permutation(len(both))]


def _with_temperature_of(flight: Recording, other: Recording) -> Recording:
    known = np.isfinite(other.temperature_c)
    moved = np.interp(flight.time_s, other.time_s[known], other.temperature_c[known])
    return replace(flight, temperature_c=np.round(moved, 2))


def _vehicle(flight: Recording) -> str:
    return flight.name.split("_")[0]


def _write_battery(case: Path) -> None:
    """The battery that ships, without what it knows of temperature, and a vehicle of this pack."""
    battery = tomlkit.parse(shipped("batteries", "generic-lipo.toml").read_text())
    kept = tomlkit.aot()
    for effect in battery.get("effect", []):
        if effect["id"] != "resistance-temperature":
            kept.append(effect)
    battery.pop("effect", None)
    if kept:
        battery["effect"] = kept
    (case / "battery.toml").write_text(tomlkit.dumps(battery))
    vehicle = {
        "name": "Matrice 100",
        "battery": {
            "file": "battery.toml",
            "series": _SERIES,
            "capacity_ah": _CAPACITY_AH,
            "capacity_sd": _CAPACITY_SD,
        },
    }
    (case / "vehicle.toml").write_text(tomlkit.dumps(vehicle))
