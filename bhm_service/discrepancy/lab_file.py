"""A pack as a battery file has it, and how well its lab knew that."""

from __future__ import annotations

import numpy as np

from bhm_service.battery.battery_file import BatteryFile, ModelName
from bhm_service.battery.cell import CellModel, Modifiers
from bhm_service.battery.chem import Chem
from bhm_service.battery.circ import Circ
from bhm_service.battery.effects import DoubleLayer
from bhm_service.discrepancy.lab import AT_ONCE_S, BEND_SD, DROP_S, DROP_SD, FORM, HOVER_C, Lab
from bhm_service.errors import BadInputError
from bhm_service.units import SECONDS_PER_HOUR, Value

# Of the logarithm: what a lab repeats to.
LEAST_SD = {"resistance": DROP_SD[0], "polarisation": 0.15, "capacity": 0.01}
_APART = 0.3  # of a model's lasting error: what of it is another one in flight than in the lab
# Where the lab told the form of the drop, what moves it in flight is the weather: a few kelvins, of which charge
# transfer and diffusion make the more (design/discrepancy.md, step 1: R0 3 %, R1 10 %).
_TOLD_POLARISATION_SD = 0.10
_CURVE_V = 1.0  # [V] by which an open-circuit curve falls from full to empty, about: what makes a voltage of a charge


def lab_of(battery: BatteryFile, model: ModelName, series: int | None, capacity_c: float | None) -> Lab:
    """The pack of a battery file; ``series`` and ``capacity_c`` come from the vehicle where the file is of a cell only.

    Raises BadInputError when neither says how many cells there are, when they contradict each other, and where the file
    says what its lab left open of errors that are not these.
    """
    cell = battery.cell(model)
    if battery.series is not None and series is not None and battery.series != series:
        raise BadInputError(
            battery.name, f"is a pack of {battery.series} cells, the vehicle file says {series}",
            "another battery file, or take series out of this one if the pack is built from such cells",
        )  # fmt: skip
    cells = battery.series if battery.series is not None else series
    if cells is None:
        raise BadInputError(
            battery.name, "is a cell that any pack may be built from: how many cells?", "give the --vehicle file"
        )
    own = float(np.asarray(cell.capacity_c))
    parallel = 1.0 if battery.series is not None or capacity_c is None else capacity_c / own
    said = battery.uncertainty
    identified = battery.series is not None and battery.bench
    left_open = battery.left_open.get(model) if identified else None
    by_charge = left_open is not None and "lag_at" in left_open.mean
    sizes = [(name, size) for name, size in FORM.items() if by_charge or name != "lag_at"]
    if left_open is not None and list(left_open.sizes.items()) != sizes:
        raise BadInputError(
            battery.name, f"left_open.{model} is of another version of bhm", "identify the pack again, or take it out"
        )
    own_error_v = None if left_open is None else left_open.error_v
    # A flight is a varying load that no fit saw, and no nearer than a curve is known at best. Where no recording told
    # how far that is off, it is the worse of both models on pieces of what was recorded.
    told_v = None if left_open is None else left_open.load_error_v
    error_v = said.voltage_error_v if told_v is None else max(told_v, BEND_SD[0])
    layers = [e for e in battery.effects(model) if isinstance(e, DoubleLayer)]
    held_back = [(layer, _transfer_ohm(cell, 2.0 * layer.exchange_current)) for layer in layers]
    ohm = _ohm(cell) + sum(share for _, share in held_back)
    at_once = sum(share for layer, share in held_back if float(np.asarray(layer.time_constant)) <= AT_ONCE_S)
    by_error = error_v / (ohm * HOVER_C * own / SECONDS_PER_HOUR) / np.sqrt(len(DROP_S))

    def spread(kind: str, wide: float) -> float:
        return LEAST_SD[kind] if identified else max(wide, LEAST_SD[kind])

    lag_sd = 0.0 if left_open is None else _APART * error_v / _CURVE_V / np.sqrt(len(DROP_S))
    return Lab(
        model=model,
        cell=cell,
        effects=battery.effects(model),
        series=cells,
        parallel=parallel,
        ohm=ohm,
        voltage_error_v=error_v,
        own_error_v=said.voltage_error_v if own_error_v is None else own_error_v,
        identified=identified,
        ohmic_share=(float(np.asarray(cell.r_s if isinstance(cell, Circ) else cell.r_o)) + at_once) / ohm,
        resistance_sd=spread("resistance", said.resistance),
        polarisation_sd=spread("polarisation", said.polarisation) if left_open is None else _TOLD_POLARISATION_SD,
        capacity_sd=spread("capacity", said.capacity),
        bend_sd_v=_bend_sd_v(error_v, identified, left_open is not None),
        drop_sd=float(np.clip(by_error, *DROP_SD)) if left_open is None else _APART * by_error,
        lag_sd=lag_sd,
        lag_at_sd=lag_sd if by_charge else 0.0,
        left_open=left_open,
    )


def _bend_sd_v(error_v: float, identified: bool, form_told: bool) -> float:
    """By how much a cell's open-circuit curve may be off, in flight only where the lab told its form. [V]"""
    if not identified:
        return error_v
    # The worst is of labs that told nothing. From what a lab told a flight differs by a share of what its model is off
    # by, however much that is.
    least_v, most_v = BEND_SD
    return float(np.clip(_APART * error_v, least_v, np.inf if form_told else most_v))


def _ohm(cell: CellModel) -> float:
    if isinstance(cell, Circ):
        return float(np.asarray(cell.r_s + cell.surface_resistance(np.array(0.5), Modifiers())))
    assert isinstance(cell, Chem)
    # At half charge, where x(1 - x) is a quarter, they are half of i_p0 and i_n0.
    return float(np.asarray(cell.r_o)) + _transfer_ohm(cell, cell.i_p0) + _transfer_ohm(cell, cell.i_n0)


def _transfer_ohm(cell: CellModel, twice_exchange: Value) -> float:
    """Of charge transfer at 1C, by twice its exchange current."""
    one_c = float(np.asarray(cell.capacity_c)) / SECONDS_PER_HOUR
    return float(2.0 * 0.0257 * np.arcsinh(one_c / np.asarray(twice_exchange)) / one_c)
