"""A pack's own numbers as its flights have them: resistance, charge and curve, and how well they tell the charge.

A fit has its effects beside what the lab left open of the pack itself, and neither holds without the other: a filter
that runs the effects alone reads a curve that lies 5 mV lower in flight than in the lab as half a percent of charge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bhm_service.battery.battery_file import MODELS, BatteryFile, ModelName
from bhm_service.battery.ocv import MOST_REST_V, CurveRest
from bhm_service.battery.parameters import parameters_of
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.lab import BEND_SOC
from bhm_service.discrepancy.lab_file import LEAST_SD
from bhm_service.identification.curve import KNOTS, rising
from bhm_service.units import Array

_CAPACITY = next(p for p in parameters_of(Uncertainty) if p.name == "capacity")


def as_flown(battery: BatteryFile, fits: Sequence[Fitted]) -> BatteryFile:
    """The battery with its resistance, capacity and curve where the flights put them, its charge as well known.

    ``fits``: at most one of each cell model. A model without one has the scales of the first; its curve is as it was,
    since that has the errors of the other's form in it. A file of a cell that any pack may be built from has the
    resistance alone: how much charge a pack has its vehicle file says, and the curve goes with that.
    """
    by_model = {fitted.joint.lab.model: fitted for fitted in fits}
    for model in MODELS:
        fitted = by_model.get(model, fits[0])
        battery = _scaled(battery, model, fitted)
        if model in by_model and battery.series is not None:
            battery = _bent(battery, model, _bends_v(fitted))
    if battery.series is None:
        return battery
    # No surer than of a pack that a lab has just measured.
    sd = float(np.clip(max(_charge_sd(fitted) for fitted in fits), LEAST_SD["capacity"], _CAPACITY.high))
    return replace(battery, uncertainty=replace(battery.uncertainty, capacity=sd))


def moved_of(fitted: Fitted) -> dict[str, float]:
    """By which shares a fit has the pack's own numbers away from the battery file's."""
    blocks = {"resistance": "lab_resistance", "capacity": "lab_capacity"}
    places = fitted.joint.places
    return {name: float(np.expm1(fitted.x[places[block]][0])) for name, block in blocks.items()}


def _bends_v(fitted: Fitted) -> Array:
    """By how much a cell's curve is off at `BEND_SOC`, as this vehicle's meter reads it. [V]"""
    places = fitted.joint.places
    meter = fitted.x[places["lab_meter"]] if "lab_meter" in places else 0.0
    return np.asarray(fitted.x[places["lab_bends"]] + meter)


def _charge_sd(fitted: Fitted) -> float:
    """How well a fit tells what its sensors count from full to empty, as a logarithm, effects and all."""
    joint, x = fitted.joint, fitted.x
    points, steps = joint.moved(x, np.arange(x.size)[None, :])
    counted = np.log(joint.counted_c(points, len(joint.flights) - 1))
    slope = (counted[1:] - counted[0]) / steps
    return float(np.sqrt(slope @ fitted.covariance @ slope))


def _scaled(battery: BatteryFile, model: ModelName, fitted: Fitted) -> BatteryFile:
    """The battery with one model's resistance and capacity as a fit has them, and their spreads with them."""
    blocks, own = ["lab_resistance", "lab_capacity"], moved_of(fitted)
    ohmic, charge = 1.0 + own["resistance"], 1.0 + own["capacity"]
    if battery.series is None:
        blocks, charge = blocks[:1], 1.0
    if model == "circ" and battery.circ is not None:
        circ = replace(battery.circ, r_s=battery.circ.r_s * ohmic, c_max=battery.circ.c_max * charge)
        battery = replace(battery, circ=circ)
        numbers = {"r_s": circ.r_s, "c_max": circ.c_max}
    elif model == "chem" and battery.chem is not None:
        chem = replace(battery.chem, r_o=battery.chem.r_o * ohmic, q_max=battery.chem.q_max * charge)
        battery = replace(battery, chem=chem)
        numbers = {"r_o": chem.r_o, "q_max": chem.q_max}
    else:
        return battery
    told = zip(numbers.items(), blocks, strict=False)  # those that moved
    spreads = {name: float(np.asarray(number) * fitted.sd(block)[0]) for (name, number), block in told}
    return replace(battery, sd={**battery.sd, model: {**battery.sd.get(model, {}), **spreads}})


def _bent(battery: BatteryFile, model: ModelName, bends_v: Array) -> BatteryFile:
    """The battery with one model's curve bent; what its lab left open of it stays where it was.

    Chem's series is what physics has for its electrodes: a bend is what it leaves.
    """
    if model == "circ" and battery.circ is not None:
        volts = np.asarray(battery.circ.ocv.voltage(KNOTS)) + np.interp(KNOTS, BEND_SOC, bends_v)
        battery = replace(battery, circ=replace(battery.circ, ocv=rising(KNOTS, volts)))
    elif model == "chem" and battery.chem is not None:
        rest = battery.chem.curve_rest
        at = BEND_SOC if rest is None else np.union1d(BEND_SOC, rest.soc)
        volts = np.interp(at, BEND_SOC, bends_v) + (0.0 if rest is None else np.asarray(rest.voltage(at)))
        volts = np.clip(volts, -MOST_REST_V, MOST_REST_V)
        battery = replace(battery, chem=replace(battery.chem, curve_rest=CurveRest(_plain(at), _plain(volts))))
    left = battery.left_open.get(model)
    if left is None:
        return battery
    mean = {**left.mean, "bends": _plain(np.array(left.mean["bends"]) - bends_v)}
    return replace(battery, left_open={**battery.left_open, model: replace(left, mean=mean)})


def _plain(numbers: Array) -> tuple[float, ...]:
    return tuple(float(v) for v in numbers)
