import random

import numpy as np
import pytest
from mavlink.frames import Sender, battery_status, heartbeat, stamped, system_time, tlog

from bhm_service.errors import BadInputError
from bhm_service.mavlink.dataflash import DataFlashReader
from bhm_service.mavlink.log import LogKind, read_log
from bhm_service.mavlink.recording import battery_ids, record
from bhm_service.messages import BatteryStatus, Heartbeat, LandedState


def messages_of(log, kind):
    return [m for _, m in log.messages if isinstance(m, kind)]


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("flights/tlog/acuasi_quad_flight1.tlog", LogKind.TLOG),
        ("flights/bin/joey_y6_2014-10-18.bin", LogKind.DATAFLASH),
        ("flights/wadl_m100/waddle1_20191202_145649.csv", LogKind.TABLE),
        ("lab/maxamps_lipo5450/cell_1C_cycle01.csv.gz", LogKind.TABLE),
    ],
)
def test_content_tells_what_a_log_is_whatever_it_is_called(data, tmp_path, file, kind):
    renamed = tmp_path / ("log.gz" if file.endswith(".gz") else "log")
    renamed.write_bytes((data / file).read_bytes())
    log = read_log(renamed)
    assert log.kind is kind
    assert messages_of(log, BatteryStatus)


def test_telemetry_and_dataflash_log_of_one_flight_agree(data):
    """Two readers, two formats, one flight of real ArduPilot firmware: the same battery."""
    sitl = data / "sitl"
    by_radio = record(read_log(sitl / "arducopter_two_batteries_failsafe.tlog"), 0, 3, 2.2 * 3600)
    by_card = record(read_log(sitl / "arducopter_two_batteries_failsafe.bin"), 0, 3, 2.2 * 3600)
    radio, card = by_radio.flights[0], by_card.flights[0]
    # One logs by its own clock, the other by the receiver's: lay the take-offs over each other.
    t_radio = by_radio.time_s - by_radio.time_s[radio.begin]
    t_card = by_card.time_s - by_card.time_s[card.begin]
    shifts = np.arange(-8.0, 8.0, 0.1)
    inside = (t_radio > 10.0) & (t_radio < 110.0)
    misfit = [
        np.sqrt(np.mean((by_radio.current_a[inside] - np.interp(t_radio[inside] + s, t_card, by_card.current_a)) ** 2))
        for s in shifts
    ]
    best = shifts[int(np.argmin(misfit))]
    volts = np.interp(t_radio[inside] + best, t_card, by_card.voltage_v)
    assert np.sqrt(np.mean((by_radio.voltage_v[inside] - volts) ** 2)) < 0.03
    used = [by_radio.charge_c[radio.end - 1] - by_radio.charge_c[radio.begin]]
    used.append(by_card.charge_c[card.end - 1] - by_card.charge_c[card.begin])
    assert used[0] == pytest.approx(used[1], rel=0.03)


@pytest.mark.parametrize(
    ("log", "table"),
    [
        ("tlog/pterosoar_hexa_2022-06-02.tlog", "pterosoar_hexa/2022-06-02_15-27-04.csv"),
        ("tlog/acuasi_quad_flight1.tlog", "acuasi_quad/Flight_1_2018-04-27_11-16-16_tlog.csv"),
    ],
)
def test_a_log_is_what_others_took_out_of_it(data, log, table):
    ours = record(read_log(data / "flights" / log), 0, 4, 4 * 3600)
    theirs = record(read_log(data / "flights" / table), 0, 4, 4 * 3600)
    t_ours, t_theirs = ours.time_s - ours.time_s[0], theirs.time_s - theirs.time_s[0]
    at = np.linspace(5.0, min(t_ours[-1], t_theirs[-1]) - 5.0, 400)
    for name, close in (("voltage_v", 0.06), ("current_a", 1.0)):
        difference = np.interp(at, t_ours, getattr(ours, name)) - np.interp(at, t_theirs, getattr(theirs, name))
        assert np.median(np.abs(difference)) < 0.2 * close
        assert np.sqrt(np.mean(difference**2)) < 5 * close


