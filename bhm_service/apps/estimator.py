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

# By which a cell may be fuller than its file knows: more than a meter is off by, no more than LiHV has above LiPo.
_OVERFULL_V = (0.07, 0.20)


@dataclass(frozen=True, slots=True)
class EstimatorState:
    """What the app remembers."""

    track: Track | None
    overfull: bool = False  # whether it was told that the pack is fuller than its file knows


class EstimatorApp:
    """Keeps the track of one model."""

    hears = (BatterySample, PackChange)
    says = (StateEstimate, Event)
    keeps = EstimatorState

    def __init__(self, tracker: Tracker) -> None:
        self.name = f"estimator-{tracker.model.value}"
        self._tracker = tracker
        self._track: Track | None = None
        self._overfull = False

    def state(self) -> EstimatorState:
        return EstimatorState(self._track, self._overfull)

    def restore(self, state: EstimatorState) -> None:
        self._track, self._overfull = state.track, state.overfull

    def on_message(self, message: Message) -> Sequence[Message]:
        if isinstance(message, PackChange):
            self._track, self._overfull = None, False
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
        if before is None and not self._overfull:
            over = self._fuller_than_full(message)
            self._overfull = over != []
            said += over
        return said

    def _fuller_than_full(self, sample: BatterySample) -> list[Message]:
        if sample.voltage_v is None:
            return []
        over_v = self._tracker.overfull_v(sample.voltage_v)
        if not _OVERFULL_V[0] < over_v < _OVERFULL_V[1]:
            return []
        cell_v = sample.voltage_v / self._tracker.pack.series
        return [
            Event(
                time_s=sample.time_s,
                app=self.name,
                code=EventCode.FULLER_THAN_FULL,
                severity=Severity.WARNING,
                text=f"the pack shows {cell_v:.2f} V a cell, its battery file is full at {cell_v - over_v:.2f} V: "
                "trust neither charge nor flying time. LiHV cells? Take generic-lihv.toml, or identify the pack",
            )
        ]
