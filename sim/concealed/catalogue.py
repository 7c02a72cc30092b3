"""The effects that a world can carry: what each turns, how much, and which names are right for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from sim.concealed.knobs import Knobs
from sim.concealed.packs import Array, Pack
from sim.concealed.sheets import CaseSheet


@dataclass(slots=True)
class Scene:
    """A case while effects are laid on it."""

    pack: Pack
    sheet: CaseSheet
    rng: np.random.Generator
    knobs: Knobs
    cycles: Array | None = None  # (F,) charge cycles of the pack at each flight
    storage_days: Array | None = None
    parameters: dict[str, dict[str, float | str]] = field(default_factory=dict)  # of the effect being laid
    accept: tuple[str, ...] | None = None  # where it is not the kind's own
    permitted: list[str] = field(default_factory=list)  # true besides: what the effect brings with it
    change_points: list[tuple[int, float]] = field(default_factory=list)  # flight, seconds in its log

    @property
    def flights(self) -> int:
        """How many."""
        return self.sheet.flights

    def tell(self, name: str, value: float, unit: str) -> None:
        """A true size, for the answer."""
        self.parameters[name] = {"value": float(value), "unit": unit}

    def cells(self, **changes: object) -> None:
        """Turn knobs of the cells."""
        self.knobs = replace(self.knobs, cells=replace(self.knobs.cells, **changes))  # type: ignore[arg-type]

    def heat(self, **changes: object) -> None:
        """Turn knobs of the temperatures."""
        self.knobs = replace(self.knobs, heat=replace(self.knobs.heat, **changes))  # type: ignore[arg-type]

    def sensors(self, **changes: object) -> None:
        """Turn knobs of the sensors."""
        self.knobs = replace(self.knobs, sensors=replace(self.knobs.sensors, **changes))  # type: ignore[arg-type]

    def demand(self, **changes: object) -> None:
        """Turn knobs of the vehicle and its flights."""
        self.knobs = replace(self.knobs, demand=replace(self.knobs.demand, **changes))  # type: ignore[arg-type]

    def shuffled(self, low: float, high: float) -> Array:
        """Evenly spread values in a random order (F,)."""
        return self.rng.permutation(np.linspace(low, high, self.flights))

    def sign(self) -> float:
        """Plus or minus one."""
        return float(self.rng.choice([-1.0, 1.0]))


Lay: TypeAlias = Callable[[Scene, float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectKind:
    """One effect: its three sizes in its own unit, and the names that are right for it by themselves."""

    name: str
    sizes: tuple[float, float, float]
    lay: Lay
    accept: tuple[str, ...] = ()  # its own name where empty
    channel: str = "voltage"  # or "power": where it shows
    term: str | None = None  # of the demand, that a twin without the effect lacks
    twins_fly_it: bool = False  # its flights are flown without it too: what is concealed is a term of physics
    needs_temperature: bool = False

    @property
    def accepted(self) -> tuple[str, ...]:
        """Right names."""
        return self.accept or (self.name,)
