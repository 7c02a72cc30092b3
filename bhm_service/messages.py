"""Every message of the bus: frozen records in SI units, ``None`` where a quantity is not known.

Signs: current is positive while discharging. ``time_s`` is the time of the input that led to the message, on the
clock of the log or of the link; nothing else in the package knows what time it is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

# ---- from the autopilot, decoded ------------------------------------------------------------------------------------


class AutopilotKind(Enum):
    """Whose conventions a vehicle's messages follow."""

    ARDUPILOT = "ArduPilot"
    PX4 = "PX4"
    OTHER = "other"


@dataclass(frozen=True, slots=True, kw_only=True)
class Heartbeat:
    """An autopilot's heartbeat; those of ground stations and companions do not become messages."""

    time_s: float
    system: int
    component: int
    kind: AutopilotKind
    armed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryStatus:
    """One BATTERY_STATUS."""

    time_s: float
    battery_id: int
    voltage_v: float | None  # sum of what was reported
    cells_v: tuple[float, ...] | None  # one by one, where they differ from the pack voltage itself
    current_a: float | None
    temperature_k: float | None
    consumed_c: float | None
    remaining: float | None  # the autopilot's own fraction: a baseline, never an input


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemStatus:
    """The battery part of one SYS_STATUS."""

    time_s: float
    voltage_v: float | None
    current_a: float | None
    remaining: float | None


class Landed(Enum):
    """EXTENDED_SYS_STATE.landed_state."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class LandedState:
    """Where the autopilot believes the vehicle to be."""

    time_s: float
    state: Landed


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Speed, height and throttle, as far as one message tells."""

    time_s: float
    relative_altitude_m: float | None = None
    altitude_m: float | None = None
    ground_speed_mps: float | None = None
    air_speed_mps: float | None = None
    climb_mps: float | None = None
    throttle: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Air:
    """Pressure and temperature at the barometer (its board, not the air outside)."""

    time_s: float
    pressure_pa: float | None
    board_temperature_k: float | None
    boot_s: float | None = None  # since the autopilot's boot, where it is told


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotClock:
    """The autopilot's own clock: seconds since its boot, and of the Unix epoch where it knows."""

    time_s: float
    boot_s: float
    unix_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterValue:
    """A parameter of the autopilot."""

    time_s: float
    name: str
    value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionItem:
    """One item of the mission that the autopilot holds."""

    time_s: float
    sequence: int
    command: int
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None
    hold_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionProgress:
    """Which item is being flown."""

    time_s: float
    sequence: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """The autopilot's estimate of the wind."""

    time_s: float
    speed_mps: float
    direction_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """Nothing but the passing of time."""

    time_s: float


# ---- made by the links -----------------------------------------------------------------------------------------------


class LinkStatus(Enum):
    """How far a link has come."""

    DOWN = "down"
    OPEN = "open, no autopilot heard"
    ALIVE = "autopilot heard"


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkState:
    """A link came up, heard the autopilot, fell silent or went down."""

    time_s: float
    link: int
    url: str
    status: LinkStatus
    because: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReport:
    """What went over a link since it was made, once a second."""

    time_s: float
    link: int
    status: LinkStatus
    bytes_in: int
    frames_in: int
    frames_out: int
    lost_out: int  # there was no room to send them
    stray_bytes: int  # belonged to no frame
    bad_checksums: int
    duplicates: int
    unsigned: int  # refused, with the next two, where a signing key is set
    forged: int
    replayed: int
    opened: int  # times that it came up
    requests: int  # for message rates


# ---- made by the apps -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class BatterySample:
    """What the followed battery did at one instant."""

    time_s: float
    battery_id: int
    voltage_v: float | None
    current_a: float | None
    temperature_k: float | None
    remaining: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPhase:
    """The vehicle took off or landed."""

    time_s: float
    airborne: bool
    because: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PackChange:
    """Another pack than before, or the same one charged: what was believed of its charge no longer holds."""

    time_s: float
    because: str


class Model(Enum):
    """Which battery model speaks."""

    CIRC = "circ"
    CHEM = "chem"


class Rejection(Enum):
    """Why a sample was not used."""

    NO_CURRENT = "current not measured"
    NO_VOLTAGE = "voltage not measured"
    NOT_FINITE = "not a finite number"
    IMPLAUSIBLE = "outside what the pack can do"
    SURPRISING = "far from what was expected"
    OUT_OF_ORDER = "older than the one before"


