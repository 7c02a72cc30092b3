"""The same work as progpy 1.9.0, in the same run: `make bench` prints the ratios."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from bhm_service.assembly import Equipment, assemble
from bhm_service.battery.battery_file import read_battery
from bhm_service.battery.pack import PackModel
from bhm_service.config import BatterySettings, Service, Vehicle, shipped
from bhm_service.estimation.ukf import Belief, UnscentedFilter
from bhm_service.mavlink.decode import WANTED, VehicleDecoder
from bhm_service.mavlink.encode import FrameEncoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.mavlink.tlog import TlogReader
from bhm_service.messages import NamedValue, Tick
from bhm_service.prediction.end_of_discharge import Limits, end_of_discharge
from sim.autopilot import Autopilot
from sim.battery import SimulatedPack
from sim.multirotor import Multirotor, hover_plan

progpy = pytest.importorskip("progpy", reason="pip install -e '.[bench]'")
BATTERY = shipped("batteries", "generic-lipo.toml")
TLOG = Path(__file__).parents[3] / "shared" / "data" / "flights" / "tlog" / "acuasi_quad_flight3.tlog"
MODELS = ["circ", "chem"]
AMPS = 2.0  # progpy's cells are of 2 Ah: a discharge at 1C


def timed(work, count=1):
    """Median seconds of one call."""
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        for _ in range(count):
            work()
        times.append((time.perf_counter() - begin) / count)
    return statistics.median(times)


def told(seconds):
    return f"{seconds * 1e3:.2f} ms" if seconds >= 1e-3 else f"{seconds * 1e6:.0f} us"


def theirs(model, **settings):
    from progpy.models import BatteryCircuit, BatteryElectroChemEOD

    kind = BatteryCircuit if model == "circ" else BatteryElectroChemEOD
    return kind(**settings)


def ours(model):
    """A cell of 2 Ah."""
    cell = read_battery(BATTERY).cell(model)
    return PackModel(cell, 1, 2.0 * 3600.0 / float(np.asarray(cell.capacity_c)))


@pytest.fixture(autouse=True)
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@pytest.mark.parametrize("model", MODELS)
def test_filter_step(benchmark, row, model):
    """Predict and update of an unscented Kalman filter on the bare cell model."""
    from progpy.state_estimators import UnscentedKalmanFilter

    pack = ours(model)
    n = pack.n_states
    ukf, noise = UnscentedFilter(n), np.eye(n) * 1e-9
    belief = Belief(np.array(pack.rest(0.8)), np.diag([1e-4] + [1e-6] * (n - 1)))
    volts = float(pack.open_circuit(0.8))

    def step():
        moved = ukf.predict(belief, lambda points: pack.step(points, 1.0, AMPS), noise)
        return ukf.update(ukf.innovate(moved, lambda points: pack.voltage(points, AMPS), volts, 1e-4))

    peer_model = theirs(model)
    start = peer_model.initialize()
    peer = UnscentedKalmanFilter(peer_model, start)
    load, seen = peer_model.InputContainer({"i": AMPS}), peer_model.output(start)
    clock = iter(range(1, 10_000))
    peer_s = timed(lambda: peer.estimate(float(next(clock)), load, seen), 20)
    benchmark(step)
    ours_s = benchmark.stats.stats.median
    row(f"UKF step, {model}", told(ours_s), told(peer_s), f"{peer_s / ours_s:.0f} x  (target 10)")


@pytest.mark.parametrize("model", MODELS)
def test_open_loop_of_a_thousand_seconds(benchmark, row, model):
    """Simulation of 1000 s at 1 s."""
    pack = ours(model)
    t, current = np.arange(1000.0), np.full(1000, AMPS)
    peer_model = theirs(model, process_noise=0, measurement_noise=0)
    load = peer_model.InputContainer({"i": AMPS})
    peer_s = timed(lambda: peer_model.simulate_to(1000, lambda t, x=None: load, dt=1, save_freq=1))
    benchmark(lambda: pack.simulate(t, current, 0.97))
    ours_s = benchmark.stats.stats.median
    ratio = f"{peer_s / ours_s:.0f} x  (target 200); {1e-6 * 1000 / ours_s:.1f} M steps/s"
    row(f"open loop 1000 s, {model}", told(ours_s), told(peer_s), ratio)


@pytest.mark.parametrize("model", MODELS)
def test_prediction_with_a_hundred_samples(benchmark, row, model):
    """From 50 % state of charge to the end of discharge, 100 samples."""
    from progpy.predictors import MonteCarlo
    from progpy.uncertain_data import MultivariateNormalDist

    pack = ours(model)
    rng = np.random.default_rng(1)
    states = np.tile(np.array(pack.rest(0.5)), (100, 1))
    states[:, 0] += 0.01 * rng.standard_normal(100)
    power = AMPS * 3.7 * (1.0 + 0.02 * rng.standard_normal(100))
    limits = Limits(threshold_soc=0.0, cutoff_v=3.0)

    peer_model = theirs(model, process_noise=1e-6, measurement_noise=0)
    load = peer_model.InputContainer({"i": AMPS})
    half = peer_model.simulate_to(1800 if model == "chem" else 1500, lambda t, x=None: load, dt=1).states[-1]
    spread = MultivariateNormalDist(
        half.keys(), list(half.values()), np.diag([max(abs(v), 1e-6) * 1e-4 for v in half.values()])
    )
    predictor = MonteCarlo(peer_model)
    begin = time.perf_counter()
    predictor.predict(spread, lambda t, x=None: load, n_samples=100, dt=1.0, horizon=2000)
    peer_s = time.perf_counter() - begin
    benchmark(lambda: end_of_discharge(pack, states, power, limits))
    ours_s = benchmark.stats.stats.median
    row(f"RFT, 100 samples, {model}", told(ours_s), told(peer_s), f"{peer_s / ours_s:.0f} x  (target 300)")


def test_reading_a_tlog(benchmark, row):
    """Wanted messages of a real log, against pymavlink's type-filtered reader."""
    from pymavlink import mavutil

    from bhm_service.mavlink.dialect import mavlink

    if not TLOG.exists():
        pytest.skip(f"real recordings are not here: {TLOG}")
    names = [mavlink.mavlink_map[i].msgname for i in WANTED]

    def peer():
        log = mavutil.mavlogfile(str(TLOG))
        while log.recv_match(type=names) is not None:
            pass
        log.close()

    def read():
        decoder = VehicleDecoder()
        for f in TlogReader.open(TLOG, WANTED):
            decoder.decode(f.message_id, f.payload, f.source, 0.0)

    peer_s = timed(peer)
    benchmark(read)
    ours_s = benchmark.stats.stats.median
    row("reading and decoding a tlog", told(ours_s), told(peer_s), f"{peer_s / ours_s:.1f} x  (target 3)")


