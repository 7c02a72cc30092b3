"""What a vehicle's demand model says of the power of its flights, under a hypothesis about what it leaves out.

P = avionics + P_hover * (factors) * (1 + shares). Around it stands what nobody knows better: the level of the hover,
the avionics, how one flight's hover differs from the next's, and the numbers that the vehicle file gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bhm_service.config import Vehicle
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.noise import Noise
from bhm_service.discrepancy.slopes import Slopes
from bhm_service.identification.unknowns import Block, Unknowns, joined, numbers
from bhm_service.prediction.demand import AIR_DENSITY, air_density, hover_power
from bhm_service.prediction.demand_effects import DEMAND_EFFECTS, DemandEffect, Motion, demanded
from bhm_service.prediction.demand_file import KnownDemand, known_demand
from bhm_service.units import Array, Places

# One standard deviation. The level: 2 % of mass (3 % of power), 5 % of efficiency, 3 % of the current sensor, weather.
LEVEL_SD, AVIONICS_SD = 0.08, 0.2
# A hover of one flight against the next: 10 K of air temperature that no log tells are 1.7 %; trim, warm motors. Of one
# vehicle in the same air it may be a tenth of that. The flights themselves say which it is.
FLIGHT_SDS = (0.00125, 0.0025, 0.005, 0.01, 0.02)
FLIGHT_SD = 0.01
_UNSAID_SD = 0.15  # of a number of the vehicle file that comes without one, as a share of it
_EDGE_S = 5.0  # after take-off and before landing that are neither flight nor rest
_KNOWN_SHARE = 0.8  # of a flight's samples that must tell its motion
_SHORTEST_S = 20.0  # in the air
_STANDARD_PA, _STANDARD_K, _LAPSE = 101325.0, 288.15, 0.19026  # T = 288.15 K (p / p0)^0.19026, ISO 2533
_STEP = 1e-3  # of finite differences, in standard deviations of what was known before


@dataclass(frozen=True, slots=True, kw_only=True)
class Craft:
    """A vehicle as its file has it."""

    mass_kg: float
    disc_area_m2: float
    hover_w: float  # of the rotors, in still air at sea level
    avionics_w: float
    efficiency: float
    known: tuple[KnownDemand, ...] = ()


def craft_of(vehicle: Vehicle, where: str) -> Craft | None:
    """The craft of a vehicle file; None where it gives no rotors. Raises BadInputError for a wrong demand table."""
    known, rotors = known_demand(vehicle, where), vehicle.rotors
    if rotors is None:
        return None
    return Craft(
        mass_kg=rotors.mass_kg,
        disc_area_m2=rotors.rotors * np.pi * rotors.rotor_radius_m**2,
        hover_w=hover_power(rotors.mass_kg, rotors.rotors, rotors.rotor_radius_m, rotors.efficiency, 0.0),
        avionics_w=rotors.avionics_w,
        efficiency=rotors.efficiency,
        known=known,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """One flight's power and motion while it was in the air; all (T,)."""

    label: str
    time_s: Array  # since the log's first sample
    power_w: Array
    climb_mps: Array
    airspeed_mps: Array
    density: Array  # [kg/m^3]
    weighed: bool  # whether a barometer told the density
    air_told: bool = False  # and something how warm the air was

    def until(self, samples: int) -> Flown:
        """Its first samples."""
        series = ("time_s", "power_w", "climb_mps", "airspeed_mps", "density")
        return replace(self, **{name: getattr(self, name)[:samples] for name in series})


def airs_k(flights: Sequence[FlightData]) -> list[float | None]:
    """The air's temperature of each flight as it is told [K]: all as noted, or all by a cold board; or none at all.

    A board is warmer than the air by some kelvin, much the same from flight to flight: that is a matter of the level.
    """
    for told in ([f.notes.ambient_k for f in flights], [f.cold_board_k for f in flights]):
        if None not in told:
            return told
    return [None] * len(flights)


@dataclass(frozen=True, slots=True)
class Zero:
    """By how much a current sensor reads too little [A], and the voltage at which the power is taken as it is read.

    Vehicle files have power as sensors read it, so what such a reading lacks at every charge is of the hover's level.
    What it lacks more of while the pack is full is nothing that the vehicle asks for.
    """

    missing_a: float = 0.0
    at_v: float = 0.0


EXACT = Zero()


