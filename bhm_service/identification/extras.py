"""Effects that are identified with a cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np

from bhm_service.battery.battery_file import Joined, ModelName
from bhm_service.battery.effects import (
    DoubleLayer,
    Effect,
    FullChargeResistance,
    GraphiteLag,
    ResistanceTemperature,
    SlowDiffusion,
    SurfaceLag,
)
from bhm_service.battery.parameters import parameters_of
from bhm_service.identification.unknowns import Block, numbers, positive
from bhm_service.units import Array

OHM_C = 0.025  # [V] that a LiPo cell drops at 1C


@dataclass(frozen=True, slots=True)
class Part:
    """An effect, and the unknowns that its parameters are, by the parameters' names."""

    joins: str  # the flag of `Extras`
    effect: type[Effect]
    unknowns: Mapping[str, str]
    unit: float = 1.0  # in which they are looked for, in SI

    def of(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Its parameters in SI, out of something of each unknown."""
        return {name: self.unit * values[unknown] for name, unknown in self.unknowns.items()}


PARTS: Final = (
    Part("temperature", ResistanceTemperature, {"activation_energy": "activation_energy"}, unit=1e3),  # in kJ/mol
    Part("slow", SlowDiffusion, {"resistance": "slow_resistance", "time_constant": "slow_time"}),
    Part("slower", SlowDiffusion, {"resistance": "slower_resistance", "time_constant": "slower_time"}),
    Part("full", FullChargeResistance, {"resistance": "full_resistance", "width": "full_width"}),
    Part("fast", DoubleLayer, {"exchange_current": "fast_current", "time_constant": "fast_time"}),
    Part(
        "graphite",
        GraphiteLag,
        {
            "time_constant": "graphite_time",
            "steepness": "graphite_steepness",
            "share": "graphite_share",
            "empty": "graphite_empty",
            "full": "graphite_full",
        },
    ),
    Part("surface", SurfaceLag, {"time_constant": "surface_time", "share": "surface_share"}),
)
"""In the order of their states in a pack; `CircFamily` reads those of the last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Extras:
    """Effects that are identified with the cell."""

    temperature: bool = False
    slow: bool = False
    slower: bool = False  # a second pair: diffusion lasts from seconds to an hour
    full: bool = False  # resistance that grows towards full charge
    fast: bool = False  # charge transfer within seconds
    graphite: bool = False  # lithium that lags at the surface of graphite
    surface: bool = False  # charge that lags at the particles' surface
    names: ClassVar[tuple[str, ...]] = tuple(name for part in PARTS for name in part.unknowns.values())

    @property
    def _parts(self) -> list[Part]:
        return [part for part in PARTS if getattr(self, part.joins)]

    def blocks(self, ohm: float) -> list[Block]:
        """Their unknowns; ``ohm`` is the size of the cell's resistance."""
        rate = OHM_C / ohm
        found = []
        if self.temperature:
            found.append(_as_declared(ResistanceTemperature, "activation_energy"))
        if self.slow:
            found.append(positive("slow_resistance", 0.5 * ohm, 1e-3 * ohm, 10.0 * ohm, 4.0))
            found.append(positive("slow_time", 200.0, 15.0, 5000.0, 3.0))
        if self.slower:
            found.append(positive("slower_resistance", 0.5 * ohm, 1e-3 * ohm, 10.0 * ohm, 4.0))
            found.append(positive("slower_time", 1000.0, 15.0, 20000.0, 3.0))
        if self.full:
            found.append(positive("full_resistance", 0.2 * ohm, 1e-3 * ohm, 10.0 * ohm, 4.0))
            found.append(positive("full_width", 0.1, 0.01, 5.0, 4.0))
        if self.fast:
            found.append(positive("fast_current", 2.0 * rate, 0.02 * rate, 500.0 * rate, 6.0))
            found.append(positive("fast_time", 1.0, 0.05, 10.0, 3.0))
        if self.graphite:
            found.append(positive("graphite_time", 200.0, 2.0, 2e4, 4.0))
            found.append(positive("graphite_share", 1.0, 0.01, 8.0, 2.0))
            found += [_as_declared(GraphiteLag, name, "graphite_") for name in ("steepness", "empty", "full")]
        if self.surface:
            found.append(positive("surface_time", 60.0, 2.0, 3000.0, 3.0))
            found.append(positive("surface_share", 0.5, 1e-3, 5.0, 3.0))
        return found

    def effects(self, values: Mapping[str, Array]) -> list[Effect]:
        """The effects of a set of values."""
        return [part.effect(**part.of(values)) for part in self._parts]

    def joined(self, model: ModelName, values: Mapping[str, Array], sd: Mapping[str, float]) -> tuple[Joined, ...]:
        """The effects of one set of values, as the battery file holds them."""
        one = {name: float(values[name].ravel()[0]) for part in self._parts for name in part.unknowns.values()}
        return tuple(Joined(effect=part.effect(**part.of(one)), model=model, sd=part.of(sd)) for part in self._parts)


def _as_declared(effect: type[Effect], name: str, prefix: str = "") -> Block:
    """A number of an effect with the range and the prior that the effect declares, in its unit; named with a prefix."""
    (told,) = (p for p in parameters_of(effect) if p.name == name)
    assert told.prior is not None
    mean, sd = told.prior
    return replace(
        numbers(prefix + name, np.array([mean]), sd, np.inf), low=np.array([told.low]), high=np.array([told.high])
    )