def test_batteries_are_told_apart_by_their_id(data):
    log = read_log(data / "sitl" / "arducopter_two_batteries_failsafe.tlog")
    assert battery_ids(m for _, m in log.messages) == {0, 1}
    first, second = record(log, 0, 3, 7920.0), record(log, 1, 14, 7920.0)
    assert np.all(np.isnan(first.temperature_k))
    assert np.nanmedian(second.temperature_k) == pytest.approx(288.1, abs=1.0)
    with pytest.raises(BadInputError, match=r"battery id 7: no sample of it; ids in this log: 0, 1"):
        record(log, 7, 3, 7920.0)


def test_px4_without_a_current_sensor_measures_no_current(data):
    log = read_log(data / "sitl" / "px4_no_current_sensor.tlog")
    assert all(m.current_a is None for m in messages_of(log, BatteryStatus))
    recording = record(log, 0, 4, 18000.0)
    assert np.all(np.isnan(recording.current_a))
    assert recording.voltage_v[0] == pytest.approx(16.2)
    assert len(recording.flights) == 1


def test_flights_inside_one_log_are_found(data):
    log = read_log(data / "flights" / "tlog" / "pterosoar_hexa_2022-06-02.tlog")
    recording = record(log, 0, 6, 7.3 * 3600)
    lengths = [recording.time_s[f.end - 1] - recording.time_s[f.begin] for f in recording.flights]
    assert lengths == pytest.approx([340, 285, 113], abs=12)


def test_a_pack_that_was_swapped_between_flights_is_noticed(data):
    log = read_log(data / "flights" / "tlog" / "acuasi_quad_flight5.tlog")
    changes = record(log, 0, 4, 4 * 3600).pack_changes
    assert len(changes) == 1
    assert "nothing was heard" in changes[0][1]


def test_a_reboot_with_the_same_pack_is_no_change(data):
    """The autopilot of this flight was rebooted on the ground; its own percentage went from 69 to 99."""
    recording = record(read_log(data / "flights" / "tlog" / "acuasi_quad_flight1.tlog"), 0, 4, 4 * 3600)
    assert recording.pack_changes == ()
    assert np.nanmax(recording.remaining) - recording.remaining[0] > 0.25


@pytest.mark.parametrize(("flight", "celsius"), [(1, None), (3, 25.83), (5, 20.44)])
def test_a_board_is_cold_only_where_the_log_begins_soon_after_its_boot(data, flight, celsius):
    """30 and 72 s after it; the first flight's begins 20 min after one, and has another."""
    recording = record(read_log(data / "flights" / "tlog" / f"acuasi_quad_flight{flight}.tlog"), 0, 4, 4 * 3600)
    assert recording.cold_board_k == (None if celsius is None else pytest.approx(celsius + 273.15))


def test_a_board_is_followed_all_along(data):
    recording = record(read_log(data / "flights" / "tlog" / "acuasi_quad_flight5.tlog"), 0, 4, 4 * 3600)
    told = recording.board_k[np.isfinite(recording.board_k)]
    assert told.size > 0.95 * recording.board_k.size
    assert told[0] == pytest.approx(recording.cold_board_k, abs=2.0)
    assert told.max() - told[0] > 5.0  # it warms by itself


def test_old_dataflash_in_centivolts_is_read_in_volts(data):
    log = read_log(data / "flights" / "bin" / "joey_y6_2014-10-18.bin")
    status = messages_of(log, BatteryStatus)
    assert status[0].voltage_v == pytest.approx(16.40)
    assert status[0].current_a == pytest.approx(2.94)
    assert messages_of(log, Heartbeat)[0].armed
    assert messages_of(log, LandedState)


def test_damaged_dataflash_is_read_as_far_as_it_goes(data, tmp_path):
    raw = bytearray((data / "flights" / "bin" / "joey_y6_2014-10-18.bin").read_bytes())
    rng = random.Random(14)
    for _ in range(5):
        at = rng.randrange(60_000, len(raw) - 2_000)
        raw[at : at + 300] = bytes(rng.randrange(256) for _ in range(300))
    path = tmp_path / "damaged.bin"
    path.write_bytes(raw[:-7])
    reader = DataFlashReader(path)
    found = [m for m in reader if isinstance(m, BatteryStatus)]
    assert len(found) >= 327
    assert 1200 < reader.skipped.bytes < 2500
    assert reader.skipped.places == 5
    assert reader.skipped.truncated


