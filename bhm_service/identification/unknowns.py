"""What a fit looks for: named blocks of numbers in one vector, each with its range and what was known before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bhm_service.units import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Some unknowns of one kind, in the fit's own numbers: logarithms where ``log``."""

    name: str
    start: Array
    low: Array
    high: Array
    prior: Array  # mean
    sd: Array  # of the prior; infinite where nothing was known
    log: bool = False
    series: bool = False  # numbers of one kind that stand for a curve only together

    @property
    def size(self) -> int:
        return int(self.start.size)

    def outer(self, numbers: Array) -> Array:
        """What the numbers of the fit (..., size) stand for."""
        return np.exp(numbers) if self.log else numbers


def positive(name: str, start: float, low: float, high: float, factor: float) -> Block:
    """A positive number that is known to within a ``factor`` (one standard deviation)."""
    at = np.log(np.clip(start, low * 1.0001, high * 0.9999))
    return Block(
        name=name,
        start=np.array([at]),
        low=np.array([np.log(low)]),
        high=np.array([np.log(high)]),
        prior=np.array([at]),
        sd=np.array([np.log(factor)]),
        log=True,
    )


def numbers(name: str, prior: Array, sd: float | Array, reach: float | Array) -> Block:
    """Numbers near a prior."""
    prior = np.asarray(prior, dtype=float)
    return Block(
        name=name,
        start=prior.copy(),
        low=prior - reach,
        high=prior + reach,
        prior=prior,
        sd=np.broadcast_to(sd, prior.shape),
    )


@dataclass(frozen=True)
class Unknowns:
    """All blocks of a fit."""

    blocks: tuple[Block, ...]

    @property
    def start(self) -> Array:
        return np.concatenate([b.start for b in self.blocks])

    @cached_property
    def low(self) -> Array:
        return np.concatenate([b.low for b in self.blocks])

    @cached_property
    def high(self) -> Array:
        return np.concatenate([b.high for b in self.blocks])

    @cached_property
    def _prior(self) -> Array:
        return np.concatenate([b.prior for b in self.blocks])

    @cached_property
    def _sd(self) -> Array:
        return np.concatenate([b.sd for b in self.blocks])

    @cached_property
    def names(self) -> list[str]:
        """One name for every number."""
        return [b.name if b.size == 1 else f"{b.name}[{k}]" for b in self.blocks for k in range(b.size)]

    def values(self, x: Array) -> dict[str, Array]:
        """Blocks of vectors (M, n) by name, each (M, size), in their own units."""
        x = np.atleast_2d(x)
        found: dict[str, Array] = {}
        at = 0
        for block in self.blocks:
            found[block.name] = block.outer(x[:, at : at + block.size])
            at += block.size
        return found

    def pulls(self, x: Array) -> Array:
        """How far vectors (M, n) are from what was known before, in its standard deviations."""
        pulls: Array = (np.atleast_2d(x) - self._prior) / self._sd
        return pulls

    def slice_of(self, name: str) -> slice:
        """Where a block stands in the vector."""
        at = 0
        for block in self.blocks:
            if block.name == name:
                return slice(at, at + block.size)
            at += block.size
        raise KeyError(name)

    def started_at(self, values: Mapping[str, float | Array]) -> Unknowns:
        """The same with other starts, given in their own units; priors stay."""
        blocks: list[Block] = []
        for block in self.blocks:
            if block.name in values:
                value = np.atleast_1d(np.asarray(values[block.name], dtype=float))
                inner = np.log(value) if block.log else value
                inside = np.clip(inner, block.low + 1e-9 * (block.high - block.low), block.high)
                block = Block(
                    name=block.name, start=inside, low=block.low, high=block.high, prior=block.prior, sd=block.sd,
                    log=block.log,
                )  # fmt: skip
            blocks.append(block)
        return Unknowns(tuple(blocks))


def joined(*groups: Sequence[Block]) -> Unknowns:
    """Groups of blocks as one."""
    return Unknowns(tuple(block for group in groups for block in group))
