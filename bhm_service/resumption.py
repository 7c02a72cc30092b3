"""After a restart: whether what was believed still holds. Messages wait until the autopilot has told enough to know."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bhm_service.apps.reader import ReaderState
from bhm_service.checkpoint import Checkpoint, CheckpointFile, Witness, refusal
from bhm_service.codec import NotThisKindError, unpacked
from bhm_service.executive import reader_state
from bhm_service.messages import BatterySample, Heartbeat, Message
from bhm_service.telemetry import SampleMerger

_WAIT_S = 5.0  # after the first heartbeat, for the autopilot's clock and a battery report
_CONSUMED_WAIT_S = 1.2  # after that report, for the consumed charge, if it was told before


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What identifies this run of the service."""

    version: str  # of the package
    belongs_to: str  # fingerprint of battery file and settings
    host_boot: str
    battery_id: int
    max_age_s: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether to go on from the checkpoint."""

    refused: str | None
    age_s: float


def kept_for(run: Run, file: CheckpointFile) -> Checkpoint | str | None:
    """The checkpoint that may hold; why the file's does not, in words; None where there is none."""
    try:
        kept = file.read()
    except NotThisKindError as why:
        return str(why)
    if kept is None:
        return None
    if kept.version != run.version:
        return f"it is of version {kept.version}"
    if kept.belongs_to != run.belongs_to:
        return "the battery file or the settings are others now"
    if kept.witness.system is None or kept.witness.boot_at_s is None:
        return "it does not tell which boot of the autopilot it belongs to"
    return kept


class Resumption:
    """Holds messages back until there is a verdict; it comes with the autopilot's clock and one battery report."""

    def __init__(self, run: Run, kept: Checkpoint) -> None:
        self._run = run
        self.kept = kept
        self.held: list[Message] = []
        self._witness = Witness(battery_id=run.battery_id)
        self._merger = SampleMerger(run.battery_id)
        self._sample: BatterySample | None = None
        self._heard_s: float | None = None

    def hear(self, message: Message) -> Verdict | None:
        """Hold one message more back; the verdict as soon as there is one."""
        self.held.append(message)
        self._witness = self._witness.hear(message)
        self._sample = self._merger.add(message) or self._sample
        if isinstance(message, Heartbeat) and self._heard_s is None:
            self._heard_s = message.time_s
        return self.waited(message.time_s)

    def waited(self, now_s: float) -> Verdict | None:
        """The verdict, if all is told that is needed for it, or the autopilot has had long enough to tell."""
        witness, sample = self._witness, self._sample
        if witness.system is not None and witness.boot_at_s is not None and sample is not None:
            told = self.kept.witness.consumed_c is None or witness.consumed_c is not None
            if told or now_s - sample.time_s >= _CONSUMED_WAIT_S:
                return self._verdict(sample, now_s)
        if self._heard_s is None or now_s - self._heard_s < _WAIT_S:
            return None
        missing = "the time since its boot" if self._witness.boot_at_s is None else "anything of the battery"
        return Verdict(f"the autopilot did not tell {missing} within {_WAIT_S:.0f} s", 0.0)

    def _verdict(self, sample: BatterySample, now_s: float) -> Verdict:
        why, age = refusal(self.kept, self._witness, now_s, self._run.host_boot, self._run.max_age_s)
        if why is not None:
            return Verdict(why, age)
        try:
            before = unpacked(ReaderState, reader_state(self.kept.states))
        except (NotThisKindError, KeyError, TypeError, AttributeError) as not_this:
            return Verdict(f"it cannot be understood: {not_this}", age)
        before.watch.interrupt("the service was away")
        change = before.watch.add(replace(sample, time_s=self.kept.time_s + age), before.phases.airborne)
        return Verdict(None if change is None else f"another pack: {change.because}", age)
