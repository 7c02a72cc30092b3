import pytest

from bhm_service.apps.reader import ReaderApp
from bhm_service.messages import EventCode, ParameterValue, Severity


@pytest.mark.parametrize(
    ("battery", "name", "value", "warned"),
    [
        (0, "BATT_OPTIONS", 64.0, True),
        (0, "BATT_OPTIONS", 65.0, True),
        (0, "BATT_OPTIONS", 63.0, False),
        (0, "BATT2_OPTIONS", 64.0, False),
        (1, "BATT2_OPTIONS", 64.0, True),
        (0, "BATT_CAPACITY", 64.0, False),
    ],
)
def test_a_voltage_that_the_autopilot_imagines_is_warned_of(battery, name, value, warned):
    reader = ReaderApp(battery, series=4, rest_a=1.0, airborne_a=3.5)
    events = reader.on_message(ParameterValue(time_s=1.0, name=name, value=value))
    assert [(e.code, e.severity) for e in events] == [(EventCode.SAG_COMPENSATED, Severity.WARNING)] * warned
