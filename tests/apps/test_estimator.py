"""What the estimator says beside its estimates."""

from __future__ import annotations

import pytest

from bhm_service.apps.estimator import EstimatorApp
from bhm_service.battery.battery_file import read_battery
from bhm_service.config import shipped
from bhm_service.estimation.tracker import Tracker
from bhm_service.messages import BatterySample, Event, EventCode, Model


def said(file, *cell_volts, model=Model.CIRC):
    app = EstimatorApp(Tracker(model, read_battery(shipped("batteries", file)).cell(model.value), 6, 1.0))
    samples = [
        BatterySample(time_s=float(k), battery_id=0, voltage_v=6.0 * volts, current_a=0.5, temperature_k=None)
        for k, volts in enumerate(cell_volts)
    ]
    return [m for sample in samples for m in app.on_message(sample) if isinstance(m, Event)]


@pytest.mark.parametrize("model", list(Model))
def test_a_pack_that_is_fuller_than_its_file_knows_is_told_once(model):
    (event,) = said("generic-lipo.toml", 4.33, 4.33, 4.33, model=model)
    assert event.code is EventCode.FULLER_THAN_FULL
    assert "4.33 V a cell" in event.text
    assert "generic-lihv.toml" in event.text


@pytest.mark.parametrize(
    ("file", "volts"), [("generic-lipo.toml", 4.22), ("generic-lipo.toml", 4.6), ("generic-lihv.toml", 4.36)]
)
def test_a_full_pack_of_its_file_is_told_nothing_of_nor_a_wrong_reading(file, volts):
    assert said(file, volts, volts) == []
