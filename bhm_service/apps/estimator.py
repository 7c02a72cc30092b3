"""Estimator: each sample to a belief about the pack's state. BHM_CIRC and BHM_CHEM are two instances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bhm_service.estimation.tracker import Track, Tracker
from bhm_service.messages import (
    BatterySample,
    Event,
    EventCode,
    Message,
    PackChange,
    Severity,
    StateEstimate,
)


@dataclass(frozen=True, slots=True)
class EstimatorState:
    """What the app remembers."""

    track: Track | None


class EstimatorApp:
    """Keeps the track of one model."""

    hears = (BatterySample, PackChange)
    says = (StateEstimate, Event)
    keeps = EstimatorState

    def __init__(self, tracker: Tracker) -> None:
        self.name = f"estimator-{tracker.model.value}"
        self._tracker = tracker
        self._track: Track | None = None

    def state(self) -> EstimatorState:
        return EstimatorState(self._track)

    def restore(self, state: EstimatorState) -> None:
        self._track = state.track

    def on_message(self, message: Message) -> Sequence[Message]:
        if isinstance(message, PackChange):
            self._track = None
            return []
        assert isinstance(message, BatterySample)
        before = self._track
        self._track, estimate = self._tracker.step(before, message)
        said: list[Message] = [] if estimate is None else [estimate]
        if before is not None and (self._track is None or self._track.restarts > before.restarts):
            said.append(
                Event(
                    time_s=message.time_s,
                    app=self.name,
                    code=EventCode.FILTER_RESTARTED,
                    severity=Severity.WARNING,
                    text="the voltage was not what was believed of this pack: started over from it",
                )
            )
        return said
