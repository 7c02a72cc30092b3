from dataclasses import replace

import numpy as np
import pytest
from estimation.scenarios import live

from bhm_service.battery.pack import PackModel
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.estimation.tracker import Tracker
from bhm_service.estimation.ukf import FilterDivergedError
from bhm_service.messages import BatterySample, Model, Rejection


@pytest.fixture(params=["circ", "chem"])
def tracker(request, generic):
    cell = generic.cell(request.param)
    return Tracker(
        Model(request.param),
        cell,
        6,
        16.0 * 3600.0 / cell.capacity_c,
        generic.effects(request.param),
        generic.uncertainty,
    )


def sample(time_s, volts, amps, kelvin=None):
    return BatterySample(time_s=time_s, battery_id=0, voltage_v=volts, current_a=amps, temperature_k=kelvin)


@pytest.mark.parametrize("soc", [0.15, 0.5, 0.8, 0.97])
def test_charge_at_the_start_is_read_off_the_resting_voltage(tracker, soc):
    rested = float(tracker.pack.open_circuit(soc))
    _, estimate = tracker.step(None, sample(0.0, rested, 0.0))
    assert estimate.soc == pytest.approx(soc, abs=0.03)
    assert estimate.soc_low < soc < estimate.soc_high or soc > 0.95


def test_where_the_curve_is_flat_the_start_is_less_certain(tracker):
    sd = {}
    for soc in (0.35, 0.9):
        _, estimate = tracker.step(None, sample(0.0, float(tracker.pack.open_circuit(soc)), 0.0))
        sd[soc] = estimate.soc_sd
    assert sd[0.35] > 1.5 * sd[0.9]


def test_a_start_under_load_is_less_certain_than_one_at_rest(tracker):
    rested = float(tracker.pack.open_circuit(0.8))
    _, at_rest = tracker.step(None, sample(0.0, rested, 0.2))
    _, in_flight = tracker.step(None, sample(0.0, rested - 1.0, 35.0))
    assert in_flight.soc_sd > 2.0 * at_rest.soc_sd


def test_voltage_that_no_charge_explains_starts_nothing(tracker):
    track, estimate = tracker.step(None, sample(0.0, 11.3, 0.2))  # one of two balance plugs is off
    assert track is None
    assert estimate is None
    with pytest.raises(FilterDivergedError, match="no charge of this pack explains"):
        tracker.start(sample(0.0, 11.3, 0.2))


@pytest.mark.parametrize(
    ("volts", "amps", "why"),
    [
        (None, 10.0, Rejection.NO_VOLTAGE),
        (23.0, None, Rejection.NO_CURRENT),
        (float("nan"), 10.0, Rejection.NOT_FINITE),
        (65.5, 10.0, Rejection.IMPLAUSIBLE),
        (23.0, 4000.0, Rejection.IMPLAUSIBLE),
        (23.0, -8.0, Rejection.IMPLAUSIBLE),
        (19.0, 10.0, Rejection.SURPRISING),
    ],
)
def test_a_sample_that_is_not_used_says_why(tracker, volts, amps, why):
    track = None
    for k in range(20):
        track, _ = tracker.step(track, sample(float(k), 23.6, 10.0))
    _, estimate = tracker.step(track, sample(20.0, volts, amps))
    assert estimate.rejected is why
    assert abs(estimate.soc - track.belief.mean[0]) < 0.002


def test_current_that_flows_back_is_counted_where_the_voltage_rises_with_it(tracker):
    """Half a minute of braking in every minute: the charge that comes back counts, and no sample is refused."""
    t = np.arange(1200.0)
    braking = (t % 60.0) >= 30.0
    amps = np.where(braking, -6.0, 20.0)
    volts, soc = live(tracker, t, amps, 0.9)
    track, refused = None, []
    for now, v, i in zip(t, volts, amps, strict=True):
        track, estimate = tracker.step(track, sample(float(now), float(v), float(i)))
        refused.append(estimate.rejected)
    assert set(refused[60:]) == {None}
    assert estimate.soc == pytest.approx(soc[-1], abs=0.02)


def test_estimate_is_marked_invalid_while_current_is_not_measured(tracker):
    track = None
    for k in range(60):
        track, estimate = tracker.step(track, sample(float(k), 23.6, 12.0))
    assert estimate.valid
    for k in range(60, 120):
        track, estimate = tracker.step(track, sample(float(k), 23.5, None))
    assert not estimate.valid
    for k in range(120, 140):
        track, estimate = tracker.step(track, sample(float(k), 23.3, 12.0))
    assert estimate.valid


