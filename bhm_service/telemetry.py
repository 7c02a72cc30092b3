"""What one vehicle's messages amount to: samples of the followed battery, take-offs, landings, changes of pack.

Small state machines without clock or input of their own; the onboard reader and the reading of logs as arrays use
the same ones, so a flight is the same flight everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from bhm_service.messages import (
    AutopilotClock,
    AutopilotKind,
    BatterySample,
    BatteryStatus,
    FlightPhase,
    Heartbeat,
    Landed,
    LandedState,
    Message,
    Motion,
    PackChange,
    SystemStatus,
)

_BLOCK_S = 0.9  # reports faster than one a second are averaged: the models' errors do not come that fast
_OVERDUE_S = 1.25  # a BATTERY_STATUS that comes once a second may be late by a quarter of one
_BLOCK_LASTS_S = 2.0  # reports further apart are not averaged
_BATTERY_STATUS_LASTS_S = 5.0  # for so long a BATTERY_STATUS keeps SYS_STATUS from speaking for the battery
_TEMPERATURE_LASTS_S = 60.0
_RETURN_LASTS_S = 60.0  # no descent and no braking feeds a battery for longer


@dataclass(slots=True)
class SampleMerger:
    """BATTERY_STATUS and SYS_STATUS to samples of one battery, at most about one a second.

    BATTERY_STATUS of the followed id speaks where it has a voltage. SYS_STATUS fills in for vehicles whose
    BATTERY_STATUS has none (ArduCopter 3.5) or comes more rarely, as long as it cannot mean another battery.
    """

    battery_id: int
    armed: bool = False
    kind: AutopilotKind = AutopilotKind.OTHER
    ids: set[int] = field(default_factory=set)
    _status_s: float = -1e18  # last BATTERY_STATUS with a voltage
    _sample_s: float = -1e18  # last sample said
    _collected_s: float = -1e18  # last report taken towards the next one
    _source: type | None = None
    _temperature: tuple[float, float] | None = None
    _volts: list[float] = field(default_factory=list)
    _amps: list[float] = field(default_factory=list)
    _remaining: float | None = None
    _given_c: float = 0.0  # [C] while armed, by all that the sensor said
    _returns_since_s: float | None = None  # since when it has been saying that current flows back

    def add(self, message: Message) -> BatterySample | None:
        """Take a message in; a sample when one is complete."""
        if isinstance(message, Heartbeat):
            self.armed, self.kind = message.armed, message.kind
            return None
        if isinstance(message, BatteryStatus):
            self.ids.add(message.battery_id)
            if message.battery_id != self.battery_id:
                return None
            if message.temperature_k is not None:
                self._temperature = (message.time_s, message.temperature_k)
            if message.voltage_v is None:
                return None
            self._status_s = message.time_s
            return self._collect(message)
        if isinstance(message, SystemStatus) and self._speaks_for_us(message.time_s):
            return self._collect(message)
        return None

    def _speaks_for_us(self, now: float) -> bool:
        lowest = min(self.ids, default=self.battery_id)
        # SYS_STATUS is instance 0 on ArduPilot and the lowest battery on PX4.
        ours = self.battery_id == (lowest if self.kind is AutopilotKind.PX4 else 0)
        if not ours:
            return False
        if now - self._status_s > _BATTERY_STATUS_LASTS_S:
            return True
        return len(self.ids) <= 1 and now - max(self._status_s, self._sample_s) > _OVERDUE_S

    def _collect(self, message: BatteryStatus | SystemStatus) -> BatterySample | None:
        now, amps = message.time_s, self._believed(message)
        if type(message) is not self._source or not 0.0 <= now - self._collected_s <= _BLOCK_LASTS_S:
            self._volts, self._amps = [], []  # left over from before an interruption, or by another reporter
        self._source, self._collected_s = type(message), now
        if message.remaining is not None:
            self._remaining = message.remaining
        if message.voltage_v is not None:
            self._volts.append(message.voltage_v)
        if amps is not None:
            self._amps.append(amps)
        if now < self._sample_s:
            self._sample_s = -1e18  # the clock went back: start afresh
        if now - self._sample_s < _BLOCK_S:
            return None
        sample = BatterySample(
            time_s=now,
            battery_id=self.battery_id,
            voltage_v=_mean(self._volts),
            current_a=_mean(self._amps),
            temperature_k=self._temperature_at(now),
            remaining=self._remaining,
        )
        self._sample_s = now
        self._volts, self._amps = [], []
        return sample

    def _believed(self, message: BatteryStatus | SystemStatus) -> float | None:
        """The current, unless it is a negative one by which a sensor says that it is none, dead or wired backwards.

        A descent or a braking motor does feed a battery while armed: for a while, and less than was taken out.
        """
        now, amps = message.time_s, message.current_a
        if amps is None or not self.armed:
            self._returns_since_s = None
            return amps
        self._given_c += amps * min(max(now - self._collected_s, 0.0), _BLOCK_LASTS_S)
        if amps >= 0.0:
            self._returns_since_s = None
            return amps
        if self._returns_since_s is None or now < self._returns_since_s:
            self._returns_since_s = now
        brief = now - self._returns_since_s <= _RETURN_LASTS_S
        return amps if brief and self._given_c > 0.0 else None

    def _temperature_at(self, now: float) -> float | None:
        if self._temperature is None or now - self._temperature[0] > _TEMPERATURE_LASTS_S:
            return None
        return self._temperature[1]


SAG_COMPENSATED = 1 << 6  # of BATTn_OPTIONS


def options_parameter(battery_id: int) -> str:
    """Name of the ArduPilot parameter that tells how a battery is reported."""
    return "BATT_OPTIONS" if battery_id == 0 else f"BATT{battery_id + 1}_OPTIONS"


def is_sag_compensated(options: float) -> bool:
    """Whether the voltage is one at rest that the autopilot imagines: no resistance can be estimated from it."""
    return bool(int(options) & SAG_COMPENSATED)


def default_airborne_a(capacity_a: float) -> float:
    """Current that no multirotor draws on the ground: it empties the pack in less than an hour and a half. [A]"""
    return 0.7 * capacity_a


def resting_a(capacity_a: float) -> float:
    """Current below which a pack counts as resting: electronics, no motor. [A]"""
    return 0.2 * capacity_a


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None


@dataclass(slots=True)
class PhaseDetector:
    """Whether the vehicle flies: what the autopilot says of it, else armed and drawing current, else the current."""

    airborne_a: float  # [A] more than this is flying
    airborne: bool = False
    _armed: bool | None = None
    _landed: tuple[float, Landed] | None = None
    _height_m: float | None = None
    _since_s: float | None = None  # since when the current has been saying the opposite

    def add(self, message: Message) -> FlightPhase | None:
        """Take a message in; a phase when it changes."""
        if isinstance(message, Heartbeat):
            self._armed = message.armed
            if self.airborne and not message.armed:
                return self._now(False, message.time_s, "disarmed")
        elif isinstance(message, LandedState):
            self._landed = (message.time_s, message.state)
            flies = message.state is not Landed.ON_GROUND
            if flies != self.airborne:
                return self._now(flies, message.time_s, "landed state")
        elif isinstance(message, Motion) and message.relative_altitude_m is not None:
            self._height_m = message.relative_altitude_m
        elif isinstance(message, BatterySample):
            return self._by_current(message)
        return None

    def _by_current(self, sample: BatterySample) -> FlightPhase | None:
        if self._landed is not None and sample.time_s - self._landed[0] < 10.0:
            return None
        if sample.current_a is None:
            return None
        draws = sample.current_a > (0.5 if self.airborne else 1.0) * self.airborne_a
        flies = draws and self._armed is not False
        if flies == self.airborne:
            self._since_s = None
            return None
        if self._since_s is None:
            self._since_s = sample.time_s
        if sample.time_s - self._since_s < 2.0:
            return None
        began = self._since_s
        because = "current" if self._armed is None else "armed and current"
        return self._now(flies, began if flies else sample.time_s, because)

    def _now(self, airborne: bool, time_s: float, because: str) -> FlightPhase:
        self.airborne, self._since_s = airborne, None
        return FlightPhase(time_s=time_s, airborne=airborne, because=because)


_STEP_V = 0.04  # [V] a cell: more than this across an interruption is another charge
_JUMP_V = 0.10  # [V] a cell: more than this from one resting sample to the next, without one
_SETTLED_S = 60.0  # after a load the voltage still rises by itself
_SILENCE_S = 5.0
_STAYS = 0.5  # of a jump has to be there in the next sample


@dataclass(slots=True)
class PackWatch:
    """Notices on the ground that the pack is another one, or was charged.

    A step of the voltage that nothing announced has to be there in the next sample: single readings jump.
    """

    series: int
    rest_a: float  # [A] below this the pack rests
    _last: BatterySample | None = None
    _loaded_s: float = -1e18
    _interrupted: str = ""
    _suspected: tuple[float, float, str] | None = None  # [V] before and after a step, and what it is
    _boot_s: float | None = None
    _consumed_c: float | None = None

    def add(self, message: Message, airborne: bool) -> PackChange | None:
        """Take a message in; a change when there is one."""
        if isinstance(message, AutopilotClock):
            if self._boot_s is not None and message.boot_s < self._boot_s - 5.0:
                self._interrupted = "the autopilot rebooted"
            self._boot_s = message.boot_s
        elif isinstance(message, BatteryStatus) and message.consumed_c is not None:
            if self._consumed_c is not None and message.consumed_c < self._consumed_c - 36.0:
                self._interrupted = "the consumed charge went back"
            self._consumed_c = message.consumed_c
        elif isinstance(message, BatterySample):
            return self._sample(message, airborne)
        return None

    def interrupt(self, because: str) -> None:
        """Something happened since the last sample: the next one is looked at closely."""
        self._interrupted = self._interrupted or because

    def _sample(self, now: BatterySample, airborne: bool) -> PackChange | None:
        if now.voltage_v is None or now.current_a is None:
            return None
        last, self._last = self._last, now
        rests = abs(now.current_a) < self.rest_a
        if not rests:
            self._loaded_s = now.time_s
        suspected, self._suspected = self._suspected, None
        if suspected is not None:
            before, after, because = suspected
            # Under load nothing disproves it, and an old charge that is trusted wrongly is the worse mistake.
            if not rests or abs(now.voltage_v - before) > _STAYS * abs(after - before):
                return PackChange(time_s=now.time_s, because=because)
            return None
        if last is None or last.voltage_v is None or airborne or not rests:
            return None
        if now.time_s - last.time_s > _SILENCE_S and not self._interrupted:
            self._interrupted = f"nothing was heard for {now.time_s - last.time_s:.0f} s"
        step = (now.voltage_v - last.voltage_v) / self.series
        interrupted, self._interrupted = self._interrupted, ""
        recovering = max(0.0, 0.15 - 0.15 * (last.time_s - self._loaded_s) / _SETTLED_S)
        if interrupted and (step > _STEP_V + recovering or step < -_STEP_V):
            return PackChange(time_s=now.time_s, because=f"{interrupted} and the voltage went {_by(step)}")
        if step > _JUMP_V + recovering:
            self._suspected = (last.voltage_v, now.voltage_v, f"the resting voltage jumped {_by(step)}")
        return None


def _by(step_v: float) -> str:
    return f"{'up' if step_v > 0 else 'down'} by {1000 * abs(step_v):.0f} mV a cell"
