"""Duel: new physics flies in the shadow of the old, and speaks only when it has predicted the voltage better.

Both are whole chains of apps on buses of their own that hear the same; what the one in charge says goes on. After two
flights in which the shadow was at least a little better it takes over, on the ground; as soon as it is worse again, or
knows nothing while the old does, the old is back in charge, and two more flights are asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

from bhm_service.bus import Bus
from bhm_service.executive import restore, states
from bhm_service.messages import (
    BatterySample,
    Event,
    EventCode,
    FlightPhase,
    Input,
    LinkReport,
    LinkState,
    Message,
    RemainingTime,
    Severity,
    Standing,
    StateEstimate,
)

_FLIGHTS = 2
_BETTER = 0.05  # [nat] of log score per sample; less is luck
_SAMPLES = 300.0  # that the rolling score remembers
_LEAST = 60.0  # samples, in a flight or before a score counts
_WORST = 25.0  # squared innovation over its variance: a faulty reading does not decide
_BLIND_S = 5.0


@dataclass(frozen=True, slots=True)
class Score:
    """Rolling mean of the log density that a chain gave to each measured voltage."""

    mean: float = 0.0
    samples: float = 0.0

    def add(self, estimate: StateEstimate) -> Score:
        """The score after one more estimate; only those that expected a voltage count."""
        sd, nis = estimate.voltage_expected_sd_v, estimate.nis
        if sd is None or nis is None or not (sd > 0.0 and math.isfinite(nis)):
            return self
        density = -0.5 * min(nis, _WORST) - math.log(sd)
        samples = self.samples + 1.0
        return Score(self.mean + (density - self.mean) / min(samples, _SAMPLES), samples)


@dataclass(frozen=True, slots=True, kw_only=True)
class DuelState:
    """What the app remembers."""

    standing: Standing
    old_score: Score
    new_score: Score
    airborne: bool
    flown: int
    blind_since_s: float | None
    old: dict[str, Any]
    new: dict[str, Any]


class DuelApp:
    """Two chains, one voice."""

    name = "duel"
    hears: tuple[type, ...] = tuple(kind for kind in get_args(Input) if kind not in (LinkState, LinkReport))
    says: tuple[type, ...] = tuple(kind for kind in get_args(Message) if kind not in get_args(Input))
    keeps = DuelState

    def __init__(self, old: Callable[[], Bus], new: Callable[[], Bus], standing: Standing) -> None:
        self._old, self._new = _Chain(old()), _Chain(new())
        self._standing = standing
        self._airborne = False
        self._flown = 0  # samples of this flight
        self._blind_since_s: float | None = None

    def state(self) -> DuelState:
        return DuelState(
            standing=self._standing,
            old_score=self._old.score,
            new_score=self._new.score,
            airborne=self._airborne,
            flown=self._flown,
            blind_since_s=self._blind_since_s,
            old=states(self._old.bus.apps),
            new=states(self._new.bus.apps),
        )

    def restore(self, state: DuelState) -> None:
        restore(self._old.bus.apps, state.old)
        restore(self._new.bus.apps, state.new)
        self._standing, self._old.score, self._new.score = state.standing, state.old_score, state.new_score
        self._airborne, self._flown, self._blind_since_s = state.airborne, state.flown, state.blind_since_s

    def on_message(self, message: Message) -> Sequence[Message]:
        old, new = self._old.hear(message, self._airborne), self._new.hear(message, self._airborne)
        said = list(new if self._standing.shadow_in_charge else old)
        for answer in old:
            if isinstance(answer, BatterySample) and self._airborne:
                self._flown += 1
            elif isinstance(answer, FlightPhase):
                said += self._phase(answer)
        return said + self._watch(old, new, message.time_s)

    def _phase(self, phase: FlightPhase) -> list[Message]:
        landed, self._airborne = self._airborne and not phase.airborne, phase.airborne
        if not landed:
            self._flown = 0
            return []
        counts = self._flown >= _LEAST
        now = self._told(phase.time_s, flights=self._standing.flights + counts)
        better = now.new_score - now.old_score > _BETTER
        if not now.shadow_in_charge and now.flights >= _FLIGHTS and better and self._new.score.samples >= _LEAST:
            return self._switch(now, True, f"it predicted the voltage better in {now.flights} flights")
        self._standing = now
        return [now]

    def _watch(self, old: Sequence[Message], new: Sequence[Message], now_s: float) -> list[Message]:
        """Back to the old, while the new is in charge and not worth it."""
        if not self._standing.shadow_in_charge:
            return []
        told = {kind: m for kind, side in (("old", old), ("new", new)) for m in side if isinstance(m, RemainingTime)}
        if told:
            blind = "new" not in told or (told["new"].soc is None and "old" in told and told["old"].soc is not None)
            self._blind_since_s = (self._blind_since_s or now_s) if blind else None
        now = self._told(now_s)
        if self._blind_since_s is not None and now_s - self._blind_since_s >= _BLIND_S:
            return self._switch(now, False, "it knows nothing, and the old physics does")
        if self._airborne and self._new.score.samples >= _LEAST and now.new_score < now.old_score:
            return self._switch(now, False, "it predicts the voltage worse than the old physics")
        return []

    def _told(self, now_s: float, flights: int | None = None) -> Standing:
        return replace(
            self._standing,
            time_s=now_s,
            flights=self._standing.flights if flights is None else flights,
            old_score=self._old.score.mean,
            new_score=self._new.score.mean,
        )

    def _switch(self, now: Standing, to_new: bool, because: str) -> list[Message]:
        self._standing = replace(now, shadow_in_charge=to_new, flights=now.flights if to_new else 0)
        self._blind_since_s = None
        words = "the new physics is in charge" if to_new else "back to the old physics"
        code = EventCode.SHADOW_IN_CHARGE if to_new else EventCode.SHADOW_ROLLED_BACK
        severity = Severity.INFO if to_new else Severity.WARNING
        text = f"{words}: {because}"
        return [
            self._standing,
            Event(time_s=now.time_s, app=self.name, code=code, severity=severity, text=text),
        ]


class _Chain:
    """One bus, what it said of the last message, and how well it predicts."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.score = Score()

    def hear(self, message: Message, airborne: bool) -> list[Message]:
        said: list[Message] = []
        self.bus.publish(message, said.append)
        if airborne:
            for answer in said:
                if isinstance(answer, StateEstimate):
                    self.score = self.score.add(answer)
        return said
