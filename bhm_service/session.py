"""One run of the apps beside an autopilot: messages in, a tick a second, the checkpoint and the flight recorder.

It has no clock and no socket of its own: the service feeds it from the links, a test from a simulation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from bhm_service.bus import Bus
from bhm_service.checkpoint import Checkpoint, CheckpointFile, Witness
from bhm_service.codec import NotThisKindError
from bhm_service.executive import is_airborne, restore, states
from bhm_service.flight_recorder import Segments
from bhm_service.messages import Event, EventCode, LinkReport, LinkState, Message, Severity, Tick
from bhm_service.resumption import Resumption, Run, Verdict, kept_for

_NAME = "service"
_RECORD_AGAIN_S = 60.0
_ROTATE_ON_GROUND = 0.5  # share of a segment, so that few flights are in two pieces
_PASSES = (Tick, LinkState, LinkReport, Event)  # what does not wait for a verdict on the checkpoint


class Memory:
    """The checkpoint: taken up at the start, kept once a second."""

    def __init__(self, run: Run, file: CheckpointFile) -> None:
        self._run, self._file = run, file
        self._witness = Witness(battery_id=run.battery_id)
        self._airborne = False
        self._failed = ""
        kept = kept_for(run, file)
        self.refused = kept if isinstance(kept, str) else ""
        self.resumption = Resumption(run, kept) if isinstance(kept, Checkpoint) else None

    def offset_s(self, monotonic_s: float) -> float:
        """From the computer's clock to the messages': on one boot of it they go on over restarts as one clock."""
        kept = None if self.resumption is None else self.resumption.kept
        if kept is None or kept.host_boot != self._run.host_boot or monotonic_s < kept.monotonic_s:
            return 0.0
        return kept.time_s - kept.monotonic_s

    def hear(self, message: Message) -> None:
        """Follow who the autopilot is."""
        self._witness = self._witness.hear(message)

    def keep(self, now_s: float, monotonic_s: float, remembered: dict[str, Any], ending: bool = False) -> str:
        """Write the checkpoint; why that fails, when it begins to, else nothing."""
        if self._witness.system is None or self._witness.boot_at_s is None or self.resumption is not None:
            return ""
        airborne = is_airborne(remembered)
        landed, self._airborne = self._airborne and not airborne, airborne
        kept = Checkpoint(
            time_s=now_s,
            monotonic_s=monotonic_s,
            host_boot=self._run.host_boot,
            version=self._run.version,
            belongs_to=self._run.belongs_to,
            witness=self._witness,
            states=remembered,
        )
        before = self._failed
        try:
            self._file.write(kept, landed or ending)
            self._failed = ""
        except OSError as why:
            self._failed = f"the checkpoint cannot be written: {why.strerror} ({self._file.path})"
        if ending:
            self._file.close()
        return self._failed if self._failed != before else ""


class Recording:
    """The flight recorder: what the bus carries, and where a replay has to begin."""

    def __init__(self, segments: Segments, head: Mapping[str, Any]) -> None:
        self._segments, self._head = segments, head
        self._again_s: float | None = None
        self._failed = ""

    def second(self, now_s: float, remembered: dict[str, Any], airborne: bool) -> str:
        """Write what the second brought, go to the next segment when it is time; why recording stops, when it does."""
        try:
            if self._again_s is None or now_s >= self._again_s:
                if self._segments.fullness >= (1.0 if airborne else _ROTATE_ON_GROUND):
                    self._segments.begin({**self._head, "time_s": now_s})
                    self._segments.add("states", remembered)
                self._segments.flush()
                self._again_s, self._failed = None, ""
        except OSError as why:
            self._again_s = now_s + _RECORD_AGAIN_S
            first, self._failed = not self._failed, why.strerror or str(why)
            if first:
                return f"the flight recorder stopped: {self._failed}; tried again every minute"
        return ""

    def resumed(self, remembered: dict[str, Any]) -> None:
        """The apps went on from a checkpoint: so has a replay to do here."""
        self._segments.add("states", remembered)

    def close(self) -> None:
        """End the segment."""
        self._segments.close()


class Session:
    """Bus, checkpoint and flight recorder together. Times given to it are the computer's monotonic clock."""

    def __init__(self, bus: Bus, memory: Memory | None, recording: Recording | None, now_s: float) -> None:
        self.bus = bus
        self._memory, self._recording = memory, recording
        self._offset_s = 0.0 if memory is None else memory.offset_s(now_s)
        begins = now_s + self._offset_s
        if recording is not None:
            self._tell(begins, recording.second(begins, states(bus.apps), False), EventCode.RECORDING_STOPPED)
        if memory is not None and memory.refused:
            self._tell(begins, f"the checkpoint is not used: {memory.refused}", EventCode.CHECKPOINT_REFUSED)

    @property
    def waiting(self) -> bool:
        """Whether the autopilot has yet to tell if the checkpoint holds."""
        return self._memory is not None and self._memory.resumption is not None

    def take(self, message: Message) -> bool:
        """One message from a link. Whether a tick should follow at once: the apps just went on in flight."""
        if self._offset_s != 0.0:
            message = replace(message, time_s=message.time_s + self._offset_s)
        memory = self._memory
        if memory is None:
            self.bus.publish(message)
            return False
        if memory.resumption is None or isinstance(message, _PASSES):
            memory.hear(message)
            self.bus.publish(message)
            return False
        verdict = memory.resumption.hear(message)
        if verdict is None:
            return False
        self._resume(memory, memory.resumption, verdict, message.time_s)
        return True

    def tick(self, monotonic_s: float, ending: bool = False) -> None:
        """A second has gone by."""
        now = monotonic_s + self._offset_s
        memory = self._memory
        if memory is not None and memory.resumption is not None:
            verdict = memory.resumption.waited(now)
            if verdict is not None:
                self._resume(memory, memory.resumption, verdict, now)
                now = monotonic_s + self._offset_s
        self.bus.publish(Tick(time_s=now))
        remembered = states(self.bus.apps)
        if memory is not None:
            failed = memory.keep(now, monotonic_s, remembered, ending)
            self._tell(now, failed, EventCode.CHECKPOINT_NOT_WRITTEN)
        if self._recording is not None:
            airborne = is_airborne(remembered)
            stopped = self._recording.second(now, remembered, airborne)
            self._tell(now, stopped, EventCode.RECORDING_STOPPED)

    def close(self, monotonic_s: float) -> None:
        """The last second: the checkpoint goes to the card, the segment ends."""
        self.tick(monotonic_s, ending=True)
        if self._recording is not None:
            self._recording.close()

    def _resume(self, memory: Memory, resumption: Resumption, verdict: Verdict, now_s: float) -> None:
        why = verdict.refused
        if why is None:
            try:
                restore(self.bus.apps, resumption.kept.states)
            except NotThisKindError as not_this:
                why = str(not_this)
        shift = 0.0
        if why is None:
            shift = resumption.kept.time_s + verdict.age_s - now_s
            shift = 0.0 if abs(shift) < 1e-6 else shift
            self._offset_s += shift
            if self._recording is not None:
                self._recording.resumed(states(self.bus.apps))
            code, severity = EventCode.RESUMED, Severity.INFO
            text = f"went on from what was believed {verdict.age_s:.1f} s ago"
        else:
            code, severity, text = EventCode.CHECKPOINT_REFUSED, Severity.WARNING, f"the checkpoint is not used: {why}"
        memory.resumption = None
        self.bus.publish(Event(time_s=now_s + shift, app=_NAME, code=code, severity=severity, text=text))
        for message in resumption.held:
            held = replace(message, time_s=message.time_s + shift) if shift else message
            memory.hear(held)
            self.bus.publish(held)

    def _tell(self, now_s: float, text: str, code: EventCode) -> None:
        if text:
            self.bus.publish(Event(time_s=now_s, app=_NAME, code=code, severity=Severity.WARNING, text=text))
