"""What is true of a case: kept apart from it, for the scoring."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

CLASSES = ((15.0, "> 15"), (5.0, "5-15"), (3.0, "3-5"), (0.0, "< 3"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Regime:
    """Where an effect moves a recorded channel by a standard deviation of its noise (if ever it does so much)."""

    flight: int
    start_s: float  # since the log's first message
    end_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueEffect:
    """One effect."""

    name: str
    size: str
    channel: str  # "voltage" or "power"
    in_catalogue: bool
    parameters: dict[str, dict[str, float | str]]  # name: value and unit
    snr: float  # of this effect alone, the others known
    regimes: tuple[Regime, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueFlight:
    """One flight; times since the log's first message."""

    file: str
    takeoff_s: float
    landing_s: float
    rest_voltage_v: float
    every_s: float
    soc: tuple[float, ...]
    core_c: tuple[float, ...]
    surface_c: tuple[float, ...]
    empty_soc_s: float  # 20 % of what the lab takes out would be left, had it gone on at its mean power
    empty_voltage_s: float  # a cell would fall to 3.3 V
    parameters: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The whole truth of a case."""

    case: str
    suite: str
    seed: int
    index: int
    kind: str
    world: str
    noise: str
    rich: bool
    pack: dict[str, float | str]
    effects: tuple[TrueEffect, ...]
    accept: tuple[str, ...]  # right answers: names joined by '+', in any order; 'none' for a null, 'unknown' for a rest
    permitted: tuple[str, ...]  # true of this world though not concealed: naming them as well is no error
    change_points: tuple[tuple[int, float], ...]  # flight, seconds; 0 = from that flight's start on
    snr: float  # of all effects together, in the channel where they show best
    snr_class: str
    decoys: tuple[str, ...]
    withheld: tuple[str, ...]
    flights: tuple[TrueFlight, ...] = field(repr=False)

    def as_json(self) -> str:
        """For a file."""
        return json.dumps(asdict(self), indent=1)

    @classmethod
    def from_json(cls, text: str) -> Answer:
        """Back from a file."""
        raw: dict[str, Any] = json.loads(text)
        effects = tuple(
            TrueEffect(**{**e, "regimes": tuple(Regime(**r) for r in e["regimes"])}) for e in raw.pop("effects")
        )
        series = ("soc", "core_c", "surface_c")
        flights = tuple(TrueFlight(**{**f, **{s: tuple(f[s]) for s in series}}) for f in raw.pop("flights"))
        for name in ("accept", "permitted", "decoys", "withheld"):
            raw[name] = tuple(raw[name])
        points = tuple((int(f), float(s)) for f, s in raw.pop("change_points"))
        return cls(effects=effects, flights=flights, change_points=points, **raw)


def snr_class(snr: float) -> str:
    """The class that scores are grouped by."""
    return next(name for least, name in CLASSES if snr >= least)
