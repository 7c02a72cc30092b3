"""The size of every effect in everyday words: what a flight engineer would say of its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bhm_service.battery.cell import Modifiers
from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.effects.charge_transfer import further_drop, ohmic_chord, other_bend
from bhm_service.battery.effects.shapes import OcvShape, ResistanceShape
from bhm_service.discrepancy.before_load import unloaded_a
from bhm_service.discrepancy.cells import lowest_cell
from bhm_service.discrepancy.explanation import Course
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.labels import flight_name
from bhm_service.discrepancy.toll import effect_of, minute_after_takeoff, temperature_k
from bhm_service.units import (
    FARADAY,
    GAS_CONSTANT,
    REFERENCE_TEMPERATURE_K,
    SECONDS_PER_HOUR,
    ZERO_CELSIUS_K,
    Array,
    Value,
    ampere_hours,
)

_TELLING = 0.005  # of a resistance: half a percent more is one percent in words
_READABLE_A = 0.05  # with one decimal: nothing charges a pack on the ground


@dataclass(frozen=True)
class Scene:
    """An effect with its values, and the pack and the flights that it is to be told about."""

    effect_id: str
    values: Mapping[str, Value]  # in the declared units; what differs from flight to flight as (flights,)
    lab: Lab
    flights: Sequence[FlightData]
    courses: Sequence[Course]

    def value(self, name: str) -> float:
        """A number in its declared unit; where nothing was said, what the effect itself takes."""
        if name in self.values:
            return float(np.ravel(self.values[name])[0])
        declared = next(p for p in EFFECTS[self.effect_id].parameters() if p.name == name)
        default = EFFECTS[self.effect_id].__dataclass_fields__[name].default  # type: ignore[attr-defined]
        return float(default) / declared.scale

    def each(self, name: str) -> Array:
        """A number of every flight, in SI."""
        found = [
            getattr(effect_of(self.effect_id, self.values, self.flights, k), name) for k in range(len(self.flights))
        ]
        return np.array(found, dtype=float)

    def aged(self, name: str) -> Array:
        """What has come of a change with age at each flight."""
        settled = self.each("settled")
        return np.asarray(self.each(name) * (settled + (1.0 - settled) * self.each("age")))

    @cached_property
    def ohm(self) -> float:
        """Resistance of the pack as the lab knows it. [Ohm]"""
        return self.lab.pack_ohm

    @cached_property
    def hover_a(self) -> float:
        """Mean current in the air. [A]"""
        return float(np.mean(np.concatenate([f.flown_a for f in self.flights])))

    @cached_property
    def capacity_ah(self) -> float:
        """Charge of the pack as the lab knows it."""
        return ampere_hours(self.lab.capacity_c)

    @cached_property
    def takeoff_c(self) -> list[float] | None:
        """Temperature of the pack in the first minute of every flight [degC]; None where it is not known."""
        found = []
        for course in self.courses:
            kelvin = temperature_k(course)
            if kelvin is None:
                return None
            found.append(float(kelvin[minute_after_takeoff(course.flight)].mean()) - ZERO_CELSIUS_K)
        return found

    @cached_property
    def inferred_sd_k(self) -> float | None:
        """Standard deviation of the pack's temperature where no sensor told it; None where one did. [K]"""
        known = [course.hidden["temperature"][1] for course in self.courses if "temperature" in course.hidden]
        return float(np.sqrt(np.mean(np.concatenate(known) ** 2))) if known else None

    @cached_property
    def reached_c(self) -> list[float]:
        """The coldest and the warmest of every flight whose temperature is known. [degC]"""
        known = [kelvin for course in self.courses if (kelvin := temperature_k(course)) is not None]
        return [float(end) - ZERO_CELSIUS_K for kelvin in known for end in (kelvin.min(), kelvin.max())]


def size(scene: Scene) -> str:
    """An effect's size as a clause without its full stop."""
    return _SIZES[scene.effect_id](scene)


def volts(value: float) -> str:
    """A voltage as people say it: ``0.6 V``, ``60 mV``."""
    return f"{abs(value):.1f} V" if abs(value) >= 0.2 else f"{1e3 * abs(value):.0f} mV"


def volts_between(low: float, high: float) -> str:
    """A range of voltages: ``0.4 to 0.6 V``, and one where both ends read the same."""
    least, most = volts(low), volts(high)
    if least == most:
        return most
    unit = most.rpartition(" ")[2]
    return f"{least.removesuffix(f' {unit}')} to {most}"


