"""What `bhm run` prints."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bhm_service.messages import (
    BatterySample,
    Event,
    FlightPhase,
    LinkState,
    Message,
    RemainingTime,
    StateEstimate,
    StatusText,
)
from bhm_service.reporting.words import duration, number


class Screen:
    """The sink that prints what happens and, unless told not to, a line a second."""

    name = "screen"
    hears = (BatterySample, FlightPhase, StateEstimate, RemainingTime, StatusText, Event, LinkState)
    says: tuple[type, ...] = ()

    def __init__(self, write: Callable[[str], object], every_second: bool = True) -> None:
        self._write = write
        self._every_second = every_second
        self.line = ""
        self._sample: BatterySample | None = None
        self._airborne = False
        self._soc: dict[str, StateEstimate] = {}

    def on_message(self, message: Message) -> Sequence[Message]:
        if isinstance(message, BatterySample):
            self._sample = message
        elif isinstance(message, FlightPhase):
            self._airborne = message.airborne
        elif isinstance(message, StateEstimate):
            self._soc[message.model.value] = message
        elif isinstance(message, LinkState):
            because = f": {message.because}" if message.because else ""
            self._write(f"         {message.url} {message.status.value}{because}\n")
        elif isinstance(message, StatusText | Event):
            self._write(f"         {message.text}\n")
        elif isinstance(message, RemainingTime):
            self.line = self._line(message)
            if self._every_second:
                self._write(self.line + "\n")
        return []

    def _line(self, r: RemainingTime) -> str:
        remaining = "RFT     -"
        if r.median_s is not None:
            remaining = f"RFT {duration(r.median_s):>5} ({duration(r.low_s)} to {duration(r.high_s)})"
        models = "  ".join(
            f"{name} {100 * e.soc:.0f} % +-{164.5 * e.soc_sd:.0f}" for name, e in self._soc.items() if e.valid
        )
        sample = self._sample
        measured = "no battery data"
        if sample is not None:
            measured = f"{number(sample.voltage_v, 2)} V {number(sample.current_a, 1)} A"
        where = "flying" if self._airborne else "ground"
        health = ("good", "degraded", "no estimate")[r.health] + (f": {r.because}" if r.because else "")
        return f"{remaining:<30} SoC {models or '-':<32} {measured:<16} {where}  {health}"