@dataclass(frozen=True, slots=True, kw_only=True)
class StateEstimate:
    """What one estimator believes after a sample."""

    time_s: float
    model: Model
    valid: bool
    soc: float
    soc_sd: float
    soc_low: float  # 5 %
    soc_high: float  # 95 %
    soe: float
    voltage_expected_v: float | None  # before the sample was used
    voltage_expected_sd_v: float | None
    voltage_measured_v: float | None
    nis: float | None  # squared innovation over its expected variance
    rejected: Rejection | None
    mean: tuple[float, ...] = field(repr=False)
    covariance: tuple[tuple[float, ...], ...] = field(repr=False)


class Ending(Enum):
    """Which event ends the flight that is predicted."""

    SOC = "state of charge at its threshold"
    VOLTAGE = "voltage at cut-off"
    POWER = "power not deliverable"
    HORIZON = "beyond the horizon"


@dataclass(frozen=True, slots=True, kw_only=True)
class EndOfDischarge:
    """One model's remaining flying time: a distribution."""

    time_s: float
    model: Model
    median_s: float
    low_s: float  # 5 %
    high_s: float  # 95 %
    ending: Ending  # of the most samples
    power_w: float  # expected load
    samples_s: tuple[float, ...] = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class RemainingTime:
    """Remaining flying time and charge of both models together."""

    time_s: float
    median_s: float | None
    low_s: float | None
    high_s: float | None
    soc: float | None
    soe: float | None
    weights: tuple[tuple[Model, float], ...]
    ending: Ending | None
    health: int  # 0 good, 1 degraded, 2 no estimate
    because: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedValue:
    """A number for the ground: NAMED_VALUE_FLOAT."""

    time_s: float
    boot_ms: int
    name: str
    value: float


class Severity(Enum):
    """MAV_SEVERITY, as far as it is used."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


class EventCode(Enum):
    """What happened, in a form that programs may rely on."""

    NOTHING_TO_ESTIMATE = "nothing to estimate from"
    FILTER_RESTARTED = "filter started over"
    FULLER_THAN_FULL = "fuller than its battery file knows"
    PACK_CHANGED = "pack changed"
    AUTOPILOT_REBOOTED = "autopilot rebooted"
    TOOK_OFF = "took off"
    LANDED = "landed"
    SIGNING = "signing"
    SAG_COMPENSATED = "voltage is sag-compensated"
    APP_RESTARTED = "app restarted"
    APP_DOWN = "app stays down"
    RESUMED = "went on from a checkpoint"
    CHECKPOINT_REFUSED = "checkpoint refused"
    CHECKPOINT_NOT_WRITTEN = "checkpoint not written"
    RECORDING_STOPPED = "recording stopped"
    SHADOW_IN_CHARGE = "new physics in charge"
    SHADOW_ROLLED_BACK = "back to the old physics"


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something worth telling: counted, recorded, and shown to the person who replays."""

    time_s: float
    app: str
    code: EventCode
    severity: Severity
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusText:
    """A sentence for the pilot: STATUSTEXT."""

    time_s: float
    severity: Severity
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """How new physics in the shadow of the old stands, at each landing and at each change of charge."""

    time_s: float
    flights: int = 0  # that count, since the shadow began or was last sent back
    shadow_in_charge: bool = False
    old_score: float = 0.0  # [nat] rolling log score of the measured voltage, a sample
    new_score: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Housekeeping:
    """How one app is doing, once a second."""

    time_s: float
    app: str
    heard: int
    said: int
    dropped: int
    resets: int
    worst_step_s: float | None  # None where no stopwatch was handed in
    crashes: int = 0
    down: bool = False  # crashed twice within a minute, and is not tried again


Input: TypeAlias = (
    Heartbeat
    | BatteryStatus
    | SystemStatus
    | LandedState
    | Motion
    | Air
    | AutopilotClock
    | ParameterValue
    | MissionItem
    | MissionProgress
    | Wind
    | Tick
    | LinkState
    | LinkReport
)
"""What comes from outside: from the links, and the passing of time."""

Message: TypeAlias = (
    Input
    | BatterySample
    | FlightPhase
    | PackChange
    | StateEstimate
    | EndOfDischarge
    | RemainingTime
    | NamedValue
    | StatusText
    | Standing
    | Event
    | Housekeeping
)