def ohms(value: float) -> str:
    """A resistance in milliohm."""
    return f"{1e3 * value:.1f} mohm" if abs(value) < 0.0995 else f"{1e3 * value:.0f} mohm"


def _resistance_temperature(s: Scene) -> str:
    energy = 1e3 * s.value("activation_energy")
    known = s.takeoff_c or [5.0]
    coldest = min(known)
    # Where no take-off was cold the pack is farthest from the lab's temperature once it has warmed up.
    celsius = coldest if coldest < 20.0 else max([*known, *s.reached_c], key=lambda c: abs(c - 25.0))
    ratio = np.exp(energy / GAS_CONSTANT * (1.0 / (celsius + ZERO_CELSIUS_K) - 1.0 / REFERENCE_TEMPERATURE_K))
    unsure = "" if s.inferred_sd_k is None else f" (inferred, ± {max(s.inferred_sd_k, 1.0):.0f} K)"
    return f"at {celsius:.0f} degC{unsure} the pack has {ratio:.2g} times the resistance that it has at 25 degC"


def _self_heating(s: Scene) -> str:
    rises = []
    for course in s.courses:
        kelvin = temperature_k(course)
        if kelvin is not None:
            begin, end = float(kelvin[0]) - ZERO_CELSIUS_K, float(kelvin[-1]) - ZERO_CELSIUS_K
            rises.append((end - begin, begin, end, course.flight.label))
    if not rises:
        return f"it takes {s.value('heat_capacity'):.0f} J to warm the pack by one kelvin"
    rise, begin, end, label = max(rises)
    return (
        f"the pack warms up by its own losses: by {rise:.0f} K on flight {flight_name(label)}, "
        f"from {begin:.0f} to {end:.0f} degC"
    )


def _core_lag(s: Scene) -> str:
    warmer = s.value("thermal_resistance") * s.hover_a**2 * s.ohm
    minutes = s.value("time_constant") / 60.0
    return f"at {s.hover_a:.0f} A the cells get {warmer:.1f} K warmer than the sensor, within some {minutes:.0f} min"


def _entropic_voltage(s: Scene) -> str:
    def told(soc: float) -> str:
        millivolt = s.lab.series * (s.value("slope") + s.value("tilt") * (soc - 0.5))
        if abs(millivolt) < 0.05:
            return "stays"
        return f"{'rises' if millivolt > 0.0 else 'falls'} by {abs(millivolt):.1f} mV"

    ends = told(1.0), told(0.2)
    with_charge = ends[0] if ends[0] == ends[1] else f"{ends[0]} when full and {ends[1]} at 20 % of charge"
    return f"with every kelvin that it is warmer the resting voltage of the pack {with_charge}"


def _capacity_fade(s: Scene) -> str:
    lost = float(np.max(s.aged("fade")))
    grown = 1.0 / (1.0 - lost * s.value("area")) - 1.0
    tired = f", and has {100.0 * grown:.0f} % more resistance" if grown >= _TELLING else ""
    return (
        f"the pack holds {100.0 * (1.0 - lost):.0f} % of the charge that it held in the lab: "
        f"{(1.0 - lost) * s.capacity_ah:.3g} Ah in place of {s.capacity_ah:.3g} Ah{tired}"
    )


def _resistance_growth(s: Scene) -> str:
    grown = float(np.max(s.aged("growth")))
    if grown < 0.0:
        return f"the pack has {100.0 * -grown:.0f} % less resistance than in the lab"
    return (
        f"the pack has {1.0 + grown:.2g} times the resistance that it had in the lab: "
        f"about {ohms((1.0 + grown) * s.ohm)} in place of {ohms(s.ohm)}"
    )


def _cold_capacity(s: Scene) -> str:
    celsius = min([*(s.takeoff_c or [5.0]), 24.0])
    lost = 0.01 * s.value("per_kelvin") * (25.0 - celsius)
    return f"at {celsius:.0f} degC {100.0 * lost:.1f} % of the charge cannot be had"


def _slow_diffusion(s: Scene) -> str:
    parts = []
    ohm = s.value("resistance") * s.lab.series / s.lab.parallel
    if ohm > 1e-5:
        minutes = s.value("time_constant") / 60.0
        parts.append(
            f"under a steady load a further drop builds up over some {minutes:.0f} min, as of {ohms(ohm)} more "
            f"({volts(ohm * s.hover_a)} at {s.hover_a:.0f} A), and goes away as slowly"
        )
    slowing = s.value("slowing")
    if abs(slowing - 1.0) > 0.01:
        parts.append(f"diffusion takes {slowing:.2g} times as long as in the lab")
    return "; ".join(parts) or "diffusion is as in the lab"


