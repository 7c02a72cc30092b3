"""Two nodes for each cell: a core that is heated, a surface that is cooled; end cells are cooled better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.concealed.packs import SERIES, Array, Pack

_CORE_SHARE = 0.75  # of the heat capacity
_ON_GROUND = 0.35  # cooling without the rotors' wash


@dataclass(slots=True)
class Heat:
    """Temperatures [degC] of lanes and cells (L, 6), stepped by Heun's method; lanes that do not heat stand still."""

    core_c: Array
    surface_c: Array
    ambient_c: Array  # (L, 1)
    heats: Array  # (L, 1) 1 or 0
    core_j_per_k: float
    surface_j_per_k: float
    link_w_per_k: Array  # (L, 1)
    cooling_w_per_k: Array  # (L, 6) in flight
    lost_j: Array  # (L, 6) given to the air so far, for the balance

    @classmethod
    def of(cls, pack: Pack, start_c: Array, ambient_c: Array, heats: Array, cooling: Array, core: Array) -> Heat:
        """Lanes with their own start, ambient and factors (L,)."""
        place = np.array([1.25, 1.0, 0.875, 0.875, 1.0, 1.25])
        of_cell = pack.cooling_w_per_k / SERIES * place / place.mean()
        start = np.repeat(start_c[:, None], SERIES, axis=1)
        return cls(
            core_c=start.copy(),
            surface_c=start.copy(),
            ambient_c=ambient_c[:, None],
            heats=heats[:, None],
            core_j_per_k=_CORE_SHARE * pack.heat_j_per_k / SERIES,
            surface_j_per_k=(1.0 - _CORE_SHARE) * pack.heat_j_per_k / SERIES,
            link_w_per_k=1.0 / (pack.core_k_per_w * core[:, None]),
            cooling_w_per_k=of_cell * cooling[:, None],
            lost_j=np.zeros_like(start),
        )

    def lanes(self, which: list[int]) -> Heat:
        """A copy of some lanes."""
        by_lane = (self.core_c, self.surface_c, self.ambient_c, self.heats)
        core, surface, ambient, heats = (part[which] for part in by_lane)
        link, cooling, lost = self.link_w_per_k[which], self.cooling_w_per_k[which], self.lost_j[which]
        return Heat(core, surface, ambient, heats, self.core_j_per_k, self.surface_j_per_k, link, cooling, lost)

    def step(self, heat_w: Array, airborne: Array, dt: float) -> None:
        """One step with the heat held; ``airborne`` (L,) is 1 in flight."""
        if not self.heats.any():
            return
        cooling = self.cooling_w_per_k * (_ON_GROUND + (1.0 - _ON_GROUND) * airborne[:, None])

        def rates(core: Array, surface: Array) -> tuple[Array, Array, Array]:
            inner = self.link_w_per_k * (core - surface)
            out = cooling * (surface - self.ambient_c)
            return (heat_w - inner) / self.core_j_per_k, (inner - out) / self.surface_j_per_k, out

        core_a, surface_a, out_a = rates(self.core_c, self.surface_c)
        core_b, surface_b, out_b = rates(self.core_c + dt * core_a, self.surface_c + dt * surface_a)
        half = 0.5 * dt * self.heats
        self.core_c += half * (core_a + core_b)
        self.surface_c += half * (surface_a + surface_b)
        self.lost_j += half * (out_a + out_b)
