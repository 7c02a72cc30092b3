from pathlib import Path

import pytest

from bhm_service.guess import guess_vehicle
from bhm_service.mavlink.log import read_log
from bhm_service.messages import BatteryStatus, ParameterValue


def guess(path, battery_id=None):
    log = read_log(path)
    return guess_vehicle((m for _, m in log.messages), battery_id, path.stem)


@pytest.mark.parametrize(
    ("file", "series", "capacity", "because"),
    [
        ("flights/tlog/acuasi_quad_flight1.tlog", 4, (4.0, 4.0), "BATT_CAPACITY"),
        ("flights/bin/joey_y6_2014-10-18.bin", 4, (6.0, 6.0), "BATT_CAPACITY"),
        ("flights/tlog/pterosoar_hexa_2022-06-02.tlog", 6, (6.0, 9.0), "two rests"),
        ("flights/wadl_m100/waddle1_20191202_145649.csv", 6, (4.4, 6.0), "gauge"),
        ("sitl/px4_no_current_sensor.tlog", 4, (1.0, 9.0), "no current was measured"),
    ],
)
def test_real_vehicles_are_guessed_about_right_and_it_is_said_from_what(data, file, series, capacity, because):
    found = guess(data / file)
    assert found.vehicle.battery.series == series
    assert capacity[0] <= found.vehicle.battery.capacity_ah <= capacity[1]
    assert because in " ".join(found.reasons)


def test_what_the_autopilots_parameters_say_goes_before_what_is_measured():
    messages = [
        ParameterValue(time_s=0.0, name="BAT1_N_CELLS", value=6.0),
        ParameterValue(time_s=0.0, name="BAT1_CAPACITY", value=12000.0),
        *(status(k, 20.8, 15.0) for k in range(30)),
    ]
    found = guess_vehicle(messages, None, "x")
    assert (found.vehicle.battery.series, found.vehicle.battery.capacity_ah) == (6, 12.0)


def status(time_s, volts, amps, battery_id=0):
    return BatteryStatus(
        time_s=float(time_s), battery_id=battery_id, voltage_v=volts, cells_v=None, current_a=amps, temperature_k=None,
        consumed_c=None, remaining=None,
    )  # fmt: skip


def test_an_unset_capacity_is_no_capacity():
    messages = [ParameterValue(time_s=0.0, name="BAT_CAPACITY", value=-1.0)]
    found = guess_vehicle([*messages, *(status(k, 16.2, 14.0) for k in range(60))], None, "x")
    assert found.vehicle.battery.capacity_ah == pytest.approx(4.0)
    assert found.vehicle.battery.capacity_sd == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("volts", "series"), [(4.1, 1), (8.3, 2), (12.6, 3), (16.7, 4), (25.1, 6), (33.4, 8), (50.2, 12)]
)
def test_cells_from_the_voltage(volts, series):
    assert guess_vehicle([status(k, volts, 1.0) for k in range(30)], None, "x").vehicle.battery.series == series


@pytest.mark.parametrize(
    ("volts", "series"), [(8.7, 2), (17.3, 4), (26.1, 6), (34.7, 8), (43.4, 10), (22.2, 6), (30.4, 8), (44.8, 12)]
)
def test_cells_charged_to_more_than_usual_are_not_more_cells_that_are_empty(volts, series):
    assert guess_vehicle([status(k, volts, 1.0) for k in range(30)], None, "x").vehicle.battery.series == series


def test_every_flight_of_a_fleet_on_lihv_packs_has_its_six_cells(data):
    """Charged to 4.35 V each: the logs that begin with a full pack at rest show it."""
    found = [guess(path) for path in sorted((data / "flights" / "wadl_m100").glob("*.csv"))]
    assert {g.vehicle.battery.series for g in found} == {6}
    lihv = [g for g in found if Path(g.vehicle.battery.file).name == "generic-lihv.toml"]
    assert len(lihv) > 30
    assert all("LiHV cells, by 4." in " ".join(g.reasons) for g in lihv)


def test_a_pack_charged_as_usual_is_no_lihv(data):
    for file in ("pterosoar_hexa/2022-06-02_15-27-04.csv", "karl_fpv/flight_28.csv", "joey_y6/2014-10-18_20-04-24.csv"):
        assert Path(guess(data / "flights" / file).vehicle.battery.file).name == "generic-lipo.toml"


def test_one_wrong_reading_makes_no_cell():
    messages = [status(k, 30.0 if k == 7 else 16.5, 1.0) for k in range(100)]
    assert guess_vehicle(messages, None, "x").vehicle.battery.series == 4


def test_of_two_batteries_the_first_is_followed_unless_told():
    messages = [status(k, 12.5 if k % 2 else 25.0, 5.0, battery_id=1 if k % 2 else 0) for k in range(60)]
    assert guess_vehicle(messages, None, "x").vehicle.battery.series == 6
    assert guess_vehicle(messages, 1, "x").vehicle.battery.series == 3
