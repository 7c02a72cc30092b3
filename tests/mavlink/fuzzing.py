"""Mutated frames and pieces of logs, from programs of bytes that hypothesis draws and shrinks; and what must hold."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import socket
from functools import cache

from fastcrc.crc16 import mcrf4xx
from mavlink.frames import Sender, battery_status, heartbeat, mav, stamped, sys_status, system_time
from mavlink.wire import free_port

from bhm_service.mavlink.decode import WANTED, VehicleDecoder
from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.mavlink.links import Links
from bhm_service.mavlink.tlog import TlogReader
from bhm_service.messages import Event, Heartbeat, LinkReport, LinkState

STEP = 8  # bytes of program for one mutated frame
FRAMES = 40  # in one program
PROGRAM = STEP * FRAMES
KEY = hashlib.sha256(b"ours").digest()
UNIX_S = 1_790_000_000.0
_SIGNED_US = int((UNIX_S - 1_420_070_400) * 1e5)


@cache
def originals(signed=False):
    """A frame of every kind that we read, in both versions of the protocol, from two systems."""
    frames = []
    for system, v1 in ((1, False), (1, True), (2, False)):
        send = Sender(system, v1=v1)
        if signed:
            if v1:
                continue
            sign = send.mav.signing
            sign.secret_key, sign.sign_outgoing, sign.link_id, sign.timestamp = KEY, True, 0, _SIGNED_US
        kinds = [heartbeat(), battery_status(), sys_status(), system_time(1000)]
        for message_id in sorted(WANTED):
            kind = mav.mavlink_map[message_id]
            values = [_some(kind, index) for index in range(len(kind.fieldnames))]
            kinds.append(kind(*values))
        frames += [send(message) for message in kinds if not v1 or message.get_msgId() < 256]
    return frames


def _some(kind, index):
    name, length = kind.fieldtypes[index], kind.array_lengths[kind.ordered_fieldnames.index(kind.fieldnames[index])]
    if name == "char":
        return b"NAME"
    value = 1.5 if name in ("float", "double") else 1
    return [value] * length if length > 1 else value


def checksummed(frame):
    """The frame with the checksum that its bytes should have: nonsense that looks sound."""
    head = 10 if frame[0] == 0xFD else 6
    message_id = int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]
    end = head + frame[1]
    kind = mav.mavlink_map.get(message_id)
    if kind is None or len(frame) < end + 2:
        return frame
    checksum = mcrf4xx(bytes([kind.crc_extra]), mcrf4xx(bytes(frame[1:end])))
    return frame[:end] + checksum.to_bytes(2, "little") + frame[end + 2 :]


def mutated(step, frames):
    """One frame, changed as ``step`` says. A program of zeros changes nothing, so it shrinks to what matters."""
    which, what, at, value, more = step[0], step[1] % 9, int.from_bytes(step[2:4], "big"), step[4], step[5]
    frame = bytearray(frames[which % len(frames)])
    at %= len(frame)
    if what == 1:
        frame[at] ^= 1 << value % 8
    elif what == 2:
        frame[at] = value
    elif what == 3:
        frame[at:at] = bytes([value]) * (1 + more % 30)
    elif what == 4:
        del frame[at : at + 1 + more % 30]
    elif what == 5:
        del frame[at:]
    elif what == 6:
        frame[1] = value  # lies about its length
    elif what == 7:
        frame[at:] = frames[more % len(frames)][at:]
    elif what == 8:
        return checksummed(_nonsense(frame, value, more, at))
    return bytes(frame)


def _nonsense(frame, value, more, at):
    """Fields full of what no sensor says: all ones, not-a-number, noise."""
    head = 10 if frame[0] == 0xFD else 6
    size = frame[1]
    pattern = ((b"\xff", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\xff", b"\x80", bytes([value]), b"\x7f")[more % 6]) * 256
    begin = at % max(size, 1)
    frame[head + begin : head + size] = pattern[: size - begin]
    return frame


def steps(program):
    return [program[k : k + STEP] for k in range(0, len(program) - STEP + 1, STEP)]


def sound(raw):
    """Whether pymavlink, which is not ours, takes these bytes for one whole frame."""
    parser = mav.MAVLink(None)
    try:
        message = parser.decode(bytearray(raw))
    except (mav.MAVError, IndexError):  # of no bytes at all
        return False
    return message is not None


# ---- what must hold -------------------------------------------------------------------------------------------------


def stream_gives_only_sound_frames(program):
    """Whatever the stream and its pieces: each frame found is sound, is in the stream, and comes in its order."""
    stream = b"".join(mutated(step, originals()) for step in steps(program))
    splitter, found, at = FrameSplitter(), [], 0
    while at < len(stream):
        size = 1 + program[at % len(program)]
        found += splitter.feed(stream[at : at + size])
        at += size
    assert len(splitter._left) <= 280
    place = 0
    for frame in found:
        place = stream.index(frame.raw, place) + len(frame.raw)
        assert sound(frame.raw)


def nonsense_that_looks_sound_gives_finite_messages(program):
    """No payload raises in the decoder, and no number that leaves it is not finite."""
    decoder, splitter = VehicleDecoder(), FrameSplitter()
    for step in steps(program):
        for frame in splitter.feed(mutated(step[:1] + b"\x08" + step[2:], originals())):
            for message in decoder.decode(frame.message_id, frame.payload, frame.source, 1.0):
                _finite(message)


def _finite(message):
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        for one in value if isinstance(value, tuple) else (value,):
            assert not isinstance(one, float) or math.isfinite(one), message


class SignedLinks:
    """Our links with a key, over a real socket, with a vehicle that they know."""

    def __init__(self):
        port = free_port(socket.SOCK_DGRAM)
        self.now = 0.0
        self.links = Links([f"udpin:127.0.0.1:{port}"], key=KEY, clock=lambda: self.now, wall=lambda: UNIX_S)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._vehicle = Sender()
        sign = self._vehicle.mav.signing
        sign.secret_key, sign.sign_outgoing, sign.timestamp = KEY, True, _SIGNED_US + 1000
        self.send(*originals(signed=True))  # heard once: from now on each of them is a replay
        self.speak()

    def send(self, *frames):
        for frame in frames:
            self._socket.send(frame)
        said = []
        while found := self.links.poll(0.0):
            said += [m for _, m in found if not isinstance(m, (Event, LinkReport, LinkState))]
        return said

    def speak(self):
        """The vehicle's own next frame is believed."""
        assert [type(m) for m in self.send(self._vehicle(heartbeat()))] == [Heartbeat]

    def state(self):
        signer = self.links._signer
        return self.links.vehicle, self.links.encoder.system, dict(signer._streams), dict(self.links._bearers)

    def close(self):
        self._socket.close()
        self.links.close()

    def forged_frames_change_nothing(self, program):
        """Mutated, replayed or unsigned: nothing is said of them, nothing remembered, and the real vehicle is heard."""
        before = self.state()
        frames = [mutated(step, originals(signed=bool(step[6] % 2))) for step in steps(program)]
        assert self.send(*(frame for frame in frames if frame)) == []
        now = self.state()
        assert now == before
        self.send(bytes(300))  # what is left of a stream that was cut off
        self.now += 1.0
        self.speak()


def pieces_of_a_log_give_only_sound_frames(program):
    """Whatever the log: the reader ends, raises nothing, and each frame that it gives is sound."""
    log = b"".join(stamped(mutated(step, originals()), k) for k, step in enumerate(steps(program)))
    cut = int.from_bytes(program[:2], "big") % len(log)
    for piece in (log, log[cut:], log[:cut]):
        at = 0
        for frame in TlogReader(piece, WANTED):
            assert frame.begin >= at
            at = frame.end
            assert sound(piece[frame.begin + 8 : frame.end])
