"""Limits: a sentence to the pilot when a reserve is reached, and when landing is due. Once each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from bhm_service.messages import FlightPhase, Message, PackChange, RemainingTime, Severity, StatusText

_HOLDS_S = 2.0  # a value is beyond its limit for so long before it counts: a gust is no reserve
_AGAIN = 1.25  # so many times the limit, for as long, and it may be told again
_FORGOTTEN_S = 15.0  # nothing known for longer: what held before does not hold now


@dataclass(frozen=True, slots=True, kw_only=True)
class Reserves:
    """What the pilot wants to be told at."""

    warning_s: float
    critical_s: float
    landing_soc: float


@dataclass(frozen=True, slots=True)
class Limit:
    """One limit: beyond it since, within it again since, and whether it was told."""

    below_since_s: float | None = None
    above_since_s: float | None = None
    told: bool = False

    def at(self, now_s: float, value: float, limit: float) -> tuple[Limit, bool]:
        """The limit after one more value; whether it is to be told now."""
        if value <= limit:
            since = now_s if self.below_since_s is None else self.below_since_s
            due = not self.told and now_s - since >= _HOLDS_S
            return Limit(below_since_s=since, told=self.told or due), due
        if self.told and value >= _AGAIN * limit:
            since = now_s if self.above_since_s is None else self.above_since_s
            return Limit(above_since_s=since, told=now_s - since < _HOLDS_S), False
        return Limit(told=self.told), False


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitsState:
    """What the app remembers."""

    airborne: bool = False
    known_s: float | None = None
    warning: Limit = Limit()
    critical: Limit = Limit()
    landing: Limit = Limit()


class LimitsApp:
    """Compares every fused prediction of a vehicle in flight with the reserves; what is not known is not compared."""

    name = "limits"
    hears = (FlightPhase, PackChange, RemainingTime)
    says = (StatusText,)
    keeps = LimitsState

    def __init__(self, reserves: Reserves) -> None:
        self._reserves = reserves
        self._state = LimitsState()

    def state(self) -> LimitsState:
        return self._state

    def restore(self, state: LimitsState) -> None:
        self._state = state

    def on_message(self, message: Message) -> Sequence[Message]:
        if isinstance(message, FlightPhase):
            self._state = LimitsState(airborne=message.airborne)
        elif isinstance(message, PackChange):
            self._state = LimitsState(airborne=self._state.airborne)
        elif isinstance(message, RemainingTime) and self._state.airborne:
            return self._compare(message)
        return []

    def _compare(self, now: RemainingTime) -> list[Message]:
        if now.median_s is None and now.soc is None:
            return []
        old, reserves = self._state, self._reserves
        if old.known_s is not None and now.time_s - old.known_s > _FORGOTTEN_S:
            old = replace(
                old, warning=Limit(told=old.warning.told), critical=Limit(told=old.critical.told),
                landing=Limit(told=old.landing.told),
            )  # fmt: skip
        new = replace(old, known_s=now.time_s)
        warn = due = low = False
        if now.median_s is not None:
            warning, warn = old.warning.at(now.time_s, now.median_s, reserves.warning_s)
            critical, due = old.critical.at(now.time_s, now.median_s, reserves.critical_s)
            new = replace(new, warning=warning, critical=critical)
        if now.soc is not None:
            landing, low = old.landing.at(now.time_s, now.soc, reserves.landing_soc)
            new = replace(new, landing=landing)
        self._state = new
        left = "" if now.median_s is None else f"{_minutes(now.median_s)} flying time left"
        if due:
            return [StatusText(time_s=now.time_s, severity=Severity.CRITICAL, text=f"Battery: land now, {left}")]
        said: list[Message] = []
        if low and now.soc is not None:
            words = f"Battery: land now, {100.0 * now.soc:.0f} % charge left"
            said.append(StatusText(time_s=now.time_s, severity=Severity.CRITICAL, text=words))
        if warn and not new.critical.told:
            said.append(StatusText(time_s=now.time_s, severity=Severity.WARNING, text=f"Battery: {left}"))
        return said


def _minutes(seconds: float) -> str:
    whole = int(seconds)
    return f"{whole // 60}:{whole % 60:02d}"
