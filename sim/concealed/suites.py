"""Suites: which cases an examination is made of. A suite and a seed give the same sheets on any machine."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle, islice

import numpy as np

from sim.concealed.generate import CATALOGUE, OUTSIDE
from sim.concealed.sheets import NOISES, SIZES, CaseSheet, EffectSheet, Kind

SUITES = {"quick": 10, "development": 120, "exam": 304, "truth": 44}
_PACKS_SHARED = ("exam", "truth", "quick")  # where time is short: an hour, or a part of `make test`
# Shares of a full examination; nulls come to 0.34.
_SHARES: dict[Kind, float] = {
    "null": 0.34,
    "single": 0.33,
    "pair": 0.10,
    "triple": 0.03,
    "outside": 0.08,
    "ambiguous": 0.06,
    "decoy": 0.06,
}
PAIRS = (
    ("resistance-temperature", "contact-resistance"),
    ("resistance-temperature", "capacity-fade"),
    ("resistance-temperature", "resistance-growth"),
    ("resistance-temperature", "partial-charge"),
    ("resistance-temperature", "unseen-load"),
    ("resistance-temperature", "weak-cell"),
    ("resistance-temperature", "time-skew"),
    ("resistance-temperature", "payload-mass"),
    ("capacity-fade", "resistance-growth"),
    ("capacity-fade", "voltage-offset"),
    ("partial-charge", "contact-resistance"),
    ("partial-charge", "slow-diffusion"),
    ("slow-diffusion", "capacity-fade"),
    ("time-skew", "capacity-fade"),
    ("charge-transfer", "capacity-fade"),
    ("intermittent-contact", "capacity-fade"),
    ("air-density", "contact-resistance"),
)
TRIPLES = (
    ("resistance-temperature", "capacity-fade", "contact-resistance"),
    ("resistance-temperature", "partial-charge", "contact-resistance"),
    ("capacity-fade", "resistance-growth", "payload-mass"),
    ("slow-diffusion", "partial-charge", "time-skew"),
)
AMBIGUOUS = ("unseen-load", "current-offset", "voltage-gain", "voltage-offset", "self-heating", "propulsion-efficiency")
# What the second world can carry.
POROUS = (
    "resistance-temperature",
    "self-heating",
    "capacity-fade",
    "contact-resistance",
    "charge-transfer",
    "weak-cell",
    "partial-charge",
    "unseen-load",
    "current-gain",
    "voltage-offset",
    "time-skew",
    "intermittent-contact",
    "slow-diffusion",
    "hysteresis",
)


def _of_kind(kind: Kind, count: int, rng: np.random.Generator) -> Iterator[CaseSheet]:
    """Sheets of one kind, sizes and effects in turn so that a suite holds as many of each."""
    blank = CaseSheet(suite="", seed=0, index=0, kind=kind)
    if kind == "null":
        # Half of them are plain, half are off in one way each.
        noises = cycle([noise for odd in NOISES[1:] for noise in ("plain", odd)])
        for number, noise in enumerate(islice(noises, count)):
            yield replace(blank, noise=noise, rich=number % 4 < 2, temperature_recorded=number % 8 < 5)
    elif kind == "decoy":
        singles = cycle(["", "capacity-fade", "", "contact-resistance", "", "partial-charge"])
        for number, name in enumerate(islice(singles, count)):
            carried = (EffectSheet(name, "medium"),) if name else ()
            yield replace(blank, effects=carried, decoys=3, boxed=number % 4 == 0)
    elif kind in ("pair", "triple"):
        combinations = PAIRS if kind == "pair" else TRIPLES
        order = rng.permutation(len(combinations))
        for index in islice(cycle(order.tolist()), count):
            effects = tuple(EffectSheet(n, SIZES[int(rng.integers(1, 3))]) for n in combinations[index])
            yield replace(blank, effects=effects)
    elif kind == "ambiguous":
        for name in islice(cycle(AMBIGUOUS), count):
            sheet = replace(blank, effects=(EffectSheet(name, "large"),), rich=False, ages_recorded=False)
            yield replace(sheet, temperature_recorded=name != "self-heating")
    else:
        names = list(CATALOGUE if kind == "single" else OUTSIDE)
        order = rng.permutation(len(names))
        # Every size in every round: the beginning of a suite is a fair sample of it.
        sizes = rng.permutation(3).tolist()
        rounds = [(names[k], SIZES[sizes[(of + turn) % 3]]) for turn in range(3) for of, k in enumerate(order)]
        for number, (name, size) in enumerate(islice(cycle(rounds), count)):
            warm = (number % 3 != 0) or (name in CATALOGUE and CATALOGUE[name].needs_temperature)
            # A core's lag shows only where the pack's temperature matters at all.
            beside = (EffectSheet("resistance-temperature", "large"),) if name == "core-lag" else ()
            yield replace(
                blank,
                effects=(*beside, EffectSheet(name, size)),
                rich=(number + _offset(name)) % 3 != 0,
                temperature_recorded=warm,
                ages_recorded=number % 5 != 0,
                cells_recorded=number % 6 == 0,
            )


def _offset(name: str) -> int:
    """A fixed number for a name."""
    return zlib.crc32(name.encode()) % 3


def draw_suite(name: str, seed: int, count: int | None = None) -> list[CaseSheet]:
    """Sheets of a suite, kinds mixed so that any beginning is a fair sample. Raises KeyError for an unknown suite."""
    count = SUITES[name] if count is None else count
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    shares = dict(_SHARES)
    if name == "truth":
        shares = {"null": 0.30, "single": 0.60, "pair": 0.10}
    counts = {kind: int(np.floor(share * count)) for kind, share in shares.items()}
    for kind in islice(cycle(shares), count - sum(counts.values())):
        counts[kind] += 1
    sheets = [sheet for kind, number in counts.items() for sheet in _of_kind(kind, number, rng)]
    if name == "truth":
        sheets = [_porous(sheet, number) for number, sheet in enumerate(sheets)]
    order = rng.permutation(len(sheets))
    drawn = [replace(sheets[k], suite=name, seed=seed, index=place) for place, k in enumerate(order.tolist())]
    return _on_packs(drawn) if name in _PACKS_SHARED else drawn


def _on_packs(sheets: list[CaseSheet]) -> list[CaseSheet]:
    """Two cases to each pack: half the bench work. No two nulls have one, so that their errors are independent."""
    packs = -(-len(sheets) // 2)
    order = sorted(range(len(sheets)), key=lambda k: sheets[k].kind != "null")
    of = {k: number % packs for number, k in enumerate(order)}
    return [replace(sheet, pack=of[k]) for k, sheet in enumerate(sheets)]


def _porous(sheet: CaseSheet, number: int) -> CaseSheet:
    effects = sheet.effects
    if sheet.kind == "single":
        effects = (EffectSheet(POROUS[number % len(POROUS)], SIZES[1 + number // len(POROUS) % 2]),)
    elif sheet.kind == "pair":
        effects = (EffectSheet("resistance-temperature", "large"), EffectSheet("contact-resistance", "large"))
    return replace(sheet, effects=effects, world="porous", temperature_recorded=number % 3 != 0, cells_recorded=False)
