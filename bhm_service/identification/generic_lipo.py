"""The generic LiPo cell that ships: fitted to the 1-4C runs of a 5.45 Ah drone pouch (MaxAmps, zenodo 7553043).

    python -m bhm_service.identification.generic_lipo ../shared/data/lab/maxamps_lipo5450 config/batteries

The runs start from a cell charged to 4.1 V, have no rests and no slow discharge. What follows from that:

- the open-circuit curve is held near the mean of the 1C charge and discharge branches, and full is by definition
  4.20 V at rest, so the part above 4.1 V is the curve's own slope carried on;
- the state of charge at the start follows from that slope (0.87), and the capacity from the charge that came out;
- below SoC 0.1 the four runs disagree by more than any one cell can (they end 3 % of the capacity apart), so the
  rested voltage of an empty cell is held near 3.2 V and the last 5 % of each run count a tenth;
- without pulses or rests the time constants of Chem cannot be told apart: those that the runs leave open stay near
  the values of the reference library (Daigle & Kulkarni 2013), by priors 30 % wide, and the surface
  fraction is theirs.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from bhm_service.battery.battery_file import BatteryFile, Joined, write_battery
from bhm_service.battery.chem import X_N_MAX, Chem, nernst
from bhm_service.battery.circ import Circ
from bhm_service.battery.effects import ResistanceTemperature
from bhm_service.battery.ocv import MonotoneSpline
from bhm_service.battery.pack import PackModel
from bhm_service.battery.parameters import parameters_of
from bhm_service.battery.redlich_kister import horner, polynomial
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.identification.bench import read_bench
from bhm_service.identification.bench_table import Reading
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.fitting import Fit, Free, fit
from bhm_service.units import SECONDS_PER_HOUR, Array

FULL_V = 4.20  # [V] rested full cell: how a LiPo charger defines it
_RATES = (1, 2, 3, 4)
_KNOTS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.87, 0.94, 1.0)
_VOLTAGE_SD = 0.005  # [V] what a one-pair model can be expected to follow
_BRANCH_SD = 0.010  # [V] how near the open-circuit curve stays to the mean of charge and discharge
_START_SOC = (0.87, 0.01)  # rested 4.096 V on a slope of 0.8 V per unit below 4.20 V
_EMPTY_V = (3.2, 0.05)  # [V] rested empty cell
_LAST = 0.95  # of the charge that a run gave: beyond, voltages count a tenth
_TOP = -5  # first of the knots above SoC 0.7, where the slope is held even
_EVERY = 4  # samples used in the fit
_CHEM_ORDER = 11
_RIDGE_V = 1e-2  # [V] weight on A_k in units of 10 kJ/mol
_SURFACE_FRACTION = 0.1
_PRIOR_SD = 0.3  # of the logarithm: 30 %

# Resistance times capacity of the packs in the recorded flights, wiring included, spans 7 to 160 mOhm Ah a cell;
# rested voltages of LiPo cells of different make differ by some 10 mV at the same state of charge.
_ANY_PACK = Uncertainty(voltage_error_v=0.015, resistance=0.8, polarisation=0.6, capacity=0.05)


def load(folder: Path) -> tuple[list[Experiment], Experiment]:
    """The four discharges, each from its rest, and the 1C run with its charge."""
    # Read as a variable load: the charge that follows each discharge is wanted as well.
    whole = [
        read_bench(folder / f"cell_{rate}C_cycle01.csv.gz", Kind.VARIABLE, Reading(series=1))[0].experiment
        for rate in _RATES
    ]
    return [_discharge(run) for run in whole], whole[0]


def _discharge(run: Experiment) -> Experiment:
    count = int(np.argmax(run.current_a < 0.0))
    part = run.part(slice(0, count))
    assert part.temperature_k is not None
    # The log begins one second into the load: put the rest before it back.
    return replace(
        part,
        time_s=np.concatenate([[-1.0, -0.999], part.time_s]),
        current_a=np.concatenate([[0.0, part.current_a[0]], part.current_a]),
        voltage_v=np.concatenate([[np.nan, np.nan], part.voltage_v]),
        temperature_k=np.concatenate([part.temperature_k[:1], part.temperature_k[:1], part.temperature_k]),
    )


def branch_mean(run: Experiment) -> tuple[Array, Array]:
    """Charge taken out [C] and the mean of the voltages on the way down and on the way up [V] there."""
    down = run.part(slice(0, int(np.argmax(run.current_a < 0.0))))
    first_up = int(np.argmax(run.current_a < 0.0))
    up = run.part(slice(first_up, None))
    up = up.part(slice(0, int(np.argmax(up.current_a > 0.95 * up.current_a.min()))))
    out = np.linspace(0.1, 0.9, 33) * down.charge_c[-1]
    falling = np.interp(out, down.charge_c, down.voltage_v)
    rising = np.interp(down.charge_c[-1] - out, -up.charge_c, up.voltage_v)
    return out, 0.5 * (falling + rising)


def curve(values: Mapping[str, float]) -> MonotoneSpline:
    """The open-circuit curve from its steps, counted down from full."""
    steps = np.array([values[f"step_{k}"] for k in range(len(_KNOTS) - 1)])
    volts = FULL_V - np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    return MonotoneSpline(_KNOTS, tuple(float(v) for v in volts))


def fit_circ(runs: list[Experiment], reference: Experiment) -> tuple[Circ, ResistanceTemperature, Fit]:
    """Circ with a spline open-circuit curve, and the activation energy of its resistance."""
    out, mean = branch_mean(reference)
    guess = np.interp(_KNOTS, [0, 0.05, 0.1, 0.2, 0.5, 0.8, 1], [3.0, 3.5, 3.65, 3.72, 3.83, 4.03, FULL_V])
    free = [
        Free(name="c_max", start=5.9 * SECONDS_PER_HOUR, low=15e3, high=25e3, log=True),
        Free(name="r_s", start=4e-3, low=1e-4, high=2e-2, log=True),
        Free(name="r_sp0", start=5e-3, low=1e-4, high=3e-2, log=True),
        Free(name="r_sp1", start=1e-5, low=1e-9, high=1e-2, log=True),
        Free(name="r_sp2", start=6.0, low=0.0, high=30.0),
        Free(name="c_sp", start=8e3, low=5e2, high=2e4, log=True),
        Free(name="activation_energy", start=20e3, low=5e3, high=45e3, prior=(20e3, 5e3)),
        Free(name="soc", start=_START_SOC[0], low=0.8, high=0.95, prior=_START_SOC),
        *(
            Free(name=f"step_{k}", start=float(step), low=1e-4, high=1.5, log=True)
            for k, step in enumerate(np.diff(guess))
        ),
    ]

    def residual(values: Mapping[str, float]) -> Array:
        cell, effect = _circ(values)
        pack = PackModel(cell, 1, 1.0, [effect])
        parts = [_misfit(pack, run, values["soc"]) for run in runs]
        near = cell.ocv.voltage(values["soc"] - out / cell.c_max) - mean
        steps = np.diff(np.asarray(cell.ocv.voltage(np.array(_KNOTS[_TOP:]))))
        slopes = np.diff(steps / np.diff(_KNOTS[_TOP:])) / 0.1
        empty = (cell.ocv.voltage(0.0) - _EMPTY_V[0]) / _EMPTY_V[1]
        return np.concatenate([*parts, np.asarray(near) / _BRANCH_SD, slopes, [empty]])

    found = fit(free, residual)
    cell, effect = _circ(found.values)
    return cell, effect, found


def _circ(values: Mapping[str, float]) -> tuple[Circ, ResistanceTemperature]:
    names = ("c_max", "r_s", "r_sp0", "r_sp1", "r_sp2", "c_sp")
    cell = Circ(ocv=curve(values), **{name: values[name] for name in names})
    return cell, ResistanceTemperature(activation_energy=values["activation_energy"])


def _misfit(pack: PackModel, run: Experiment, soc: float) -> Array:
    model = pack.simulate(run.time_s, run.current_a, soc, run.temperature_k)
    weight = np.where(run.charge_c < _LAST * run.charge_c[-1], 1.0, 0.1)
    misfit = ((model.voltage - run.voltage_v) * weight)[2::_EVERY]
    # A run counts as sixty independent voltages whatever its length: neighbouring residuals say the same thing.
    weighted: Array = misfit / _VOLTAGE_SD * np.sqrt(60.0 / misfit.size)
    return weighted


def fit_chem(runs: list[Experiment], circ: Circ, effect: ResistanceTemperature, soc: float) -> tuple[Chem, Fit]:
    """Chem on the same open-circuit curve and capacity; its kinetics and diffusion from the runs."""
    q_max = float(np.asarray(circ.c_max)) / X_N_MAX
    u_0, a_p = redlich_kister_fit(circ)
    near = {
        "t_diffusion": 200.0, "r_o": 3e-3, "tau_o": 0.3,
        "i_p0": 30.0, "i_n0": 60.0, "tau_p": 30.0, "tau_n": 5.0,
    }  # fmt: skip
    bounds = {p.name: p for p in parameters_of(Chem)}
    free = [
        Free(
            name=name,
            start=value,
            low=max(bounds[name].low, value / 30.0),
            high=min(bounds[name].high, value * 30.0),
            log=True,
            prior=(float(np.log(value)), _PRIOR_SD),
        )
        for name, value in near.items()
    ]

    def build(values: Mapping[str, float]) -> Chem:
        return Chem(
            q_max=q_max, u_0=u_0, a_p=a_p, a_n=(0.0,), surface_fraction=_SURFACE_FRACTION, curve_rest=None, **values
        )

    def residual(values: Mapping[str, float]) -> Array:
        pack = PackModel(build(values), 1, 1.0, [effect])
        return np.concatenate([_misfit(pack, run, soc) for run in runs])

    found = fit(free, residual)
    return build(found.values), found


def redlich_kister_fit(circ: Circ) -> tuple[float, tuple[float, ...]]:
    """U_0 and A_p,k that follow a cell's open-circuit curve between SoC 0 and 1."""
    soc = np.linspace(0.0, 1.0, 401)
    target = circ.open_circuit(soc) - nernst(X_N_MAX * soc)
    # Fitted on A_k themselves and kept small: a high order left free runs to 1e8 J/mol, which cancels to nothing.
    y = 2.0 * X_N_MAX * soc - 1.0
    basis = [np.asarray(horner(polynomial([0.0] * k + [1.0]), -y)) for k in range(_CHEM_ORDER + 1)]
    design = np.column_stack([np.ones_like(y), *(1e4 * column for column in basis)])
    ridge = np.diag([0.0, *([_RIDGE_V] * (_CHEM_ORDER + 1))])
    goal = np.concatenate([target, np.zeros(_CHEM_ORDER + 2)])
    solved = np.linalg.lstsq(np.vstack([design, ridge]), goal, rcond=None)[0]
    return float(solved[0]), tuple(float(1e4 * a) for a in solved[1:])