def _charge_transfer(s: Scene) -> str:
    speed, bend, straight = s.value("speed"), s.value("bend"), s.value("straight")
    other = other_bend(s.value("other"), ohmic_chord(s.lab.cell, Modifiers(), REFERENCE_TEMPERATURE_K))
    thermal = s.lab.series * 2.0 * GAS_CONSTANT * REFERENCE_TEMPERATURE_K / FARADAY

    def larger(rate: float) -> float:
        return float(thermal * (further_drop(rate, bend, straight, speed) + further_drop(rate, other, 0.0, speed)))

    one = s.capacity_ah
    if abs(speed - 1.0) > 0.005:
        told = f"charge transfer is {speed:.2g} times as fast as in the lab"
        more = larger(s.hover_a / one)
        at_hover = f": at {s.hover_a:.0f} A the drop is {volts(abs(more))} {'larger' if more > 0.0 else 'smaller'}"
        return told + (at_hover if bend > 0.0 else "")
    return (
        f"the drop does not grow in step with the current: it is {volts(larger(1.0))} larger at {one:.0f} A and "
        f"{volts(-larger(4.0))} smaller at {4.0 * one:.0f} A than a straight line says"
    )


def _hysteresis(s: Scene) -> str:
    apart = 2.0 * 1e-3 * s.value("amplitude") * s.lab.series
    return (
        f"after a charge the resting voltage is up to {volts(apart)} higher than after a discharge, "
        f"until some {100.0 * s.value('reach'):.0f} % of the charge has been used"
    )


def _unseen_load(s: Scene) -> str:
    amps = s.value("current")
    longest = max(float(f.time_s[-1]) for f in s.flights)
    return (
        f"{amps:.1f} A flow past the current sensor, beside the {s.hover_a:.0f} A of a hover: "
        f"{amps * longest / SECONDS_PER_HOUR:.2g} Ah of the longest flight were not counted"
    )


def _current_gain(s: Scene) -> str:
    gain = s.value("gain")
    return (
        f"the current sensor reads {100.0 * abs(gain / (1.0 + gain)):.1f} % too {'low' if gain > 0.0 else 'high'}: "
        f"where it says {s.hover_a:.1f} A, {(1.0 + gain) * s.hover_a:.1f} A flow"
    )


def _current_offset(s: Scene) -> str:
    offset = s.value("offset")
    said = f"the current sensor reads {abs(offset):.1f} A too {'low' if offset > 0.0 else 'high'} at all times"
    idle = unloaded_a(s.flights)
    return f"{said}: {idle:.1f} A before the load begins" if idle is not None and idle < -_READABLE_A else said


def _voltage_gain(s: Scene) -> str:
    gain = s.value("gain")
    full = max(float(np.nanmax(f.voltage_v)) for f in s.flights)
    off = full * gain / (1.0 + gain)
    return (
        f"the voltage sensor reads {100.0 * abs(gain):.1f} % too {'high' if gain > 0.0 else 'low'}: "
        f"{volts(off)} of {full:.1f} V"
    )


def _voltage_offset(s: Scene) -> str:
    offset = s.value("offset")
    return f"the voltage sensor reads {volts(offset)} too {'high' if offset > 0.0 else 'low'} at all times"


def _contact_resistance(s: Scene) -> str:
    ohm = 1e-3 * s.value("resistance")
    first = int(np.argmax(s.each("present") > 0.0))
    since = f" from flight {flight_name(s.flights[first].label)} on" if first else ""
    return f"wires and connectors have {ohms(abs(ohm))} {'more' if ohm > 0.0 else 'less'} than in the lab{since}"


def _weak_cell(s: Scene) -> str:
    loss, more = s.value("loss"), s.value("resistance")
    resistance = f" and {100.0 * more:.0f} % more resistance" if more > 0.005 else ""
    lowest = lowest_cell(s.flights)
    which = "one cell" if lowest is None else f"cell {lowest + 1}"
    return f"{which} holds {100.0 * (1.0 - loss):.0f} % of the charge of the others{resistance}: it is empty first"