def test_tables_with_bad_rows_keep_the_good_ones(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_text("t_s,V,I\n0,16.0,1\n1,abc,2\nx,15.8,3\n3,15.7,\n4,nan,5\n")
    log = read_log(path)
    status = messages_of(log, BatteryStatus)
    assert [(m.time_s, m.voltage_v, m.current_a) for m in status] == [
        (0.0, 16.0, 1.0), (1.0, None, 2.0), (3.0, 15.7, None), (4.0, None, 5.0),
    ]  # fmt: skip
    assert "1 rows" in " ".join(log.remarks())


def test_a_table_may_have_its_cells_in_columns(tmp_path):
    """One that was not read leaves its sample without cells; all alike they are an average, as in a tlog."""
    path = tmp_path / "flight.csv"
    path.write_text("t_s,V,I,cell2_V,cell1_V\n0,7.9,1,3.9,4.0\n1,7.8,1,,4.0\n2,7.8,1,3.9,3.9\n3,7.7,1,3.8,3.9\n")
    assert [m.cells_v for m in messages_of(read_log(path), BatteryStatus)] == [(4.0, 3.9), None, None, (3.9, 3.8)]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"hello, this is a letter\nand no log\n", "column t_s or time_s is missing"),
        (b"\x00\x01\x02" * 500, "not a log that can be read"),
        (b"\x89PNG\r\n\x1a\n" + bytes(range(200)) * 9, "not a log that can be read"),
        (stamped(Sender()(battery_status()), 0.0) * 5, "no message of an autopilot"),
        (b"\xa3\x95\x80", "no message of an autopilot"),
        (b"\x1f\x8b garbage that is not gzip", "damaged gzip"),
        (b"t_s,V\n0,16\n", "column I or current_A is missing"),
        (b"t_s,V,I,cell1_V,cell3_V\n0,16,1,4,4\n", "column cell2_V is missing"),
    ],
)
def test_what_is_no_log_is_said_to_be_none(tmp_path, content, said):
    path = tmp_path / "thing.tlog"
    path.write_bytes(content)
    with pytest.raises(BadInputError) as why:
        read_log(path)
    assert said in str(why.value)
    assert str(path) in str(why.value)


def test_other_vehicles_and_clock_jumps_are_remarked(tmp_path):
    both = b"".join(
        stamped(Sender(system)(message), k + (5000.0 if k > 20 else 0.0))
        for k in range(40)
        for system in (1, 2)
        for message in (heartbeat(), battery_status(), system_time(1000 * k))
    )
    path = tmp_path / "two.tlog"
    path.write_bytes(both)
    log = read_log(path)
    remarks = " ".join(log.remarks())
    assert "system 2" in remarks
    assert "clock was set 1 time" in remarks
    assert log.span_s[1] - log.span_s[0] == pytest.approx(39.0, abs=0.1)


def test_system_and_place_of_a_tlogs_messages(tmp_path):
    path = tmp_path / "one.tlog"
    path.write_bytes(tlog([(0.0, heartbeat()), (1.0, battery_status())], Sender(system=42)))
    log = read_log(path)
    assert log.system == 42
    assert [place for place, _ in log.messages] == [(0, 29), (29, 29 + 8 + 12 + 36)] or log.messages[1][0][0] == 29


@pytest.mark.parametrize("kind", ["tlog", "bin"])
def test_single_cells_add_up_to_their_pack_by_radio_and_by_card(data, kind):
    """Of a battery whose fourteen cells the firmware simulates; of a pack of another number there is no telling."""
    log = read_log(data / "sitl" / f"arducopter_two_batteries_failsafe.{kind}")
    recording = record(log, 1, 14, 7920.0)
    known = np.isfinite(recording.cells_v).all(axis=1)
    assert known.mean() > 0.95
    # Each is cut to whole millivolts; a second's mean may hold another number of cells' readings than of the pack's.
    assert np.median(np.abs(recording.cells_v.sum(axis=1) - recording.voltage_v)[known]) < 0.014
    # The simulator has every other cell two tenths of a volt lower.
    steps = np.diff(recording.cells_v[known], axis=1)
    assert np.abs(np.abs(steps) - 0.2).max() < 0.003
    assert np.all(steps[:, ::2] < 0.0)
    assert record(log, 1, 12, 7920.0).cells_v is None
    assert record(log, 0, 3, 7920.0).cells_v is None
