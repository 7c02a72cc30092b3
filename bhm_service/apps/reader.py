"""Reader: what the autopilot says to samples of the followed battery, take-offs, landings and changes of pack."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

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
    ParameterValue,
    Severity,
    SystemStatus,
)
from bhm_service.telemetry import PackWatch, PhaseDetector, SampleMerger, is_sag_compensated, options_parameter

_NO_CURRENT_AFTER_S = 10.0


@dataclass(slots=True, kw_only=True)
class ReaderState:
    """What the app remembers."""

    merger: SampleMerger
    phases: PhaseDetector
    watch: PackWatch
    first_s: float | None = None
    measured: bool = False
    told: bool = False


class ReaderApp:
    """Follows one battery of one vehicle, and says so when its current is not measured."""

    name = "reader"
    hears = (Heartbeat, BatteryStatus, SystemStatus, LandedState, Motion, AutopilotClock, ParameterValue)
    says = (BatterySample, FlightPhase, PackChange, Event)
    keeps = ReaderState

    def __init__(self, battery_id: int, series: int, rest_a: float, airborne_a: float) -> None:
        self._state = ReaderState(
            merger=SampleMerger(battery_id), phases=PhaseDetector(airborne_a), watch=PackWatch(series, rest_a)
        )

    def state(self) -> ReaderState:
        return copy.deepcopy(self._state)

    def restore(self, state: ReaderState) -> None:
        self._state = state

    def on_message(self, message: Message) -> Sequence[Message]:
        if isinstance(message, ParameterValue):
            return self._compensated(message)
        now = self._state
        sample = now.merger.add(message)
        said: list[Message] = []
        for item in (message, sample):
            if item is None:
                continue
            phase = now.phases.add(item)
            if phase is not None:
                said += [phase, self._event(phase)]
            change = now.watch.add(item, now.phases.airborne)
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

    def _compensated(self, setting: ParameterValue) -> list[Message]:
        wanted = options_parameter(self._state.merger.battery_id)
        if setting.name != wanted or not is_sag_compensated(setting.value):
            return []
        return [
            Event(
                time_s=setting.time_s,
                app=self.name,
                code=EventCode.SAG_COMPENSATED,
                severity=Severity.WARNING,
                text=f"{wanted} = {int(setting.value)}: the voltage is sag-compensated, not measured; no resistance "
                f"can be estimated from it. Set bit 6 off",
            )
        ]

    def _nothing_to_estimate(self, sample: BatterySample) -> list[Message]:
        now = self._state
        now.measured = now.measured or sample.current_a is not None
        now.first_s = sample.time_s if now.first_s is None else now.first_s
        if now.measured or now.told or sample.time_s - now.first_s < _NO_CURRENT_AFTER_S:
            return []
        now.told = True
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