def _partial_charge(s: Scene) -> str:
    begun = [float(course.soc[0]) for course in s.courses]
    missing = [float(d) for d in s.each("deficit")]
    worst = int(np.argmax(np.abs(missing)))
    way = "less" if missing[worst] > 0.0 else "more"
    return (
        f"flight {flight_name(s.flights[worst].label)} started with {100.0 * abs(missing[worst]):.0f} % {way} charge "
        f"than assumed; all flights started between {100.0 * min(begun):.0f} and {100.0 * max(begun):.0f} %"
    )


def _self_discharge(s: Scene) -> str:
    rate = s.value("rate")
    lost = s.each("rate") * s.each("storage")
    worst = int(np.argmax(lost))
    return (
        f"in storage the pack loses {rate:.2g} % of its charge a day: "
        f"{100.0 * float(lost[worst]):.1f} % before flight {flight_name(s.flights[worst].label)}"
    )


def _rate_capacity(s: Scene) -> str:
    rate = s.hover_a / s.capacity_ah
    share = rate ** (1.0 - s.value("exponent"))
    return (
        f"at {s.hover_a:.0f} A the pack yields {100.0 * share:.0f} % of the charge that it yields at "
        f"{s.capacity_ah:.0f} A"
    )


def _time_skew(s: Scene) -> str:
    skew = s.value("skew")
    return f"the voltage is told {abs(skew):.1f} s {'before' if skew > 0.0 else 'after'} the current that caused it"


def _ocv_shape(s: Scene) -> str:
    knots = [1e-3 * s.value(p.name) for p in OcvShape.parameters()]
    worst = int(np.argmax(np.abs(knots)))
    way = "higher" if knots[worst] > 0.0 else "lower"
    return (
        f"at {100.0 * OcvShape.knots[worst]:.0f} % of charge the resting voltage is {1e3 * abs(knots[worst]):.0f} mV "
        f"a cell {way} than in the lab, {volts(s.lab.series * knots[worst])} of the pack"
    )


def _resistance_shape(s: Scene) -> str:
    knots = [s.value(p.name) for p in ResistanceShape.parameters()]
    worst = int(np.argmax(np.abs(knots)))
    way = "higher" if knots[worst] > 0.0 else "lower"
    return (
        f"at {100.0 * ResistanceShape.knots[worst]:.0f} % of charge the ohmic resistance is "
        f"{100.0 * abs(knots[worst]):.0f} % {way} than in the lab"
    )


def _intermittent_contact(s: Scene) -> str:
    ohm = np.ravel(s.values["resistance"])  # one for every episode; its times are of its own flight, zero on others
    begins, ends = (np.reshape(s.values[name], (ohm.size, -1)) for name in ("begin", "end"))
    told = []
    for k in range(ohm.size):
        at = int(np.argmax(ends[k] - begins[k]))
        data = s.flights[at]
        begin, end = float(begins[k, at]), float(ends[k, at])
        inside = (data.time_s >= begin) & (data.time_s <= end)
        drop = 1e-3 * float(ohm[k]) * float(np.mean(data.current_a[inside])) if inside.any() else 0.0
        until = f"to {_clock(end)}" if end < float(data.time_s[-1]) else "to the end"
        told.append(
            f"{ohms(1e-3 * float(ohm[k]))} more from {_clock(begin)} {until} of flight {flight_name(data.label)} "
            f"({volts(drop)})"
        )
    return "a contact came loose and held again: " + "; ".join(told)


def _clock(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


_SIZES: dict[str, Callable[[Scene], str]] = {
    "resistance-temperature": _resistance_temperature,
    "self-heating": _self_heating,
    "core-lag": _core_lag,
    "entropic-voltage": _entropic_voltage,
    "capacity-fade": _capacity_fade,
    "resistance-growth": _resistance_growth,
    "cold-capacity": _cold_capacity,
    "slow-diffusion": _slow_diffusion,
    "charge-transfer": _charge_transfer,
    "hysteresis": _hysteresis,
    "unseen-load": _unseen_load,
    "current-gain": _current_gain,
    "current-offset": _current_offset,
    "voltage-gain": _voltage_gain,
    "voltage-offset": _voltage_offset,
    "contact-resistance": _contact_resistance,
    "weak-cell": _weak_cell,
    "partial-charge": _partial_charge,
    "self-discharge": _self_discharge,
    "rate-capacity": _rate_capacity,
    "time-skew": _time_skew,
    "ocv-shape": _ocv_shape,
    "resistance-shape": _resistance_shape,
    "intermittent-contact": _intermittent_contact,
}