def flown_of(data: FlightData, air_k: float | None = None, zero: Zero = EXACT) -> Flown | None:
    """A flight as the demand side sees it, in air so warm; None where it is hardly in the air or tells no motion."""
    air = np.flatnonzero(data.airborne)
    if air.size == 0:
        return None
    t = data.time_s
    inside = data.airborne & (t > t[air[0]] + _EDGE_S) & (t < t[air[-1]] - _EDGE_S)
    told = np.isfinite(data.climb_mps) & np.isfinite(data.speed_mps)
    if not inside.any() or np.mean(told[inside]) < _KNOWN_SHARE:
        return None
    inside &= told & np.isfinite(data.voltage_v)
    if inside.sum() < 2 or float(np.ptp(t[inside])) < _SHORTEST_S:
        return None
    pressure = data.pressure_pa[inside]
    weighed = bool(np.isfinite(pressure).all())
    # What is told holds on the ground: a hundred metres up it is 0.65 K less, a thousandth of the power.
    kelvin = _STANDARD_K * (pressure / _STANDARD_PA) ** _LAPSE if air_k is None else np.full(pressure.size, air_k)
    density = np.array([air_density(p, k) for p, k in zip(pressure, kelvin, strict=True)])
    return Flown(
        label=data.label,
        time_s=t[inside],
        power_w=(data.voltage_v * data.current_a + zero.missing_a * (data.voltage_v - zero.at_v))[inside],
        climb_mps=data.climb_mps[inside],
        airspeed_mps=data.speed_mps[inside],
        density=density if weighed else np.full(pressure.size, AIR_DENSITY),
        weighed=weighed,
        air_told=weighed and air_k is not None,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """An effect that may be missing: its number, for all flights or one for each, and what multiplies it in each."""

    id: str
    form: str = ""  # where an effect may act in more than one way
    per_flight: bool = False
    shapes: tuple[Array, ...]  # for each flight (1,) or (T,)
    price: float = 0.0  # [nats] of having looked for its shape everywhere
    change_points: tuple[tuple[str, float], ...] = ()  # flight and time [s] of steps in those shapes

    @property
    def key(self) -> str:
        """What tells it from all others."""
        return f"{self.id}:{self.form}" if self.form else self.id

    @property
    def kind(self) -> type[DemandEffect]:
        """Its class in the catalogue."""
        return DEMAND_EFFECTS[self.id]

    def block(self) -> Block:
        """Its unknowns."""
        (declared,) = self.kind.parameters()
        assert declared.prior is not None
        size = len(self.shapes) if self.per_flight else 1
        mean, sd = (np.full(size, v) for v in declared.prior)
        return Block(
            name=self.key, start=mean, low=np.full(size, declared.low), high=np.full(size, declared.high), prior=mean,
            sd=sd,
        )  # fmt: skip

    def effect(self, values: Array, flight: int) -> DemandEffect:
        """The effect of one flight for numbers (M, 1 or F)."""
        (declared,) = self.kind.parameters()
        own = values[:, flight : flight + 1] if self.per_flight else values
        return self.kind(**{declared.name: own * self.shapes[flight]})


@dataclass(frozen=True)
class Demand:
    """A hypothesis over flights: the vehicle's own uncertainties and the terms' unknowns in one vector."""

    craft: Craft
    flights: tuple[Flown, ...]
    terms: tuple[Term, ...] = ()
    flight_sd: float = FLIGHT_SD  # of the hover of one flight against the next

    @cached_property
    def unknowns(self) -> Unknowns:
        """Everything that is looked for."""
        own = [
            numbers("level", np.zeros(1), LEVEL_SD, 1.0),
            numbers("avionics", np.zeros(1), AVIONICS_SD, 1.0),
            numbers("flight", np.zeros(len(self.flights)), self.flight_sd, 10.0 * FLIGHT_SD),
        ]
        return joined(own, [_known_block(k) for k in self.craft.known], [t.block() for t in self.terms])

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where each block stands in the vector."""
        return {b.name: self.unknowns.slice_of(b.name) for b in self.unknowns.blocks}

    @cached_property
    def scale(self) -> Array:
        """Standard deviation of what was known before, of every number."""
        return np.concatenate([b.sd for b in self.unknowns.blocks])

    @cached_property
    def known(self) -> Array:
        """Curvature of what was known before, in those standard deviations."""
        return np.eye(self.scale.size)

    def pulls(self, x: Array) -> Array:
        """How far a vector is from what was known before."""
        return np.asarray(self.unknowns.pulls(x)[0])

    def leaning(self, x: Array) -> tuple[float, Array]:
        """No number of a demand costs for what it multiplies."""
        return 0.0, np.zeros(x.size)

    def predicted(self, x: Array, flight: int) -> Array:
        """Power of one flight for vectors (M, n). [W] (M, T)"""
        data, values = self.flights[flight], self.unknowns.values(x)
        motion = Motion(
            mass_kg=self.craft.mass_kg, disc_area_m2=self.craft.disc_area_m2, density=data.density,
            airspeed=data.airspeed_mps, climb=data.climb_mps,
        )  # fmt: skip
        effects = [
            *(type(k.effect)(**{k.effect.parameters()[0].name: values[_known(k)]}) for k in self.craft.known),
            *(t.effect(values[t.key], flight) for t in self.terms),
        ]
        level = np.exp(values["level"] + values["flight"][:, flight : flight + 1])
        rotors = self.craft.hover_w * level * demanded(effects, motion)
        power: Array = self.craft.avionics_w * (1.0 + values["avionics"]) + rotors
        return np.broadcast_to(power, (x.shape[0], data.time_s.size))

    def misfits(self, x: Array) -> list[Array]:
        """Measured minus modelled power of every flight, as shares of the hover's."""
        rows = [self.predicted(x[None, :], k)[0] for k in range(len(self.flights))]
        return [(f.power_w - r) / self.craft.hover_w for f, r in zip(self.flights, rows, strict=True)]

    def residuals(self, x: Array, noise: Noise) -> list[Array]:
        """Whitened residuals of every flight, for a vector (n,)."""
        return [
            noise.whitened((f.power_w - self.predicted(x[None, :], k)[0]) / self.craft.hover_w)
            for k, f in enumerate(self.flights)
        ]

    def linearised(self, x: Array, noise: Noise) -> tuple[list[Array], list[Slopes]]:
        """Whitened residuals of every flight, and their derivatives by the vector in standard deviations."""
        rows, slopes = [], []
        steps = np.where(x + _STEP * self.scale > self.unknowns.high, -_STEP, _STEP) * self.scale
        for k, data in enumerate(self.flights):
            used = self._used(k)
            points = np.tile(x, (used.size + 1, 1))
            points[np.arange(1, used.size + 1), used] += steps[used]
            white = noise.whitened((data.power_w - self.predicted(points, k)) / self.craft.hover_w)
            rows.append(white[0])
            slopes.append(Slopes(((white[1:] - white[0]) / (steps / self.scale)[used, None]).T, used, x.size))
        return rows, slopes

    def _used(self, flight: int) -> Places:
        """The numbers of the vector that a flight depends on."""
        own = {"flight", *(t.key for t in self.terms if t.per_flight)}
        where = [np.arange(p.start, p.stop) for p in self.places.values()]
        parts = [w[flight : flight + 1] if n in own else w for n, w in zip(self.places, where, strict=True)]
        return np.concatenate(parts)

    def with_terms(self, terms: Sequence[Term]) -> Demand:
        """The same flights under other terms."""
        return replace(self, terms=tuple(terms))

    def with_part(self, flight: int, samples: int) -> Demand:
        """The same with the first samples only of one flight."""

        def cut(shapes: tuple[Array, ...]) -> tuple[Array, ...]:
            own = shapes[flight] if shapes[flight].size == 1 else shapes[flight][:samples]
            return (*shapes[:flight], own, *shapes[flight + 1 :])

        flights = (*self.flights[:flight], self.flights[flight].until(samples), *self.flights[flight + 1 :])
        return replace(self, flights=flights, terms=tuple(replace(t, shapes=cut(t.shapes)) for t in self.terms))


def _known(known: KnownDemand) -> str:
    return f"known.{known.effect.id}"


def _known_block(known: KnownDemand) -> Block:
    """A number that the vehicle file gives, as uncertain as it says."""
    (declared,) = known.effect.parameters()
    value = float(np.ravel(getattr(known.effect, declared.name))[0])
    sd = known.sd if known.sd else max(_UNSAID_SD * abs(value), 1e-6)
    return Block(
        name=_known(known), start=np.array([value]), low=np.array([declared.low]), high=np.array([declared.high]),
        prior=np.array([value]), sd=np.array([sd]),
    )  # fmt: skip