def in_flight():
    """The service's bus after two minutes of a simulated flight, and the frames of the next seconds."""
    battery = read_battery(BATTERY)
    settings = BatterySettings(file=str(BATTERY), series=4, capacity_ah=5.0)
    bus = assemble(Equipment(vehicle=Vehicle(name="bench", battery=settings), battery=battery), Service(), [Wire()])
    vehicle, autopilot = Multirotor(SimulatedPack(4, 5.0), hover_plan(240.0, 900.0), 1), Autopilot()
    decoder, splitter = VehicleDecoder(), FrameSplitter()

    def second():
        state = vehicle.second()
        for frame in splitter.feed(b"".join(autopilot.frames(state))):
            for message in decoder.decode(frame.message_id, frame.payload, frame.source, state.time_s):
                bus.publish(message)
        bus.publish(Tick(time_s=state.time_s))

    for _ in range(120):
        second()
    return second


class Wire:
    name = "wire"
    hears = (NamedValue,)
    says = ()

    def __init__(self):
        self.encoder = FrameEncoder(1)

    def on_message(self, message):
        self.encoder.named_value(message)
        return []


def test_whole_cycle_of_one_second(benchmark, row):
    """Decode, both filters, both predictions with 100 samples each, encode."""
    second = in_flight()
    benchmark.pedantic(second, rounds=200, iterations=1)
    ours_s = benchmark.stats.stats.median
    row("whole 1 Hz cycle", told(ours_s), "", "target 30 ms, better 10")


RESIDENT = "print([int(l.split()[1]) for l in open('/proc/self/status') if l.startswith('VmRSS')][0] / 1024)"
SERVICE = f"""
import bhm_service.service
from bhm_service.assembly import assemble
from bhm_service.config import Service, shipped
from bhm_service.equipment import equipment_of
from bhm_service.messages import BatterySample, FlightPhase, Tick

bus = assemble(equipment_of(shipped("vehicles", "quad-4s.toml"), None), Service())
bus.publish(FlightPhase(time_s=0.0, airborne=True, because=""))
for k in range(120):
    t, volts = float(k), 16.0 - 0.001 * k
    bus.publish(BatterySample(time_s=t, battery_id=0, voltage_v=volts, current_a=17.0, temperature_k=None))
    bus.publish(Tick(time_s=t))
{RESIDENT}
"""
PROGPY = f"import progpy.models, progpy.state_estimators, progpy.predictors\n{RESIDENT}"


def python(code):
    run = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True)
    return run.stdout


def test_resident_memory(row):
    """Of the service in flight, all of it loaded."""
    ours_mb, theirs_mb = float(python(SERVICE)), float(python(PROGPY))
    row("resident memory in flight", f"{ours_mb:.0f} MiB", f"{theirs_mb:.0f} MiB (import)", "target under 100")


def test_help_is_quick(row):
    """`bhm --help`, a process of its own, against importing progpy."""
    ours_s = timed(
        lambda: subprocess.run([sys.executable, "-m", "bhm_service.cli", "--help"], capture_output=True, check=True)
    )
    peer_s = timed(lambda: python("import progpy.models"))
    row("bhm --help", told(ours_s), f"{told(peer_s)} (import)", "target under 0.5 s")
