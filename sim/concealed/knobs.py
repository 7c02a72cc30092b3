"""What a world can be turned by: per flight (F,) or per flight and cell (F, 6). Neutral knobs are the lab's pack."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sim.concealed.packs import GRID, SERIES, Array


@dataclass(frozen=True, slots=True)
class ContactStep:
    """Resistance that a bad contact adds for a while."""

    flight: int
    start_s: float  # since the log's first sample
    end_s: float
    ohm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CellKnobs:
    """The cells and what joins them."""

    soc: Array  # (F, 6) at the start
    capacity: Array  # (F, 6) factor
    resistance: Array  # (F, 6) factor on ohmic and electrolyte resistance, and on 1 / exchange current
    exchange: Array  # (F, 6) factor on the exchange current
    diffusion: Array  # (F, 6) factor on the speed of solid diffusion
    contact_ohm: Array  # (F,)
    contact_steps: tuple[ContactStep, ...] = ()
    slow_ohm: Array = field(default_factory=lambda: np.zeros(1))  # (F,) a polarisation of minutes, of one cell
    slow_s: float = 300.0
    hysteresis_v: float = 0.0  # of one cell, half the loop
    hysteresis_width: float = 0.05  # share of the charge over which it turns
    rate_exponent: float = 1.0  # charge is lost as (I / 1C)^(p - 1) above 1C
    cold_per_k: float = 0.0  # capacity lost per K below 25 degC
    entropy: float = 0.0  # factor on dU/dT
    arrhenius: float = 0.0  # factor on all activation energies; 0 = the cells do not mind temperature
    ocv_change_v: Array = field(default_factory=lambda: np.zeros_like(GRID))
    ohmic_change: Array = field(default_factory=lambda: np.ones_like(GRID))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeatKnobs:
    """Temperatures. Without heat a pack stays at its start's."""

    heats: bool
    start_c: Array  # (F,)
    ambient_c: Array  # (F,)
    cooling: float = 1.0
    core: float = 1.0  # factor on the core's thermal resistance


@dataclass(frozen=True, slots=True, kw_only=True)
class Heater:
    """A load that switches by itself and that the shunt does not see."""

    ampere: float
    period_s: float
    duty: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorKnobs:
    """What stands between the pack and the log."""

    current_gain: Array  # (F,)
    current_offset_a: Array  # (F,)
    unseen_a: Array  # (F,)
    voltage_gain: Array  # (F,)
    voltage_offset_v: Array  # (F,)
    skew_s: Array  # (F,) voltage is that of so much earlier than the current's
    voltage_lag_s: Array  # (F,) low-pass filter beyond the usual
    board_v_per_k: float = 0.0  # drift of the voltage with the board's temperature
    vibration: float = 0.0  # share of the current that the shunt loses at 1 g of vibration
    heater: Heater | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DemandKnobs:
    """What the vehicle asks for."""

    mass: Array  # (F,) factor
    release_s: Array  # (F,) after take-off, NaN = the mass stays
    released: Array  # (F,) share of the mass that leaves then
    efficiency: Array  # (F,) factor
    field_m: Array  # (F,) altitude of the field
    air_c: Array  # (F,)
    wind_mps: Array  # (F,)
    turbulence: Array  # (F,) factor on gusts
    plan: tuple[str, ...]  # (F,) kind of flight: see load.PLANS
    land_soc: Array  # (F,) state of charge at which the pilot means to land
    icing_per_min: float = 0.0  # drag and profile power that grow
    regenerates: bool = False  # descent feeds the pack
    without: tuple[str, ...] = ()  # terms that this world's twin lacks: "tilt", "lift", "climb"


@dataclass(frozen=True, slots=True, kw_only=True)
class Knobs:
    """A world."""

    cells: CellKnobs
    heat: HeatKnobs
    sensors: SensorKnobs
    demand: DemandKnobs

    @property
    def flights(self) -> int:
        """How many."""
        return len(self.demand.plan)


def neutral(flights: int, plan: tuple[str, ...], land_soc: Array) -> Knobs:
    """The lab's pack at 25 degC, full, under sensors without fault, on a calm day."""
    one, zero = np.ones(flights), np.zeros(flights)
    by_cell = np.ones((flights, SERIES))
    return Knobs(
        cells=CellKnobs(
            soc=by_cell,
            capacity=by_cell,
            resistance=by_cell,
            exchange=by_cell,
            diffusion=by_cell,
            contact_ohm=zero,
            slow_ohm=zero,
        ),
        heat=HeatKnobs(heats=False, start_c=25.0 * one, ambient_c=25.0 * one),
        sensors=SensorKnobs(
            current_gain=one,
            current_offset_a=zero,
            unseen_a=zero,
            voltage_gain=one,
            voltage_offset_v=zero,
            skew_s=zero,
            voltage_lag_s=zero,
        ),
        demand=DemandKnobs(
            mass=one,
            release_s=np.nan * one,
            released=zero,
            efficiency=one,
            field_m=10.0 * one,
            air_c=25.0 * one,
            wind_mps=1.5 * one,
            turbulence=one,
            plan=plan,
            land_soc=land_soc,
        ),
    )
