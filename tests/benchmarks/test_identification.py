"""Identification of a pack from a long bench run, and of four parameters beside progpy's `estimate_params`."""

from __future__ import annotations

import time
import warnings

import numpy as np
import pytest
from battery.cells import CAPACITY_C
from identification.known import cell_of, recorded

from bhm_service.battery.circ import Circ
from bhm_service.battery.effects import SlowDiffusion
from bhm_service.battery.ocv import CubicCapacitance
from bhm_service.battery.pack import PackModel
from bhm_service.identification.experiment import Kind
from bhm_service.identification.fitting import Free, fit
from bhm_service.identification.identify import Request, identify

NOISE_V = 0.002
SLOW_H = 50
AMPS = CAPACITY_C / 3600.0


def bench_run(rng):
    """Fifty hours at 1 Hz, one C and a variable load of one cell, as the paper's section 7 has them."""
    pack = PackModel(cell_of("circ", rng), 1)
    t = np.arange(SLOW_H * 3600.0)
    slow = recorded(pack, "slow", Kind.SLOW, t, np.full(t.size, CAPACITY_C / t.size), rng)
    t = np.arange(4200.0)
    one_c = recorded(pack, "one-C", Kind.ONE_C, t, np.where((t >= 60.0) & (t < 3480.0), AMPS, 0.0), rng)
    t = np.arange(1800.0)
    levels = np.repeat(AMPS * rng.uniform(0.0, 4.0, t.size // 20), 20)
    current = np.where((t > 60.0) & (np.cumsum(levels) < 0.85 * CAPACITY_C), levels, 0.0)
    return slow, one_c, recorded(pack, "variable", Kind.VARIABLE, t, current, rng)


def test_both_models_from_fifty_hours_at_one_hertz(row):
    recordings = bench_run(np.random.default_rng(1))
    samples = sum(e.time_s.size for e in recordings)
    begin, begin_cpu = time.perf_counter(), time.process_time()
    found = identify(Request(experiments=recordings, series=1))
    wall, cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
    errors = ", ".join(f"{r.model} {1e3 * max(a.whole.rmse for a in r.assessments):.1f} mV" for r in found.results)
    row(f"identify both models, {samples} samples", f"{cpu:.0f} s CPU", "", f"target 60 s; {wall:.0f} s; {errors}")


def load_of(rng):
    """A new level every 50 s, reached within four: the same for a model that holds a load and one that joins it."""
    begins = np.arange(50.0, 1001.0, 50.0)
    levels = rng.uniform(0.2, 3.0, begins.size + 1)
    at = np.concatenate([[0.0], np.column_stack([begins, begins + 4.0]).ravel()])
    amps = np.concatenate([[levels[0]], np.column_stack([levels[:-1], levels[1:]]).ravel()])
    return lambda t: float(np.interp(t, at, amps))


def off(found, truth):
    return max(abs(found[k] / truth[k] - 1.0) for k in truth)


def test_four_parameters_of_a_circuit_from_a_thousand_seconds(row):
    """progpy's own circuit on its own data: two pairs of resistance and capacitance, all four started at half."""
    models = pytest.importorskip("progpy.models", reason="pip install -e '.[bench]'")
    rng = np.random.default_rng(2)
    load = load_of(rng)
    keys = ("Rs", "Cs", "Rcp0", "Ccp")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        source = models.BatteryCircuit(process_noise=0, measurement_noise=0)
        truth = {k: float(source.parameters[k]) for k in keys}
        made = source.simulate_to(999, lambda t, x=None: source.InputContainer({"i": load(t)}), dt=0.1, save_freq=1)
        t = np.arange(len(made.times), dtype=float)
        clean = np.array([z["v"] for z in made.outputs])
        volts = clean + NOISE_V * rng.standard_normal(t.size)
        amps = np.array([load(s) for s in t])
        p = source.parameters

        peer = models.BatteryCircuit(process_noise=0, measurement_noise=0)
        for key in keys:
            peer.parameters[key] = 0.5 * truth[key]
        inputs = [peer.InputContainer({"i": a}) for a in amps]
        outputs = [peer.OutputContainer({"t": z["t"], "v": v}) for z, v in zip(made.outputs, volts, strict=True)]
        begin = time.perf_counter()
        bounds = [(0.05 * truth[k], 20.0 * truth[k]) for k in keys]
        peer.estimate_params(times=[list(t)], inputs=[inputs], outputs=[outputs], keys=keys, bounds=bounds, dt=1.0)
        peer_s = time.perf_counter() - begin
        theirs = {k: float(peer.parameters[k]) for k in keys}
        again = peer.simulate_to(999, lambda t, x=None: peer.InputContainer({"i": load(t)}), dt=1.0, save_freq=1)
        their_rmse = float(np.sqrt(np.mean((np.array([z["v"] for z in again.outputs])[: t.size] - clean) ** 2)))

    curve = CubicCapacitance(
        c_max=p["CMax"], q_max=p["qMax"], v_0=p["V0"], cbp0=p["Cbp0"], cbp1=p["Cbp1"], cbp2=p["Cbp2"]
    )

    def simulated(values):
        cell = Circ(
            ocv=curve, c_max=p["CMax"], r_s=0.0, r_sp0=values["Rcp0"], r_sp1=p["Rcp1"], r_sp2=p["Rcp2"],
            c_sp=values["Ccp"],
        )  # fmt: skip
        slow = SlowDiffusion(resistance=values["Rs"], time_constant=values["Rs"] * values["Cs"])
        return PackModel(cell, 1, 1.0, [slow]).simulate(t, amps, 1.0).voltage

    free = [Free(name=k, start=0.5 * v, low=0.05 * v, high=20.0 * v, log=True) for k, v in truth.items()]
    begin = time.perf_counter()
    ours = fit(free, lambda values: (simulated(values) - volts) / NOISE_V).values
    ours_s = time.perf_counter() - begin
    our_rmse = float(np.sqrt(np.mean((simulated(ours) - clean) ** 2)))
    row(
        "four parameters from 1000 s",
        f"{1e3 * ours_s:.0f} ms",
        f"{peer_s:.1f} s",
        f"{peer_s / ours_s:.0f} x  (target 50); off the truth {1e3 * our_rmse:.2f} against {1e3 * their_rmse:.2f} mV, "
        f"parameters {off(ours, truth):.0%} against {off(theirs, truth):.0%}",
    )
