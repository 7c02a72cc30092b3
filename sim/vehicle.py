"""Fly the simulated multirotor: over UDP in real time, or into a tlog.

python -m sim.vehicle udpout:127.0.0.1:14550
python -m sim.vehicle --tlog flight.tlog
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from bhm_service.mavlink.encode import stamped
from bhm_service.mavlink.transport import LinkUrl, Transport, transport_of
from sim.autopilot import Autopilot
from sim.battery import SimulatedPack
from sim.multirotor import Multirotor, hover_plan

_EPOCH_S = 1_750_000_000.0  # stamps of simulated tlogs: always the same


def tlog(vehicle: Multirotor, autopilot: Autopilot) -> bytes:
    """The whole flight as a telemetry log."""
    out = bytearray()
    while (state := vehicle.second()) is not None:
        for frame in autopilot.frames(state):
            out += stamped(_EPOCH_S + state.time_s, frame)
    return bytes(out)


def fly(vehicle: Multirotor, autopilot: Autopilot, link: Transport, speed: float = 1.0) -> None:
    """The flight over a link, ``speed`` seconds a second."""
    due = time.monotonic()
    while (state := vehicle.second()) is not None:
        for frame in autopilot.frames(state):
            link.send(frame)
        link.receive()
        due += 1.0 / speed
        time.sleep(max(due - time.monotonic(), 0.0))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m sim.vehicle", description="A simulated 4S quadrotor.")
    parser.add_argument("link", nargs="?", default="udpout:127.0.0.1:14550")
    parser.add_argument("--tlog", type=Path, help="write a telemetry log instead")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--flight", type=float, default=780.0, help="[s] in the air")
    parser.add_argument("--charge", type=float, default=0.97, help="state of charge at the start")
    parser.add_argument("--speed", type=float, default=1.0, help="seconds a second")
    given = parser.parse_args()
    pack = SimulatedPack(series=4, capacity_ah=5.0, left=given.charge)
    vehicle = Multirotor(pack, hover_plan(240.0, given.flight), given.seed)
    if given.tlog is not None:
        given.tlog.write_bytes(tlog(vehicle, Autopilot()))
        return
    link = transport_of(LinkUrl.parse(given.link))
    link.open()
    try:
        fly(vehicle, Autopilot(), link, given.speed)
    except KeyboardInterrupt:
        pass
    finally:
        link.close()


if __name__ == "__main__":
    main()
