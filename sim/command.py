"""`bhm sim`: build the vehicle that was asked for, and fly it."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from bhm_service.errors import BadInputError
from bhm_service.mavlink.signing import Signer, read_key
from bhm_service.mavlink.transport import LinkDownError, LinkUrl, Transport
from bhm_service.mavlink.transports import transport_of
from sim.ardupilot import ArduPilot
from sim.autopilot import Autopilot
from sim.battery import SimulatedPack
from sim.firmware import Firmware
from sim.multirotor import Multirotor, Pack, Sensors, State, Wind, hover_plan
from sim.px4 import Px4
from sim.pybamm_pack import PybammPack
from sim.terminal import TerminalTransport
from sim.trouble import Trouble
from sim.vehicle import VirtualVehicle, tlog

_FIRMWARE: dict[str, type[Firmware]] = {"ardupilot": ArduPilot, "px4": Px4}
_SENSORS = Sensors(voltage_step=0.008, current_step=0.014)  # 12 bits behind the usual divider and shunt


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What to fly and how; the same names as on the command line."""

    links: tuple[str, ...] = ()
    autopilot: str = "ardupilot"
    system: int = 1
    cells: int = 4
    capacity: float = 5.0
    charge: float = 0.97
    batteries: int = 1
    truth: str = "own"
    power: float = 240.0
    flight: float = 780.0
    wind: float = 0.0
    gusts: float = 0.0
    speed: float = 1.0
    seed: int = 1
    loss: float = 0.0
    double: float = 0.0
    overtake: float = 0.0
    garbage: float = 0.0
    silence: tuple[str, ...] = ()
    reboot: tuple[float, ...] = ()
    signing_key: Path | None = None
    tlog: Path | None = None
    quiet: bool = False


def simulate(options: Options) -> int:
    """Fly until the plan or the person ends it; returns the exit status."""
    if options.tlog is not None:
        options.tlog.write_bytes(tlog(multirotor_of(options), Autopilot(options.system)))
        return 0
    vehicle = vehicle_of(options)
    vehicle.firmware.epoch_s = time.time()
    console = Console(quiet=options.quiet, highlight=False)
    console.print(f"{options.autopilot}, system {options.system}, {_pack_words(options)}: {', '.join(_urls(options))}")
    try:
        with console.status("on the ground") as status:

            def tell(state: State) -> None:
                left = "" if state.other is None else f"  second pack {state.other.voltage_v:.2f} V"
                where = f"{state.height_m:.0f} m up" if state.airborne else "on the ground"
                measured = f"{state.voltage_v:.2f} V {state.current_a:.1f} A {state.consumed_ah:.2f} Ah"
                status.update(f"{state.time_s:.0f} s  {where}  {measured}{left}")

            # A shell that starts it in the background has it ignore interrupts, which is how it is meant to end.
            signal.signal(signal.SIGINT, signal.default_int_handler)
            with contextlib.suppress(KeyboardInterrupt):
                vehicle.fly(options.speed, tell)
    finally:
        vehicle.close()
    return 0


def multirotor_of(options: Options) -> Multirotor:
    """The vehicle without its autopilot."""
    kind: type[SimulatedPack | PybammPack] = PybammPack if options.truth == "pybamm" else SimulatedPack
    packs: list[Pack] = [kind(options.cells, options.capacity, options.charge) for _ in range(options.batteries)]
    return Multirotor(
        packs[0],
        hover_plan(options.power, options.flight),
        options.seed,
        other=packs[1] if options.batteries > 1 else None,
        wind=Wind(options.wind, gust_mps=options.gusts),
        sensors=_SENSORS,
    )


def vehicle_of(options: Options, transports: Sequence[Transport] | None = None) -> VirtualVehicle:
    """The vehicle with its autopilot and its links."""
    multirotor = multirotor_of(options)
    firmware = _FIRMWARE[options.autopilot](multirotor.plan, options.cells, options.capacity, options.system)
    if options.signing_key is not None:
        firmware.signer = Signer(read_key(options.signing_key))
    trouble = Trouble(
        loss=options.loss,
        double=options.double,
        overtake=options.overtake,
        garbage=options.garbage,
        silences=tuple(_silence(text) for text in options.silence),
    )
    made = [_transport(url) for url in _urls(options)] if transports is None else transports
    return VirtualVehicle(multirotor, firmware, made, trouble, options.reboot, options.seed)


def _urls(options: Options) -> tuple[str, ...]:
    return options.links or ("udpout:127.0.0.1:14550",)


def _transport(text: str) -> Transport:
    url = LinkUrl.parse(text)
    transport = TerminalTransport(url) if url.kind == "serial" else transport_of(url)
    if url.kind in ("serial", "udpin", "tcpin"):
        try:  # what cannot be had is told at once; a service that is not there yet is waited for
            transport.open()
        except LinkDownError as why:
            raise BadInputError(f"link {text}", str(why)) from None
        transport.close()
    return transport


def _silence(text: str) -> tuple[float, float]:
    begin, _, seconds = text.partition(":")
    try:
        return float(begin), float(seconds)
    except ValueError:
        raise BadInputError(f"--silence {text}", "must be BEGIN:SECONDS, for example 60:20") from None


def _pack_words(options: Options) -> str:
    packs = "two packs of" if options.batteries > 1 else "a pack of"
    return f"{packs} {options.cells}S {options.capacity:g} Ah"
