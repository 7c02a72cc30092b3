"""What an effect in the battery file is for: the filter and the predictor that know of it are nearer to the truth."""

import numpy as np
import pytest
from battery.cells import circ
from battery.effects.plausible import joined, sizes

from bhm_service.battery.effects import KNOWN, ResistanceTemperature, SelfHeating
from bhm_service.battery.pack import PackModel
from bhm_service.estimation.tracker import Tracker
from bhm_service.messages import BatterySample, Model
from bhm_service.prediction.end_of_discharge import Limits, end_of_discharge

T = np.arange(0.0, 1000.0, 2.0)
RNG = np.random.default_rng(1)
CURRENT = np.where(T < 30.0, 0.0, 11.0 + 2.5 * RNG.standard_normal(T.size))
NOISE = 0.01 * RNG.standard_normal(T.size)
POWER = np.array([235.0])
LIMITS = Limits(threshold_soc=0.2, cutoff_v=6 * 3.2)
LOOKS = (150, 300, 450)  # samples at which flying time is compared


def flown(effects, voltage, temperature=None, until=T.size):
    """Tracks of a filter with these effects at the looks, and its pack."""
    tracker = Tracker(Model.CIRC, circ(), 6, 1.0, tuple(effects))
    track, seen = None, []
    for k in range(until):
        known = None if temperature is None or np.isnan(temperature[k]) else float(temperature[k])
        sample = BatterySample(
            time_s=float(T[k]), battery_id=0, voltage_v=float(voltage[k]), current_a=float(CURRENT[k]),
            temperature_k=known,
        )  # fmt: skip
        track, _ = tracker.step(track, sample)
        if k in LOOKS or k == until - 1:
            seen.append(track)
    return seen, tracker.pack


def remaining(pack, states, kelvin):
    return end_of_discharge(pack, np.atleast_2d(states), POWER, LIMITS, kelvin)[0][0]


@pytest.mark.parametrize(
    "name",
    ["capacity-fade", "cold-capacity", "unseen-load", "current-gain", "current-offset", "voltage-offset",
     "rate-capacity", "slow-diffusion", "resistance-temperature", "surface-lag",
     "graphite-lag"],
)  # fmt: skip
def test_flying_time_is_at_least_twice_as_near_with_the_effect_as_without(name):
    effects = joined(KNOWN[name], **sizes(KNOWN[name]))
    kelvin = 278.0 if "temperature" in KNOWN[name].drivers else None
    temperature = None if kelvin is None else np.full(T.size, kelvin)
    pack = PackModel(circ(), 6, 1.0, effects)
    run = pack.simulate(T, CURRENT, 0.97, temperature)
    along = [np.broadcast_to(s, T.shape) for s in run.states]
    truth = np.array([remaining(pack, [s[k] for s in along], kelvin) for k in LOOKS])
    errors = []
    for known in (effects, ()):
        tracks, own = flown(known, run.voltage + NOISE, temperature, LOOKS[-1] + 1)
        errors.append(np.abs([remaining(own, t.belief.mean, kelvin) for t in tracks[:3]] - truth))
    assert np.median(errors[1]) > 8.0
    assert np.median(errors[0]) < 0.5 * np.median(errors[1])
    assert np.median(errors[0]) < 5.0


def warming():
    """A pack that warms up from a cold day; the file believes in a mild one."""
    arrhenius = ResistanceTemperature(activation_energy=24e3)
    truth = SelfHeating(heat_capacity=500.0, conductance=1.0, ambient=276.0)
    run = PackModel(circ(), 6, 1.0, [arrhenius, truth]).simulate(T, CURRENT, 0.97)
    file = SelfHeating(heat_capacity=500.0, conductance=1.0, ambient=293.0)
    return run, (arrhenius, file)


def test_a_thermometer_teaches_the_filter_the_packs_temperature_and_the_air_around_it():
    run, effects = warming()
    tracks, pack = flown(effects, run.voltage + NOISE, run.temperature, until=300)
    states = tracks[-1].belief.mean[None, :]
    assert run.temperature[299] - run.temperature[0] > 5.0
    assert pack.carried_temperature(states)[0] == pytest.approx(run.temperature[299], abs=1.0)
    assert states[0, pack.state_names.index("ambient")] == pytest.approx(276.0, abs=5.0)


def test_a_thermometer_that_falls_silent_leaves_a_temperature_that_is_still_known():
    run, effects = warming()
    tracks, pack = flown(effects, run.voltage + NOISE, np.where(T < 600.0, run.temperature, np.nan))
    carried = pack.carried_temperature(tracks[-1].belief.mean[None, :])[0]
    assert carried == pytest.approx(run.temperature[-1], abs=1.5)


def test_prediction_lets_a_pack_that_carries_its_temperature_warm_up():
    run, effects = warming()
    tracks, pack = flown(effects, run.voltage + NOISE, run.temperature)
    bare = PackModel(circ(), 6, 1.0, effects[:1])
    sagging = Limits(threshold_soc=0.02, cutoff_v=6 * 3.3)
    cold = tracks[0].belief.mean
    carried = end_of_discharge(pack, cold[None, :], POWER, sagging, 277.0)[0][0]
    held = end_of_discharge(bare, cold[None, : bare.n_states], POWER, sagging, 277.0)[0][0]
    assert carried > held + 5.0
