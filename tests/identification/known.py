"""Cells whose parameters are known, and the recordings that a bench would make of them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from battery.cells import CAPACITY_C, CURVE, chem, circ

from bhm_service.battery.battery_file import read_battery
from bhm_service.battery.pack import PackModel
from bhm_service.config import shipped
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.identify import Request, identify

NOISE_V = 0.002  # [V] of a cell's voltage, white
SPREAD = 0.25  # of the logarithm of every parameter, cell to cell
ALLOWED = 3.0  # standard deviations
PARAMETERS = {
    "circ": ("r_s", "r_sp0", "r_sp1", "r_sp2", "c_sp"),
    "chem": ("t_diffusion", "r_o", "tau_o", "i_p0", "i_n0", "tau_p", "tau_n"),
}
_RATED_A = CAPACITY_C / 3600.0


def cell_of(model, rng):
    """A cell whose parameters, and whose curve where that is Circ's, are drawn anew."""
    reference = circ() if model == "circ" else chem()
    drawn = {name: getattr(reference, name) * np.exp(SPREAD * rng.standard_normal()) for name in PARAMETERS[model]}
    if model == "chem":
        curve = read_battery(shipped("batteries", "generic-lipo.toml")).cell("chem")
        return chem(u_0=curve.u_0, a_p=curve.a_p, a_n=curve.a_n, **drawn)
    rises = np.diff(CURVE.volts) * np.exp(0.1 * rng.standard_normal(len(CURVE.volts) - 1))
    volts = CURVE.volts[0] + np.concatenate([[0.0], np.cumsum(rises)])
    return circ(ocv=type(CURVE)(CURVE.soc, tuple(volts)), **drawn)


def recorded(pack, label, kind, time_s, current_a, rng, noise_v=NOISE_V):
    """What a bench writes down of a run from full."""
    volts = pack.simulate(time_s, current_a, 1.0).voltage + noise_v * rng.standard_normal(time_s.size)
    return Experiment(label=label, kind=kind, time_s=time_s, current_a=current_a, voltage_v=volts)


def slow(pack, rng, step_s=120.0, hours=20.0):
    """A slow discharge from full to empty."""
    t = np.arange(0.0, hours * 3600.0 + 0.5 * step_s, step_s)
    return recorded(pack, "slow", Kind.SLOW, t, np.full(t.size, CAPACITY_C / (hours * 3600.0)), rng)


def one_c(pack, rng, step_s=5.0):
    """A minute of rest, most of the charge at one C, ten minutes of rest."""
    t = np.arange(0.0, 4200.0, step_s)
    return recorded(pack, "one-C", Kind.ONE_C, t, np.where((t >= 60.0) & (t < 3480.0), _RATED_A, 0.0), rng)


def variable(pack, rng):
    """Levels up to four C for some half a minute each until most is out, a rest, a little more, a rest."""
    t = np.arange(0.0, 3000.0, 2.0)
    current = np.zeros(t.size)
    begins = np.arange(30, 1350, 15) + rng.integers(-4, 5, 88)
    for begin, end in pairwise(begins):
        current[begin:end] = _RATED_A * rng.uniform(0.0, 4.0)
    current[(np.cumsum(current) * 2.0 > 0.7 * CAPACITY_C) & (t < 2400.0)] = 0.0
    current[np.cumsum(current) * 2.0 > 0.88 * CAPACITY_C] = 0.0
    return recorded(pack, "variable", Kind.VARIABLE, t, current, rng)


@dataclass(frozen=True, slots=True)
class Found:
    """One parameter: how far it was found from the truth, in the standard deviation stated for it."""

    name: str
    told: bool  # the recordings say something of it
    off: float


def found_again(model, seed):
    """Identify a cell drawn by the seed from its three recordings."""
    rng = np.random.default_rng(seed)
    truth = cell_of(model, rng)
    pack = PackModel(truth, 1)
    recordings = tuple(make(pack, rng) for make in (slow, one_c, variable))
    (result,) = identify(Request(experiments=recordings, series=1, models=(model,))).results
    unknowns = result.solution.problem.unknowns
    return [
        Found(
            name,
            name not in result.not_told,
            float(result.solution.x[k] - (np.log(true) if block.log else true)) / result.spread.sd(k),
        )
        for block in unknowns.blocks
        if block.name in PARAMETERS[model]
        for name, true, k in [(block.name, getattr(truth, block.name), unknowns.slice_of(block.name).start)]
    ]
