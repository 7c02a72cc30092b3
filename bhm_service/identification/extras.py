"""Effects that are identified with a cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from bhm_service.battery.battery_file import Joined, ModelName
from bhm_service.battery.effects import (
    DoubleLayer,
    Effect,
    FullChargeResistance,
    ResistanceTemperature,
    SlowDiffusion,
    SurfaceLag,
)
from bhm_service.battery.parameters import parameters_of
from bhm_service.identification.unknowns import Block, numbers, positive
from bhm_service.units import Array

OHM_C = 0.025  # [V] that a LiPo cell drops at 1C
_KILO = 1e3  # an activation energy is looked for in kJ/mol


@dataclass(frozen=True, slots=True, kw_only=True)
class Extras:
    """Effects that are identified with the cell."""

    temperature: bool = False
    slow: bool = False
    slower: bool = False  # a second pair: diffusion lasts from seconds to an hour
    full: bool = False  # resistance that grows towards full charge
    fast: bool = False  # charge transfer within seconds
    surface: bool = False  # charge that lags at the particles' surface
    names: ClassVar[tuple[str, ...]] = (
        "activation_energy", "slow_resistance", "slow_time", "slower_resistance", "slower_time",
        "full_resistance", "full_width", "fast_current", "fast_time",
        "surface_time", "surface_share",
    )  # fmt: skip

    @property
    def _pairs(self) -> list[str]:
        return [name for name, joins in (("slow", self.slow), ("slower", self.slower)) if joins]

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
        if self.surface:
            found.append(positive("surface_time", 60.0, 2.0, 3000.0, 3.0))
            found.append(positive("surface_share", 0.5, 1e-3, 5.0, 3.0))
        return found

    def effects(self, values: Mapping[str, Array]) -> list[Effect]:
        """The effects of a set of values."""
        found: list[Effect] = []
        if self.temperature:
            found.append(ResistanceTemperature(activation_energy=_KILO * values["activation_energy"]))
        found.extend(
            SlowDiffusion(resistance=values[f"{pair}_resistance"], time_constant=values[f"{pair}_time"])
            for pair in self._pairs
        )
        if self.full:
            found.append(FullChargeResistance(resistance=values["full_resistance"], width=values["full_width"]))
        if self.fast:
            found.append(DoubleLayer(exchange_current=values["fast_current"], time_constant=values["fast_time"]))
        if self.surface:  # last: `CircFamily` reads its states
            found.append(SurfaceLag(time_constant=values["surface_time"], share=values["surface_share"]))
        return found

    def joined(self, model: ModelName, values: Mapping[str, Array], sd: Mapping[str, float]) -> tuple[Joined, ...]:
        """The effects of one set of values, as the battery file holds them."""
        found = []
        if self.temperature:
            effect: Effect = ResistanceTemperature(activation_energy=_KILO * _one(values["activation_energy"]))
            spread = {"activation_energy": _KILO * sd["activation_energy"]}
            found.append(Joined(effect=effect, model=model, sd=spread))
        for pair in self._pairs:
            resistance, time = f"{pair}_resistance", f"{pair}_time"
            effect = SlowDiffusion(resistance=_one(values[resistance]), time_constant=_one(values[time]))
            spread = {"resistance": sd[resistance], "time_constant": sd[time]}
            found.append(Joined(effect=effect, model=model, sd=spread))
        if self.full:
            effect = FullChargeResistance(resistance=_one(values["full_resistance"]), width=_one(values["full_width"]))
            spread = {"resistance": sd["full_resistance"], "width": sd["full_width"]}
            found.append(Joined(effect=effect, model=model, sd=spread))
        if self.fast:
            effect = DoubleLayer(exchange_current=_one(values["fast_current"]), time_constant=_one(values["fast_time"]))
            spread = {"exchange_current": sd["fast_current"], "time_constant": sd["fast_time"]}
            found.append(Joined(effect=effect, model=model, sd=spread))
        if self.surface:
            effect = SurfaceLag(time_constant=_one(values["surface_time"]), share=_one(values["surface_share"]))
            spread = {"time_constant": sd["surface_time"], "share": sd["surface_share"]}
            found.append(Joined(effect=effect, model=model, sd=spread))
        return tuple(found)


def _as_declared(effect: type[Effect], name: str) -> Block:
    """A number of an effect with the range and the prior that the effect declares, in its unit."""
    (told,) = (p for p in parameters_of(effect) if p.name == name)
    assert told.prior is not None
    mean, sd = told.prior
    return replace(numbers(name, np.array([mean]), sd, np.inf), low=np.array([told.low]), high=np.array([told.high]))


def _one(values: Array) -> float:
    return float(values.ravel()[0])
