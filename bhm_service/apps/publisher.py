"""Publisher: estimates and predictions to the named values that the ground sees. What is not known is not said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bhm_service.messages import (
    AutopilotClock,
    EndOfDischarge,
    Message,
    Model,
    NamedValue,
    RemainingTime,
    StateEstimate,
    Tick,
)

_FRESH_S = 15.0
_NO_PREDICTION_S = 2.5  # longer without one, the predictor is down
_BOOT_WRAP_MS = 2**32
_SUFFIX = {Model.CIRC: "CIRC", Model.CHEM: "CHEM"}


@dataclass(frozen=True, slots=True)
class PublisherState:
    """What the app remembers: when the autopilot booted, on the clock of the messages."""

    boot_at_s: float | None


class PublisherApp:
    """One set of values for every fused prediction, which comes once a second; without one, that there is none."""

    name = "publisher"
    hears = (Tick, AutopilotClock, StateEstimate, EndOfDischarge, RemainingTime)
    says = (NamedValue,)
    keeps = PublisherState

    def __init__(self) -> None:
        self._boot_at_s: float | None = None
        self._said_s: float | None = None
        self._estimates: dict[Model, StateEstimate] = {}
        self._predictions: dict[Model, EndOfDischarge] = {}

    def state(self) -> PublisherState:
        return PublisherState(self._boot_at_s)

    def restore(self, state: PublisherState) -> None:
        self._boot_at_s = state.boot_at_s

    def on_message(self, message: Message) -> Sequence[Message]:
        if isinstance(message, Tick):
            return self._without_prediction(message.time_s)
        if isinstance(message, AutopilotClock):
            self._boot_at_s = message.time_s - message.boot_s
        elif isinstance(message, StateEstimate):
            self._estimates[message.model] = message
        elif isinstance(message, EndOfDischarge):
            self._predictions[message.model] = message
        elif isinstance(message, RemainingTime):
            return self._values(message)
        return []

    def _without_prediction(self, now_s: float) -> list[Message]:
        if self._said_s is None or now_s < self._said_s:
            self._said_s = now_s
        if now_s - self._said_s < _NO_PREDICTION_S:
            return []
        return [NamedValue(time_s=now_s, boot_ms=self._boot_ms(now_s), name="BHM_HLTH", value=2.0)]

    def _values(self, fused: RemainingTime) -> list[Message]:
        self._said_s = now = fused.time_s
        values: list[tuple[str, float | None]] = [
            ("BHM_RFT", fused.median_s),
            ("BHM_RFTLO", fused.low_s),
            ("BHM_RFTHI", fused.high_s),
            ("BHM_SOC", fused.soc),
            ("BHM_SOE", fused.soe),
        ]
        for model, suffix in _SUFFIX.items():
            prediction = self._predictions.get(model)
            if prediction is not None and prediction.time_s == now:
                values.append((f"RFT_{suffix}", prediction.median_s))
        for model, suffix in _SUFFIX.items():
            estimate = self._estimates.get(model)
            if estimate is not None and estimate.valid and now - estimate.time_s <= _FRESH_S:
                values.append((f"SOC_{suffix}", estimate.soc))
        values.append(("BHM_HLTH", float(fused.health)))
        boot_ms = self._boot_ms(now)
        return [
            NamedValue(time_s=now, boot_ms=boot_ms, name=name, value=value)
            for name, value in values
            if value is not None and math.isfinite(value)
        ]

    def _boot_ms(self, now_s: float) -> int:
        if self._boot_at_s is None:
            return 0
        return round(max(now_s - self._boot_at_s, 0.0) * 1000.0) % _BOOT_WRAP_MS