def main() -> None:
    """Fit, report and write."""
    data, folder = Path(sys.argv[1]), Path(sys.argv[2])
    runs, reference = load(data)
    circ, effect, circ_fit = fit_circ(runs, reference)
    chem, chem_fit = fit_chem(runs, circ, effect, circ_fit.values["soc"])
    for cell in (circ, chem):
        pack = PackModel(cell, 1, 1.0, [effect])
        for run in runs:
            model = pack.simulate(run.time_s, run.current_a, circ_fit.values["soc"], run.temperature_k)
            misfit = (model.voltage - run.voltage_v)[2:]
            deep = run.charge_c[2:] > _LAST * run.charge_c[-1]
            print(  # noqa: T201
                f"{type(cell).__name__:5} {run.label:24} RMSE {1e3 * np.sqrt(np.mean(misfit[~deep] ** 2)):5.1f} mV,"
                f" {1e3 * np.sqrt(np.mean(misfit[deep] ** 2)):5.1f} mV in the last 5 %"
            )
    write_battery(
        folder / "generic-lipo.toml",
        BatteryFile(
            name="Generic LiPo cell",
            source="fitted to MaxAmps 5.45 Ah pouch, 1-4C, cycle 1 (doi 10.5281/zenodo.7553043) by "
            "bhm_service.identification.generic_lipo",
            circ=circ,
            chem=chem,
            joined=(Joined(effect=effect, sd={"activation_energy": circ_fit.sd["activation_energy"]}),),
            uncertainty=_ANY_PACK,
            sd={"circ": circ_fit.sd, "chem": chem_fit.sd},
        ),
    )


if __name__ == "__main__":
    main()
