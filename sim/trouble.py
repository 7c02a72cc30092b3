"""What can happen to frames on their way: losses, doubles, overtaking, noise, silence. Seeded."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Trouble:
    """Shares of the frames that it happens to, and times of silence."""

    loss: float = 0.0
    double: float = 0.0
    overtake: float = 0.0
    garbage: float = 0.0  # noise before a frame, or a flipped bit in it
    silences: tuple[tuple[float, float], ...] = ()  # [s] from, for


class Way:
    """One direction of one link, with its trouble."""

    def __init__(self, trouble: Trouble, seed: int) -> None:
        self._trouble = trouble
        self._random = random.Random(seed)
        self._late: list[bytes] = []

    def carry(self, frames: Sequence[bytes], now_s: float) -> list[bytes]:
        """What arrives of the frames that are sent now, in the order of arrival."""
        trouble, chance = self._trouble, self._random.random
        if any(begin <= now_s < begin + seconds for begin, seconds in trouble.silences):
            return []
        arrived, late = list[bytes](), self._late
        self._late = []
        for frame in frames:
            if chance() < trouble.loss:
                continue
            if chance() < trouble.overtake:
                self._late.append(frame)  # until the next time
                continue
            arrived.append(self._noisy(frame) if chance() < trouble.garbage else frame)
            if chance() < trouble.double:
                arrived.append(frame)
        return arrived + late

    def _noisy(self, frame: bytes) -> bytes:
        if self._random.random() < 0.5:
            return self._random.randbytes(self._random.randrange(1, 40)) + frame
        damaged = bytearray(frame)
        damaged[self._random.randrange(len(frame))] ^= 1 << self._random.randrange(8)
        return bytes(damaged)
