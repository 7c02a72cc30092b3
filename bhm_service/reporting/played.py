"""The log that was replayed, with our messages in it: Mission Planner, QGroundControl and MAVProxy can play it."""

from __future__ import annotations

from pathlib import Path

from bhm_service.mavlink.encode import FrameEncoder, stamped
from bhm_service.mavlink.log import Log, LogKind
from bhm_service.messages import BatteryStatus, Heartbeat
from bhm_service.replay import Replay

_STAMP = 8


def write_played(path: Path, log: Log, pages: Replay) -> None:
    """Write a tlog: the original frames as they were, each of ours behind the frame that it follows.

    Other kinds of log hold no frames: for them the autopilot's heartbeats and BATTERY_STATUS are written anew.
    """
    data = _into_tlog(log, pages) if log.kind is LogKind.TLOG else _anew(log, pages)
    path.write_bytes(data)


def outgoing_frames(log: Log, pages: Replay) -> list[bytes]:
    """Our frames alone, in order: what goes out on the wire, before it is signed.

    Those of a flight recording are numbered as they were, heartbeats and requests between them left out.
    """
    encoder = FrameEncoder(log.system)
    if log.recorded is None:
        return [frame for _, said in pages.outgoing for frame in encoder.frames(said)]
    frames: list[bytes] = []
    for (_, said), sent in zip(pages.outgoing, log.recorded.sent, strict=False):
        if sent is None:
            continue
        system, component, number = sent
        if (encoder.system, encoder.component) != (system, component):
            encoder = FrameEncoder(system, component)
        encoder.sequence = number
        frames += encoder.frames(said)
    return frames


def _into_tlog(log: Log, pages: Replay) -> bytes:
    encoder = FrameEncoder(log.system)
    out = bytearray()
    copied = 0
    for (begin, end), said in pages.outgoing:
        out += log.data[copied:end] if end > copied else b""
        copied = max(copied, end)
        # The original's own stamp, not our steady time: a player goes by the stamps around it.
        stamp = log.data[begin : begin + _STAMP]
        out += b"".join(stamp + frame for frame in encoder.frames(said))
    out += log.data[copied:]
    return bytes(out)


def _anew(log: Log, pages: Replay) -> bytes:
    autopilot, ours = FrameEncoder(log.system, component=1), FrameEncoder(log.system)
    frames: list[tuple[float, int, bytes]] = []
    for _, message in log.messages:
        if isinstance(message, Heartbeat):
            frames.append((message.time_s, 0, autopilot.autopilot_heartbeat(message)))
        elif isinstance(message, BatteryStatus):
            frames.append((message.time_s, 0, autopilot.battery_status(message)))
    frames += [(said.time_s, 1, frame) for _, said in pages.outgoing for frame in ours.frames(said)]
    frames.sort(key=lambda frame: frame[:2])
    return b"".join(stamped(time_s, frame) for time_s, _, frame in frames)
