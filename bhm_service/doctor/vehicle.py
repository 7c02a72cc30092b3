"""A vehicle on its links for some seconds: what it sends, what its battery messages can be used for, its settings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from statistics import median

from bhm_service.assembly import Equipment
from bhm_service.doctor.finding import Finding, bad, doubtful, good
from bhm_service.mavlink.links import Links
from bhm_service.messages import (
    AutopilotClock,
    AutopilotKind,
    BatteryStatus,
    Heartbeat,
    LinkReport,
    LinkState,
    LinkStatus,
    Message,
    ParameterValue,
    SystemStatus,
)
from bhm_service.telemetry import SAG_COMPENSATED, is_sag_compensated, resting_a
from bhm_service.units import SECONDS_PER_HOUR

_CELL_V = (3.0, 4.45)  # of a pack that somebody wants to fly with
_ENOUGH_HZ = 0.4  # two batteries share one slot: each comes every other second
_ANALOG = 4.0  # BATTn_MONITOR: voltage and current through the autopilot's own converters
_DEFAULT_AMP_PER_VOLT = 17.0  # BATTn_AMP_PERVLT as ArduPilot ships it
_CAPACITY_APART = 0.15


@dataclass(slots=True)
class Heard:
    """What came over the links."""

    seconds: float = 0.0
    heartbeat: Heartbeat | None = None
    armed: bool = False
    status: list[BatteryStatus] = field(default_factory=list)
    system: list[SystemStatus] = field(default_factory=list)
    clocks: int = 0
    links: dict[int, LinkReport] = field(default_factory=dict)
    states: dict[int, LinkState] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)

    def hear(self, message: Message) -> None:
        """One message more."""
        if isinstance(message, Heartbeat):
            self.heartbeat = message
            self.armed = self.armed or message.armed
        elif isinstance(message, BatteryStatus):
            self.status.append(message)
        elif isinstance(message, SystemStatus):
            self.system.append(message)
        elif isinstance(message, AutopilotClock):
            self.clocks += 1
        elif isinstance(message, LinkReport):
            self.links[message.link] = message
        elif isinstance(message, LinkState):
            self.states[message.link] = message
        elif isinstance(message, ParameterValue):
            self.parameters[message.name] = message.value


def parameters_of(kind: AutopilotKind, battery_id: int) -> tuple[str, ...]:
    """Names of the settings that are asked for."""
    if kind is AutopilotKind.ARDUPILOT:
        prefix = "BATT_" if battery_id == 0 else f"BATT{battery_id + 1}_"
        return tuple(prefix + name for name in ("OPTIONS", "MONITOR", "AMP_PERVLT", "CAPACITY"))
    if kind is AutopilotKind.PX4:
        return tuple(f"BAT{battery_id + 1}_{name}" for name in ("SOURCE", "A_PER_V", "CAPACITY"))
    return ()


def listen(links: Links, battery_id: int, seconds: float, clock: Callable[[], float]) -> Iterable[Heard]:
    """Listen, ask for what is needed, and give what was heard so far a few times a second."""
    heard, begin, asked_s = Heard(), clock(), 0.0
    while (now := clock()) < begin + seconds:
        for _, message in links.poll(min(0.2, begin + seconds - now)):
            heard.hear(message)
        heard.seconds = clock() - begin
        if heard.heartbeat is not None and links.vehicle is not None and heard.seconds - asked_s > 1.0:
            asked_s = heard.seconds
            for name in parameters_of(heard.heartbeat.kind, battery_id):
                if name not in heard.parameters:
                    links.send(links.encoder.request_parameter(*links.vehicle, name))
        yield heard


def vehicle(heard: Heard, equipment: Equipment) -> list[Finding]:
    """What is wrong with what was heard."""
    found = [_link(heard, number) for number in sorted(heard.states)]
    mend = "take it out there; or, to have that pack scaled, take series out of the battery file"
    found += [doubtful(remark, mend) for remark in equipment.remarks]
    if heard.heartbeat is None:
        return found
    battery = _battery(heard, equipment)
    return [*found, *battery, *_settings(heard, equipment)]


def _link(heard: Heard, number: int) -> Finding:
    state, report = heard.states[number], heard.links.get(number)
    serial = state.url.startswith("serial")
    if state.status is LinkStatus.DOWN:
        return bad(f"{state.url}: {state.because or 'down'}", "see above; the service goes on trying by itself")
    if report is None or report.bytes_in == 0:
        wires = "wiring (TX to RX, ground), SERIALn_PROTOCOL = 2 (ArduPilot) or MAV_n_CONFIG (PX4)"
        routes = "does the autopilot or router send here? see its endpoints and any firewall"
        return bad(f"{state.url}: nothing came", wires if serial else routes)
    if report.frames_in == 0:
        return bad(
            f"{state.url}: {report.bytes_in} bytes came, and no MAVLink frame",
            "another baud rate: that of SERIALn_BAUD or SER_TELn_BAUD"
            if serial
            else "is it MAVLink that is sent here?",
        )
    if state.status is LinkStatus.OPEN:
        return bad(
            f"{state.url}: {report.frames_in} MAVLink frames, none of an autopilot" + _refused(report),
            "set link.system to the vehicle's SYSID_THISMAV, and the same signing key on both sides",
        )
    damaged = report.bad_checksums / max(report.frames_in + report.bad_checksums, 1)
    if damaged > 0.05:
        return doubtful(
            f"{state.url}: {100 * damaged:.0f} % of the frames are damaged", "cable, ground, or a lower rate"
        )
    return good(f"{state.url}: {state.because}, {report.frames_in / max(heard.seconds, 1.0):.0f} frames a second")


def _refused(report: LinkReport) -> str:
    count = report.unsigned + report.forged + report.replayed
    return f" that was believed ({count} with no or a wrong signature)" if count else ""


def _battery(heard: Heard, equipment: Equipment) -> list[Finding]:
    wanted = equipment.vehicle.battery.id
    ours = [m for m in heard.status if m.battery_id == wanted]
    others = sorted({m.battery_id for m in heard.status} - {wanted})
    assert heard.heartbeat is not None
    reports: list[BatteryStatus] | list[SystemStatus] = ours
    found: list[Finding] = []
    if not ours and others:
        words = f"battery {wanted} is not reported, but {', '.join(map(str, others))}"
        return [bad(words, "set battery.id in the vehicle file to the battery that flies")]
    if not ours and heard.system:
        reports = heard.system
        found.append(doubtful("no BATTERY_STATUS: SYS_STATUS stands in for it", "set BATT_MONITOR; PX4: BAT1_SOURCE"))
    elif not ours:
        mend = "set BATT_MONITOR (PX4: BAT1_SOURCE); if set, SRn_EXTRA3 = 1 and SRn_EXT_STAT = 1 on this port"
        return [bad("no battery data, although it was asked for", mend)]
    rate = len(reports) / max(heard.seconds - 2.0, 1.0)  # the first seconds go by with asking
    if rate < _ENOUGH_HZ:
        words = f"battery data come {rate:.1f} times a second, not once"
        found.append(bad(words, "another program lowers the rate, or the link is full: SRn_EXTRA3 = 1, fewer streams"))
    else:
        found.append(good(f"battery {wanted}: {rate:.1f} reports a second"))
    return [*found, _voltage(reports, equipment), _current(reports, heard.armed, equipment)]


def _voltage(reports: Iterable[BatteryStatus | SystemStatus], equipment: Equipment) -> Finding:
    volts = [m.voltage_v for m in reports if m.voltage_v is not None]
    if not volts:
        return bad("the voltage is not measured", "BATT_MONITOR and BATT_VOLT_PIN; PX4: BAT1_SOURCE, BAT1_V_CHANNEL")
    pack = median(volts)
    cell = pack / equipment.series
    if not _CELL_V[0] <= cell <= _CELL_V[1]:
        return bad(
            f"{pack:.2f} V are {cell:.2f} V a cell with {equipment.series} in series",
            "battery.series in the vehicle file, or BATT_VOLT_MULT (PX4: BAT1_V_DIV)",
        )
    return good(f"{pack:.2f} V, {cell:.2f} V a cell")


def _current(reports: Iterable[BatteryStatus | SystemStatus], armed: bool, equipment: Equipment) -> Finding:
    amps = [m.current_a for m in reports if m.current_a is not None]
    calibrate = "BATT_AMP_PERVLT and BATT_AMP_OFFSET against a clamp meter; PX4: BAT1_A_PER_V, BAT1_I_OVERWRITE"
    if not amps:
        return bad("the current is not measured: no charge can be counted", "a power module with current sensor")
    now = median(amps)
    rest = resting_a(equipment.capacity_c / SECONDS_PER_HOUR)
    if now < -0.05 * rest:
        return bad(f"{now:.2f} A: the vehicle charges its battery?", f"the sensor's sign or offset: {calibrate}")
    if not armed and now > rest:
        return bad(f"{now:.2f} A while disarmed: the current sensor's offset is wrong", calibrate)
    if not armed and now == 0.0:
        return doubtful("0.00 A although the electronics draw some: offset too low, or no sensor", calibrate)
    return good(f"{now:.2f} A {'armed' if armed else 'disarmed'}")


def _settings(heard: Heard, equipment: Equipment) -> list[Finding]:
    known, battery = heard.parameters, equipment.vehicle.battery
    assert heard.heartbeat is not None
    names = parameters_of(heard.heartbeat.kind, battery.id)
    if names and not any(name in known for name in names):
        return [doubtful("the autopilot's settings cannot be read", f"look yourself: {', '.join(names)}")]
    prefix = names[0].partition("_")[0] if names else ""
    found: list[Finding] = []
    options = known.get(f"{prefix}_OPTIONS")
    if options is not None and is_sag_compensated(options):
        words = f"{prefix}_OPTIONS = {int(options)}: the voltage is sag-compensated, not the measured one"
        found.append(bad(words, f"set {prefix}_OPTIONS = {int(options) & ~SAG_COMPENSATED} (bit 6 off)"))
    per_volt = known.get(f"{prefix}_AMP_PERVLT")
    if known.get(f"{prefix}_MONITOR") == _ANALOG and per_volt == _DEFAULT_AMP_PER_VOLT:
        words = f"{prefix}_AMP_PERVLT is as it was shipped: the current sensor was never calibrated"
        found.append(doubtful(words, "compare with a clamp meter in the hover, or with the charger afterwards"))
    if known.get(f"{prefix}_A_PER_V", 1.0) < 0.0:
        found.append(bad(f"{prefix}_A_PER_V is not set", "choose the power module in QGroundControl, Power"))
    told, ours = known.get(f"{prefix}_CAPACITY", 0.0) / 1000.0, equipment.capacity_c / SECONDS_PER_HOUR
    if told > 0.0 and abs(told / ours - 1.0) > _CAPACITY_APART:
        words = f"{prefix}_CAPACITY says {told:.1f} Ah, our files {ours:.1f} Ah"
        mend = "which one is on the pack's label? battery.capacity_ah in the vehicle file, else the battery file"
        found.append(doubtful(words, mend))
    return found or [good("the autopilot's battery settings")]
