"""The simulated pack: a table, a resistance and two slow pairs, stepped by Euler; of one piece with nothing else."""

from __future__ import annotations

from dataclasses import dataclass

# Rested voltage of a LiPo cell against the charge left, as hobby chargers print it.
_LEFT = (0.00, 0.05, 0.10, 0.20, 0.30, 0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.00)
_VOLTS = (3.27, 3.61, 3.69, 3.73, 3.77, 3.80, 3.84, 3.87, 3.95, 4.02, 4.11, 4.20)


@dataclass(slots=True)
class SimulatedPack:
    """One pack. Resistances are of a cell of one ampere-hour: a bigger one has less."""

    series: int
    capacity_ah: float
    left: float = 1.0
    ohmic: float = 0.030  # [Ohm Ah]
    fast: tuple[float, float] = (0.012, 15.0)  # [Ohm Ah], [s]
    slow: tuple[float, float] = (0.010, 150.0)
    _fast_v: float = 0.0
    _slow_v: float = 0.0

    def step(self, power_w: float, dt: float) -> tuple[float, float]:
        """Draw a power for a short time; terminal voltage [V] and current [A]."""
        open_v = self.series * (_interpolate(self.left) - self._fast_v - self._slow_v)
        ohm = self.series * self.ohmic / self.capacity_ah
        root = max(open_v * open_v - 4.0 * ohm * power_w, 0.0) ** 0.5
        volts = 0.5 * (open_v + root)
        amps = power_w / max(volts, 0.5)
        self.left -= amps * dt / (3600.0 * self.capacity_ah)
        for name, (resistance, tau) in (("_fast_v", self.fast), ("_slow_v", self.slow)):
            now = getattr(self, name)
            setattr(self, name, now + (amps * resistance / self.capacity_ah - now) * dt / tau)
        return volts, amps


def _interpolate(left: float) -> float:
    if left <= _LEFT[0]:
        return _VOLTS[0] + 12.0 * (left - _LEFT[0])
    for low, high, v, w in zip(_LEFT, _LEFT[1:], _VOLTS, _VOLTS[1:], strict=False):
        if left <= high:
            return v + (w - v) * (left - low) / (high - low)
    return _VOLTS[-1]