def test_a_long_rest_moves_nothing_but_brings_the_curve_in(tracker):
    """At rest the resistance cannot be seen, so it does not move; the charge follows the voltage."""
    rested = float(tracker.pack.open_circuit(0.6))
    track, first = tracker.step(None, sample(0.0, rested + 0.02, 0.3))
    before = track.belief.mean[tracker._log_r], track.belief.covariance[tracker._log_r, tracker._log_r]
    for k in range(1, 600):
        track, estimate = tracker.step(track, sample(float(k), rested + 0.02 * np.cos(k), 0.3))
    assert track.belief.mean[tracker._log_r] == pytest.approx(before[0], abs=1e-9)
    assert track.belief.covariance[tracker._log_r, tracker._log_r] == pytest.approx(before[1], rel=0.05)
    assert estimate.soc == pytest.approx(0.6, abs=0.03)
    assert estimate.soc_sd <= first.soc_sd


def test_waiting_does_not_make_the_curve_more_certain(tracker):
    """The curve's own error does not average out: ten minutes at rest say no more of the charge than one."""
    rested = float(tracker.pack.open_circuit(0.6))
    track, sd = None, {}
    for k in range(601):
        track, estimate = tracker.step(track, sample(float(k), rested + 0.02 * np.sin(1.7 * k), 0.3))
        sd[k] = estimate.soc_sd
    slope = float(tracker.pack.open_circuit(0.61) - tracker.pack.open_circuit(0.59)) / 0.02
    of_the_curve = 6 * tracker.uncertainty.voltage_error_v / slope
    assert sd[600] > 0.7 * of_the_curve
    assert sd[600] > 0.8 * sd[60]


def test_resistance_of_another_pack_is_found_and_does_not_pass_for_charge(tracker):
    """The pack's ohmic resistance is twice the file's: charge stays right, the filter says where the difference is."""
    cell = tracker.pack.cell
    name = "r_s" if hasattr(cell, "r_s") else "r_o"
    worn = replace(cell, **{name: 2.0 * getattr(cell, name)})
    t = np.arange(700.0)
    current = np.where(t < 30, 0.3, 30.0 + 5.0 * np.sin(t / 7.0))
    truth = PackModel(worn, 6, tracker.pack.parallel).simulate(t, current, 0.95)
    track = None
    for k in range(t.size):
        track, estimate = tracker.step(track, sample(t[k], truth.voltage[k], current[k]))
    assert estimate.soc == pytest.approx(truth.soc[-1], abs=0.05)
    assert track.belief.mean[tracker._log_r] == pytest.approx(np.log(2.0), abs=0.25)


def test_ninety_percent_bands_hold_the_truth_about_ninety_percent_of_the_time(generic):
    """Packs drawn from what the file says of itself: resistance, polarisation, capacity, curve."""
    u = Uncertainty(voltage_error_v=0.012, resistance=0.25, polarisation=0.25, capacity=0.04)
    cell = generic.circ
    tracker = Tracker(Model.CIRC, cell, 6, 16.0 * 3600.0 / cell.capacity_c, (), u)
    rng = np.random.default_rng(8)
    t = np.arange(900.0)
    inside, widths = [], []
    for _ in range(40):
        log_r, log_p, log_c = rng.normal(0.0, [u.resistance, u.polarisation, u.capacity])
        pack = PackModel(
            type(cell)(
                ocv=cell.ocv, c_max=cell.c_max * np.exp(log_c), r_s=cell.r_s * np.exp(log_r),
                r_sp0=cell.r_sp0 * np.exp(log_p), r_sp1=cell.r_sp1 * np.exp(log_p), r_sp2=cell.r_sp2, c_sp=cell.c_sp,
            ), 6, tracker.pack.parallel,
        )  # fmt: skip
        current = np.where(t < 20, 0.3, 38.0 * (1 + 0.1 * rng.standard_normal(t.size)))
        run = pack.simulate(t, current, 0.97)
        misshapen = 6 * u.voltage_error_v * np.sin(run.soc * 2 * np.pi / 0.6 + rng.uniform(0, 6.3)) * rng.normal()
        volts = run.voltage + misshapen + 0.02 * rng.standard_normal(t.size)
        track = None
        for k in range(t.size):
            track, estimate = tracker.step(track, sample(t[k], volts[k], current[k]))
            if k in (150, 400, 650, 899):
                inside.append(estimate.soc_low <= run.soc[k] <= estimate.soc_high)
                widths.append(estimate.soc_high - estimate.soc_low)
    assert 0.80 <= np.mean(inside) <= 0.99
    assert np.mean(widths) < 0.12
