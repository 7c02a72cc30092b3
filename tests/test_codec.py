"""What is written down is what is read back, to the last bit."""

import json
import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bhm_service.apps.estimator import EstimatorState
from bhm_service.apps.limits import LimitsState
from bhm_service.apps.predictor import PredictorState
from bhm_service.apps.publisher import PublisherState
from bhm_service.apps.reader import ReaderState
from bhm_service.codec import NotThisKindError, packed, unpacked
from bhm_service.messages import BatterySample, Message, StateEstimate
from bhm_service.telemetry import PackWatch, PhaseDetector, SampleMerger


def through_json(kind, value):
    return unpacked(kind, json.loads(json.dumps(packed(value))))


@pytest.mark.parametrize("kind", get_args(Message), ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_every_message_comes_back_as_it_was(kind, data):
    message = data.draw(st.builds(kind))
    again = through_json(kind, message)
    assert type(again) is kind
    assert repr(again) == repr(message)
    assert packed(again) == packed(message) or "nan" in repr(packed(message))


@pytest.mark.parametrize("value", [0.1 + 0.2, 1e-308, -0.0, math.inf, 2.0**53 + 1.0])
def test_a_number_comes_back_to_the_last_bit(value):
    sample = BatterySample(time_s=value, battery_id=0, voltage_v=None, current_a=value, temperature_k=None)
    again = through_json(BatterySample, sample)
    assert again.time_s.hex() == value.hex()


@pytest.mark.parametrize(
    "kind", [ReaderState, EstimatorState, PredictorState, PublisherState, LimitsState], ids=lambda kind: kind.__name__
)
def test_what_every_app_remembers_can_be_read_back(kind, flown_states):
    name = next(n for n, (of, _) in flown_states.items() if of is kind)
    state = flown_states[name][1]
    assert packed(through_json(kind, state)) == packed(state)


@pytest.fixture(scope="module")
def flown_states():
    """What the apps remember in the middle of a flight."""
    from executive.flight import flying_bus

    bus = flying_bus(seconds=40)
    return {app.name: (app._app.keeps, app._app.state()) for app in bus.apps if hasattr(app._app, "keeps")}


def test_the_large_fields_may_be_left_out():
    assert "covariance" not in packed(estimate(), bulk=False)
    assert "covariance" in packed(estimate())


def estimate():
    from apps.test_publisher import estimate as made

    from bhm_service.messages import Model

    return made(Model.CIRC)


@pytest.mark.parametrize(
    "data",
    [None, 3, [], {"time_s": "now"}, {"time_s": 1.0}, {"time_s": True, "model": "circ"}, {"model": "lead"}],
    ids=repr,
)
def test_anything_else_is_refused(data):
    with pytest.raises(NotThisKindError):
        unpacked(StateEstimate, data)


def test_a_field_that_is_new_since_then_has_its_default_and_one_that_is_gone_is_passed_over():
    state = {"battery_id": 1, "armed": True, "colour": "red"}
    assert unpacked(SampleMerger, state) == SampleMerger(1, armed=True)
    watch = PackWatch(4, 1.0)
    assert unpacked(PackWatch, packed(watch)) == watch
    assert unpacked(PhaseDetector, packed(PhaseDetector(9.0))) == PhaseDetector(9.0)


def test_what_cannot_be_written_says_so():
    with pytest.raises(TypeError, match="complex cannot be written"):
        packed(1j)
    assert packed(np.float64(0.5)) == 0.5
