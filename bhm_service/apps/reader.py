"""Reader: what the autopilot says to samples of the followed battery, take-offs, landings and changes of pack."""

from __future__ import annotations

from collections.abc import Sequence

from bhm_service.messages import (
    AutopilotClock,
    BatterySample,
    BatteryStatus,
    Event,
    EventCode,
    FlightPhase,
    Heartbeat,
    LandedState,
    Message,
    Motion,
    PackChange,
    Severity,
    SystemStatus,
)
from bhm_service.telemetry import PackWatch, PhaseDetector, SampleMerger

_NO_CURRENT_AFTER_S = 10.0


class ReaderApp:
    """Follows one battery of one vehicle, and says so when its current is not measured."""

    name = "reader"
    hears = (Heartbeat, BatteryStatus, SystemStatus, LandedState, Motion, AutopilotClock)
    says = (BatterySample, FlightPhase, PackChange, Event)

    def __init__(self, battery_id: int, series: int, rest_a: float, airborne_a: float) -> None:
        self._merger = SampleMerger(battery_id)
        self._phases = PhaseDetector(airborne_a)
        self._watch = PackWatch(series, rest_a)
        self._first_s: float | None = None
        self._measured = False
        self._told = False

    def on_message(self, message: Message) -> Sequence[Message]:
        sample = self._merger.add(message)
        said: list[Message] = []
        for item in (message, sample):
            if item is None:
                continue
            phase = self._phases.add(item)
            if phase is not None:
                said += [phase, self._event(phase)]
            change = self._watch.add(item, self._phases.airborne)
            if change is not None:
                said += [change, self._changed(change)]
        if sample is not None:
            said.append(sample)
            said += self._nothing_to_estimate(sample)
        return said

    def _event(self, phase: FlightPhase) -> Event:
        code, word = (EventCode.TOOK_OFF, "took off") if phase.airborne else (EventCode.LANDED, "landed")
        return Event(
            time_s=phase.time_s, app=self.name, code=code, severity=Severity.INFO, text=f"{word} ({phase.because})"
        )

    def _changed(self, change: PackChange) -> Event:
        return Event(
            time_s=change.time_s,
            app=self.name,
            code=EventCode.PACK_CHANGED,
            severity=Severity.INFO,
            text=f"another pack, or the same one charged: {change.because}",
        )

    def _nothing_to_estimate(self, sample: BatterySample) -> list[Message]:
        self._measured = self._measured or sample.current_a is not None
        self._first_s = sample.time_s if self._first_s is None else self._first_s
        if self._measured or self._told or sample.time_s - self._first_s < _NO_CURRENT_AFTER_S:
            return []
        self._told = True
        return [
            Event(
                time_s=sample.time_s,
                app=self.name,
                code=EventCode.NOTHING_TO_ESTIMATE,
                severity=Severity.WARNING,
                text=f"battery {sample.battery_id} reports no current: without a current sensor the charge "
                "that is left cannot be estimated",
            )
        ]
