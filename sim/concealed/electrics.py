"""Six separate cells in series: solid diffusion as a ladder, asinh kinetics, electrolyte polarisation, contacts.

Lanes (L) are flights, and twins of flights without the effect. What depends on temperature and charge is refreshed
once a second; between, each first-order element is stepped by the trapezoidal rule, all of them in one array.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from sim.concealed.knobs import CellKnobs
from sim.concealed.packs import FARADAY, GAS, GRID, REFERENCE_K, Array, Pack

_STEP = float(GRID[1] - GRID[0])
_LADDER, _ELECTROLYTE, _SLOW, _KINETIC = slice(0, 3), 3, 4, 5  # rows of the elements


@dataclass(slots=True)
class Lanes:
    """Knobs of several worlds, one lane after another: (L, 1) or (L, 6); tables (L, G)."""

    soc: Array
    capacity: Array
    resistance: Array
    exchange: Array
    diffusion: Array
    slow_ohm: Array
    slow_s: Array
    hysteresis_v: Array
    hysteresis_width: Array
    rate_exponent: Array
    cold_per_k: Array
    entropy: Array
    arrhenius: Array
    ocv_v: Array
    ohmic_table: Array

    @classmethod
    def of(cls, pack: Pack, worlds: list[CellKnobs]) -> Lanes:
        """Joined."""
        lanes = [len(w.contact_ohm) for w in worlds]

        def column(name: str) -> Array:
            values = [np.broadcast_to(getattr(w, name), n) for w, n in zip(worlds, lanes, strict=True)]
            return np.concatenate(values)[:, None]

        def by_cell(name: str) -> Array:
            return np.concatenate([getattr(w, name) for w in worlds])

        def table(name: str) -> Array:
            return np.concatenate([np.tile(getattr(w, name), (n, 1)) for w, n in zip(worlds, lanes, strict=True)])

        cells = ("soc", "capacity", "resistance", "exchange", "diffusion")
        columns = ("slow_ohm", "slow_s", "hysteresis_v", "hysteresis_width", "rate_exponent", "cold_per_k")
        return cls(
            **{name: by_cell(name) for name in cells},
            **{name: column(name) for name in (*columns, "entropy", "arrhenius")},
            ocv_v=pack.ocv_v + table("ocv_change_v"),
            ohmic_table=pack.ohmic_shape * table("ohmic_change"),
        )

    def picked(self, which: list[int]) -> Lanes:
        """Some of them."""
        return Lanes(*(getattr(self, f.name)[which] for f in fields(self)))

    @staticmethod
    def joined(parts: list[Lanes]) -> Lanes:
        """One after another."""
        return Lanes(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Lanes)))


class Electrics:
    """State of all lanes. Currents [A] are those of the pack, positive on discharge."""

    def __init__(self, pack: Pack, lanes: Lanes, dt: float) -> None:
        shape = lanes.soc.shape
        self.pack, self.knobs, self.dt = pack, lanes, dt
        self.z = lanes.soc.copy()  # charge left, as a share of what the cell can hold now
        self.elements = np.zeros((6, *shape))  # three depletions [-], then electrolyte, slow and kinetic [V]
        self.turned = np.zeros(shape)  # hysteresis: 0 after a charge, 1 after a long discharge
        self.heat_j = np.zeros(shape)  # made inside the cells so far
        self._has_hysteresis = bool((lanes.hysteresis_v != 0.0).any())
        self._first = np.arange(shape[0])[:, None] * len(GRID)
        self._flat_ocv = np.ascontiguousarray(lanes.ocv_v).ravel()
        self._flat_ohmic = np.ascontiguousarray(lanes.ohmic_table).ravel()
        self._core_c = np.full(shape, np.nan)  # that the numbers below hold for; none yet

    @classmethod
    def of(cls, pack: Pack, worlds: list[CellKnobs], dt: float) -> Electrics:
        """All lanes at rest."""
        return cls(pack, Lanes.of(pack, worlds), dt)

    def lanes(self, which: list[int], dt: float) -> Electrics:
        """A copy of some lanes, to be stepped on by ``dt``."""
        out = Electrics(self.pack, self.knobs.picked(which), dt)
        out.z, out.elements = self.z[which], self.elements[:, which]
        out.turned, out.heat_j = self.turned[which], self.heat_j[which]
        return out

    @staticmethod
    def joined(parts: list[Electrics]) -> Electrics:
        """Lanes of several, one after another."""
        out = Electrics(parts[0].pack, Lanes.joined([p.knobs for p in parts]), parts[0].dt)
        out.z = np.concatenate([p.z for p in parts])
        out.elements = np.concatenate([p.elements for p in parts], axis=1)
        out.turned = np.concatenate([p.turned for p in parts])
        return out

    def refresh(self, core_c: Array) -> None:
        """What moves with temperature and charge."""
        if not np.array_equal(core_c, self._core_c):
            self._warm(core_c)
        k, pack = self.knobs, self.pack
        self.ohmic = self._warm_ohmic * self._lookup(self._flat_ohmic, self.z)
        share = np.maximum(4.0 * self.z * (1.05 - self.z), 0.12) ** 0.5
        self._per_exchange = self._warm_exchange / share
        slope = np.interp(self.z, GRID, pack.entropy_v_per_k) * k.entropy
        self._entropy_v, self._entropy_heat_v = slope * (core_c - 25.0), slope * self._kelvin
        self._unmixed_v = self._lookup(self._flat_ocv, self.z) - self._surface_v()
        if self._has_hysteresis:
            self._unmixed_v = self._unmixed_v + k.hysteresis_v * self.turned

    def _warm(self, core_c: Array) -> None:
        """What moves with temperature alone."""
        k, pack = self.knobs, self.pack
        self._core_c = core_c.copy()
        self._kelvin = kelvin = core_c + 273.15
        tilt = k.arrhenius / GAS * (1.0 / kelvin - 1.0 / REFERENCE_K)
        ohmic, kinetic, diffusion = (np.exp(e * tilt) for e in pack.activation_j_mol)
        self._warm_ohmic = pack.ohmic * k.resistance * ohmic
        self._warm_exchange = 0.5 * k.resistance * kinetic / (pack.exchange_a * k.exchange)
        self._twice_thermal = 2.0 * GAS * kelvin / FARADAY
        speed = k.diffusion / diffusion
        cold = np.clip(1.0 - k.cold_per_k * np.clip(25.0 - core_c, 0.0, None), 0.4, None)
        self.charge_c = 3600.0 * pack.capacity_ah * pack.capacity * k.capacity * cold
        depletion = pack.depletion_s / speed / self.charge_c
        self._gain = np.stack(
            [
                *(share * depletion for share in pack.ladder_share),
                pack.electrolyte * k.resistance * ohmic,
                np.broadcast_to(k.slow_ohm, self.z.shape),
            ]
        )
        taus: list[float | Array] = [tau / speed for tau in pack.ladder_s]
        taus += [pack.electrolyte_s, k.slow_s, pack.double_layer_s]
        half = 0.5 * self.dt / np.stack([np.broadcast_to(tau, self.z.shape) for tau in taus])
        # Long steps are implicit Euler's: the trapezoidal rule would ring.
        self._move = 2.0 * half / (1.0 + (half if self.dt < 0.5 else 2.0 * half))

    def _lookup(self, flat: Array, z: Array) -> Array:
        at = (z - GRID[0]) / _STEP
        np.minimum(np.maximum(at, 0.0, out=at), len(GRID) - 1.001, out=at)
        low = at.astype(np.intp)
        at -= low
        low += self._first
        below = flat[low]
        low += 1
        found: Array = below + at * (flat[low] - below)
        return found

    def _inner_v(self) -> Array:
        lost: Array = self.elements[3:].sum(axis=0)
        if self._has_hysteresis:
            lost = lost + self.knobs.hysteresis_v * self.turned
        return self._surface_v() + self._entropy_v - lost

    def _surface_v(self) -> Array:
        return self._lookup(self._flat_ocv, self.z - self.elements[_LADDER].sum(axis=0))

    def source(self, contact_ohm: Array) -> tuple[Array, Array]:
        """Voltage behind the resistance, and the resistance, of the pack (L,)."""
        return self._inner_v().sum(axis=1), self.ohmic.sum(axis=1) + contact_ohm

    def cells_v(self, current: Array) -> Array:
        """Voltage of each cell at the balance plug (L, 6)."""
        return self._inner_v() - current[:, None] * self.ohmic

    def step(self, current: Array) -> Array:
        """One step with the current held; heat of each cell (L, 6) [W]."""
        i = current[:, None]
        target = np.empty_like(self.elements)
        np.multiply(self._gain, i, out=target[:_KINETIC])
        np.multiply(self._twice_thermal, np.arcsinh(i * self._per_exchange), out=target[_KINETIC])
        target -= self.elements
        target *= self._move
        self.elements += target
        flow = i * self.dt / self.charge_c
        if self._has_hysteresis:
            turn = flow / self.knobs.hysteresis_width
            self.turned = np.clip(self.turned + turn * np.where(turn > 0.0, 1.0 - self.turned, self.turned), 0.0, 1.0)
        rate = np.maximum(np.abs(i) / self.pack.capacity_ah, 1.0)
        self.z = self.z - flow * rate ** (self.knobs.rate_exponent - 1.0)
        lost = self.elements[_ELECTROLYTE:].sum(axis=0) + self._unmixed_v
        heat: Array = i * (lost + i * self.ohmic - self._entropy_heat_v)
        self.heat_j += heat * self.dt
        return heat


def current_for(power_w: Array, source_v: Array, ohm: Array, hidden_a: Array) -> Array:
    """Current [A] when a load takes a power and a hidden load a current, at one terminal voltage.

    A power that the pack cannot give is cut to what it can.
    """
    open_v = source_v - ohm * hidden_a
    root = np.sqrt(np.maximum(open_v * open_v - 4.0 * ohm * power_w, 0.0))
    terminal = np.maximum(0.5 * (open_v + root), 0.3 * source_v)
    return power_w / terminal + hidden_a
