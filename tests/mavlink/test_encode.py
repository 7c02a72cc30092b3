import math

import pytest
from mavlink.frames import mav

from bhm_service.mavlink.decode import VehicleDecoder
from bhm_service.mavlink.dialect import mavlink
from bhm_service.mavlink.encode import FrameEncoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.messages import AutopilotKind, BatteryStatus, Heartbeat, NamedValue, Severity, StatusText


def parsed(frame):
    """What pymavlink's own parser makes of a frame."""
    return mav.MAVLink(None).parse_char(frame)


def test_a_named_value_is_read_back_by_pymavlink():
    encoder = FrameEncoder(system=42)
    message = parsed(encoder.named_value(NamedValue(time_s=0.0, boot_ms=123456, name="BHM_RFT", value=512.25)))
    assert message.get_type() == "NAMED_VALUE_FLOAT"
    assert (message.get_srcSystem(), message.get_srcComponent()) == (42, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    assert (message.time_boot_ms, message.name, message.value) == (123456, "BHM_RFT", 512.25)


def test_frames_are_numbered():
    encoder = FrameEncoder(1)
    value = NamedValue(time_s=0.0, boot_ms=0, name="BHM_SOC", value=0.5)
    assert [parsed(encoder.named_value(value)).get_seq() for _ in range(300)] == [k % 256 for k in range(300)]


@pytest.mark.parametrize(
    ("name", "value"),
    [("BHM_RFT_LOW", 1.0), ("", 1.0), ("BHM_RFT", math.nan), ("BHM_RFT", math.inf), ("BHM_RFT", 3.5e38)],
)
def test_what_the_wire_cannot_carry_is_never_sent(name, value):
    with pytest.raises(ValueError, match=r"reach every ground station|only finite"):
        FrameEncoder(1).named_value(NamedValue(time_s=0.0, boot_ms=0, name=name, value=value))


@pytest.mark.parametrize("volts", [None, 3.7, 25.2, 65.534, 70.0, 130.0])
@pytest.mark.parametrize("amps", [None, 0.0, 31.4])
def test_a_battery_status_comes_back_as_it_was(volts, amps):
    status = BatteryStatus(
        time_s=9.0, battery_id=3, voltage_v=volts, cells_v=None, current_a=amps, temperature_k=None, consumed_c=None,
        remaining=None,
    )  # fmt: skip
    encoder = FrameEncoder(1, component=1)
    decoder = VehicleDecoder()
    said = []
    beat = Heartbeat(time_s=9.0, system=1, component=1, kind=AutopilotKind.OTHER, armed=True)
    for raw in (encoder.autopilot_heartbeat(beat), encoder.battery_status(status)):
        for frame in FrameSplitter().feed(raw):
            said = decoder.decode(frame.message_id, frame.payload, frame.source, 9.0)
    (back,) = said
    assert back.voltage_v == (None if volts is None else pytest.approx(volts, abs=1e-3))
    assert back.current_a == amps
    assert back.temperature_k is None


def test_we_say_that_we_are_an_onboard_computer_and_no_autopilot():
    message = parsed(FrameEncoder(7).companion_heartbeat())
    assert message.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    assert message.autopilot == mavlink.MAV_AUTOPILOT_INVALID
    assert VehicleDecoder().decode(0, bytes(message.get_payload()), (7, 191), 0.0) == []


@pytest.mark.parametrize(("length", "chunks"), [(0, 1), (50, 1), (51, 2), (130, 3)])
def test_a_sentence_goes_out_in_chunks_of_fifty_that_belong_together(length, chunks):
    words = ("land now, " * 20)[:length]
    frames = FrameEncoder(1).status_text(StatusText(time_s=0.0, severity=Severity.CRITICAL, text=words))
    heard = [parsed(frame) for frame in frames]
    assert len(heard) == chunks
    assert {m.severity for m in heard} == {2}
    assert [m.chunk_seq for m in heard] == list(range(chunks))
    assert len({m.id for m in heard}) == 1
    assert (heard[0].id == 0) == (chunks == 1)
    assert "".join(m.text for m in heard) == words
