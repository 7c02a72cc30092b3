"""What is ordered of the world: one sheet for each case."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

Size: TypeAlias = Literal["small", "medium", "large"]
Kind: TypeAlias = Literal["null", "single", "pair", "triple", "outside", "ambiguous", "decoy"]
Noise: TypeAlias = Literal["plain", "heavy-tails", "other-colour", "wrong-ocv", "logging-faults"]
World: TypeAlias = Literal["ladder", "porous"]
_OF_PACK = ("pack", "porous", "lab")  # purposes: what two cases of one pack share
SIZES: tuple[Size, ...] = ("small", "medium", "large")
NOISES: tuple[Noise, ...] = ("plain", "heavy-tails", "other-colour", "wrong-ocv", "logging-faults")


@dataclass(frozen=True, slots=True)
class EffectSheet:
    """An effect of the catalogue (or outside it), and how much of it."""

    name: str
    size: Size


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseSheet:
    """One case; everything else about it is drawn from (suite, seed, index)."""

    suite: str
    seed: int
    index: int
    kind: Kind
    effects: tuple[EffectSheet, ...] = ()
    noise: Noise = "plain"
    rich: bool = True  # deep flights, climbs, ages; else one kind of flight again and again
    temperature_recorded: bool = True
    ages_recorded: bool = True  # charge cycles and days of storage stand in the sidecar
    boxed: bool = False  # the recorded temperature is not that of the cells, which are kept at 25 degC
    decoys: int = 0  # columns that trend with the flights and mean nothing
    cells_recorded: bool = False
    flights: int = 6
    kept_back: int | None = None  # a flight that the tool will not be shown: it counts for no SNR
    world: World = "ladder"
    pack: int | None = None  # which pack of the suite flies, and with it its bench; None: one of its own

    @property
    def name(self) -> str:
        """Of the case's directory: it tells nothing of what is inside."""
        return f"{self.suite}-{self.index:04d}"

    @property
    def shown(self) -> list[int]:
        """The flights that the tool is shown."""
        return [f for f in range(self.flights) if f != self.kept_back]

    def generator(self, purpose: str) -> np.random.Generator:
        """Random numbers for one purpose: a change in one does not move the others."""
        words = [zlib.crc32(text.encode()) for text in (self.suite, purpose)]
        number = self.pack if self.pack is not None and purpose in _OF_PACK else self.index
        return np.random.default_rng([self.seed, number, *words])
