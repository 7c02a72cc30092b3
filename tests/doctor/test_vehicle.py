"""What the doctor makes of what came over the links."""

from __future__ import annotations

from dataclasses import replace

import pytest
from executive.flight import quad

from bhm_service.doctor.finding import Level
from bhm_service.doctor.vehicle import Heard, parameters_of, vehicle
from bhm_service.messages import (
    AutopilotKind,
    BatteryStatus,
    Heartbeat,
    LinkReport,
    LinkState,
    LinkStatus,
    ParameterValue,
    SystemStatus,
)

SERIAL, UDP = "serial:/dev/ttyUSB0:57600", "udpin:0.0.0.0:14550"
COUNTS = dict.fromkeys(
    ["bytes_in", "frames_in", "frames_out", "lost_out", "stray_bytes", "bad_checksums", "duplicates", "unsigned",
     "forged", "replayed", "opened", "requests"], 0,
)  # fmt: skip
GOOD_SETTINGS = {"BATT_OPTIONS": 0.0, "BATT_MONITOR": 4.0, "BATT_AMP_PERVLT": 39.8, "BATT_CAPACITY": 5000.0}


def heard(
    status=LinkStatus.ALIVE, url=UDP, because="ArduPilot, system 1", settings=GOOD_SETTINGS, armed=False, volts=15.8,
    amps=0.6, battery_id=0, rate=1.0, kind=AutopilotKind.ARDUPILOT, system=True, **counts,
):  # fmt: skip
    """Ten seconds of a vehicle."""
    told = Heard(seconds=10.0)
    numbers = COUNTS | {"bytes_in": 3000, "frames_in": 100} | counts
    told.hear(LinkState(time_s=0.0, link=0, url=url, status=status, because=because))
    told.hear(LinkReport(time_s=9.0, link=0, status=status, **numbers))
    if status is not LinkStatus.ALIVE:
        return told
    told.hear(Heartbeat(time_s=1.0, system=1, component=1, kind=kind, armed=armed))
    for k in range(round(8 * rate)):
        told.hear(
            BatteryStatus(time_s=2.0 + k, battery_id=battery_id, voltage_v=volts, cells_v=None, current_a=amps,
                          temperature_k=None, consumed_c=None, remaining=None)
        )  # fmt: skip
    for k in range(8 if system else 0):
        told.hear(SystemStatus(time_s=2.0 + k, voltage_v=volts, current_a=amps, remaining=None))
    for name, value in settings.items():
        told.hear(ParameterValue(time_s=3.0, name=name, value=value))
    return told


def found(told):
    return [(f.level, f.what, f.mend) for f in vehicle(told, quad()) if f.level is not Level.GOOD]


def test_a_vehicle_with_which_all_is_well_has_nothing_to_mend():
    findings = vehicle(heard(), quad())
    assert {f.level for f in findings} == {Level.GOOD}
    assert len(findings) == 5


@pytest.mark.parametrize(
    ("told", "level", "what", "mend"),
    [
        (heard(LinkStatus.DOWN, because="no such device"), Level.BAD, "no such device", "goes on trying"),
        (heard(LinkStatus.OPEN, SERIAL, bytes_in=0), Level.BAD, "nothing came", "TX to RX"),
        (heard(LinkStatus.OPEN, UDP, bytes_in=0), Level.BAD, "nothing came", "router"),
        (heard(LinkStatus.OPEN, SERIAL, frames_in=0), Level.BAD, "3000 bytes came, and no MAVLink frame", "baud"),
        (heard(LinkStatus.OPEN, forged=7), Level.BAD, "7 with no or a wrong signature", "signing key"),
        (heard(bad_checksums=30), Level.DOUBTFUL, "23 % of the frames are damaged", "cable"),
        (heard(rate=0.0, system=False), Level.BAD, "no battery data, although it was asked for", "SRn_EXTRA3"),
        (heard(rate=0.0), Level.DOUBTFUL, "SYS_STATUS stands in", "BATT_MONITOR"),
        (heard(rate=0.25), Level.BAD, "0.2 times a second, not once", "SRn_EXTRA3"),
        (heard(battery_id=1), Level.BAD, "battery 0 is not reported, but 1", "battery.id"),
        (heard(volts=None), Level.BAD, "the voltage is not measured", "BATT_VOLT_PIN"),
        (heard(volts=23.4), Level.BAD, "5.85 V a cell with 4 in series", "battery.series"),
        (heard(amps=None), Level.BAD, "the current is not measured", "power module"),
        (heard(amps=4.2), Level.BAD, "4.20 A while disarmed", "BATT_AMP_OFFSET"),
        (heard(amps=-2.0), Level.BAD, "charges its battery?", "sign or offset"),
        (heard(amps=0.0), Level.DOUBTFUL, "0.00 A although the electronics draw some", "clamp meter"),
        (heard(settings=GOOD_SETTINGS | {"BATT_OPTIONS": 65.0}), Level.BAD, "sag-compensated", "BATT_OPTIONS = 1 "),
        (heard(settings=GOOD_SETTINGS | {"BATT_AMP_PERVLT": 17.0}), Level.DOUBTFUL, "never calibrated", "clamp meter"),
        (heard(settings=GOOD_SETTINGS | {"BATT_CAPACITY": 3300.0}), Level.DOUBTFUL, "3.3 Ah", "label"),
        (heard(settings={}), Level.DOUBTFUL, "settings cannot be read", "BATT_OPTIONS"),
        (heard(kind=AutopilotKind.PX4, settings={"BAT1_A_PER_V": -1.0}), Level.BAD, "BAT1_A_PER_V", "power module"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_each_trouble_is_named_with_what_to_do(told, level, what, mend):
    ((was, said, do),) = found(told)
    assert was is level
    assert what in said
    assert mend in do


def test_a_label_beside_a_pack_that_was_identified_is_told():
    ours = quad()
    pack = replace(ours, battery=replace(ours.battery, name="mine", series=4))
    ((level, what, mend),) = [
        (f.level, f.what, f.mend) for f in vehicle(heard(), pack) if f.level is not Level.GOOD and "label" not in f.mend
    ]
    assert level is Level.DOUBTFUL
    assert "is not used: mine is a pack of" in what
    assert "series" in mend


def test_a_current_in_flight_is_no_offset():
    assert found(heard(amps=18.0, armed=True)) == []


def test_the_second_batterys_settings_have_other_names():
    assert parameters_of(AutopilotKind.ARDUPILOT, 1)[0] == "BATT2_OPTIONS"
    assert parameters_of(AutopilotKind.PX4, 0)[0] == "BAT1_SOURCE"
    assert parameters_of(AutopilotKind.OTHER, 0) == ()
