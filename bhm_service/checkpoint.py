"""What is believed, kept on disk once a second, and whether it still holds after a restart.

A belief belongs to one pack in one flight. The autopilot is the witness: while it has not booted, the pack has not been
taken out, and its own clock tells how old the checkpoint is even when the computer was off and has no clock.
"""

from __future__ import annotations

import json
import os
import threading
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bhm_service.codec import NotThisKindError, packed, unpacked
from bhm_service.messages import AutopilotClock, BatteryStatus, Heartbeat, Message
from bhm_service.units import SECONDS_PER_HOUR

FORMAT = 1
_SYNC_EVERY_S = 30.0
_ROUNDS = 3  # of bringing a file to the card that is replaced while the card takes its time
_LONGEST_BYTES = 1_000_000
_SAME_BOOT_S = 3.0  # two readings of the moment of boot differ by the link's delay and two quartzes' drift
_SAME_UNIX_BOOT_S = 10.0
_BACK_C = 0.010 * SECONDS_PER_HOUR  # [C] the autopilot counts whole mAh


@dataclass(frozen=True, slots=True, kw_only=True)
class Witness:
    """What an autopilot has said of itself and of the pack."""

    system: int | None = None
    battery_id: int = 0
    boot_at_s: float | None = None  # on the clock of the messages
    unix_boot_s: float | None = None
    consumed_c: float | None = None  # since its boot

    def hear(self, message: Message) -> Witness:
        """The witness after one more message."""
        system, boot, unix, consumed = self.system, self.boot_at_s, self.unix_boot_s, self.consumed_c
        if isinstance(message, Heartbeat):
            system = message.system
        elif isinstance(message, AutopilotClock):
            boot = message.time_s - message.boot_s
            unix = unix if message.unix_s is None else message.unix_s - message.boot_s
        elif isinstance(message, BatteryStatus) and message.battery_id == self.battery_id:
            consumed = consumed if message.consumed_c is None else message.consumed_c
        else:
            return self
        return Witness(
            system=system, battery_id=self.battery_id, boot_at_s=boot, unix_boot_s=unix, consumed_c=consumed
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """Everything that is needed to go on, and to know whether one may."""

    time_s: float  # on the clock of the messages
    monotonic_s: float  # the computer's own, at the same moment
    host_boot: str  # which boot of the computer that clock counts from
    version: str  # of the package
    belongs_to: str  # fingerprint of the battery file and of the settings that the belief rests on
    witness: Witness
    states: dict[str, Any]


def refusal(kept: Checkpoint, now: Witness, now_s: float, host_boot: str, max_age_s: float) -> tuple[str | None, float]:
    """Why the checkpoint does not hold, or None; and how old it is. [s]

    ``now`` must have a system and a moment of boot. On the same boot of the computer ``now_s`` is on the checkpoint's
    clock and two moments of boot can be compared; after another, only the date can say that the autopilot did not
    boot in between, and its clock says how much time went by.
    """
    then = kept.witness
    assert now.boot_at_s is not None and then.boot_at_s is not None
    if now.system != then.system:
        return f"it is of another vehicle (system {then.system}, now {now.system})", 0.0
    if host_boot and kept.host_boot == host_boot:
        age = now_s - kept.time_s
        rebooted = abs(now.boot_at_s - then.boot_at_s) > _SAME_BOOT_S
    elif now.unix_boot_s is None or then.unix_boot_s is None:
        return "the computer was restarted, and without a date nothing tells whether the autopilot was too", 0.0
    else:
        age = (now_s - now.boot_at_s) - (kept.time_s - then.boot_at_s)
        rebooted = abs(now.unix_boot_s - then.unix_boot_s) > _SAME_UNIX_BOOT_S
    if rebooted:
        return "the autopilot has booted since", age
    if age < 0.0:
        return "it is from the future", age
    if age > max_age_s:
        return f"it is {age:.0f} s old, and {max_age_s:.0f} s is the most", age
    if now.consumed_c is not None and then.consumed_c is not None and now.consumed_c < then.consumed_c - _BACK_C:
        return "the consumed charge went back: another pack", age
    return None, age


class CheckpointFile:
    """One file, replaced as a whole: it holds the last checkpoint or the one before, never a piece of one.

    `write` only renames; the kernel brings it to the card when it likes. A process that is killed loses nothing by
    that, and a flash card would wear out on 86 400 fsyncs a day. They matter only when the computer loses power while
    the pack goes on, so there is one every 30 s and one at each landing, in a thread of its own: a card may take a
    second over it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._fresh = path.with_name(path.name + ".new")
        self._synced_s: float | None = None
        self._syncing: threading.Thread | None = None

    def read(self) -> Checkpoint | None:
        """The checkpoint; None where there is none. Raises NotThisKindError for a damaged or foreign one."""
        try:
            with self.path.open("rb") as stream:
                data = stream.read(_LONGEST_BYTES)
        except FileNotFoundError:
            return None
        except OSError as why:
            raise NotThisKindError(why.strerror or "it cannot be read") from None
        crc, _, body = data.partition(b"\n")
        if crc != b"bhm checkpoint %d %08x" % (FORMAT, zlib.crc32(body)):
            raise NotThisKindError("the file is damaged, or of another version")
        try:
            kept = unpacked(Checkpoint, json.loads(body))
        except (ValueError, RecursionError) as why:
            raise NotThisKindError(str(why)) from None
        return kept

    def write(self, kept: Checkpoint, landed: bool = False) -> None:
        """Replace the file. Raises OSError."""
        body = json.dumps(packed(kept), separators=(",", ":")).encode()
        self._fresh.parent.mkdir(parents=True, exist_ok=True)
        self._fresh.write_bytes(b"bhm checkpoint %d %08x\n" % (FORMAT, zlib.crc32(body)) + body)
        self._fresh.replace(self.path)
        if landed or self._synced_s is None or not 0.0 <= kept.time_s - self._synced_s < _SYNC_EVERY_S:
            self._sync(kept.time_s)

    def close(self) -> None:
        """Wait for the card."""
        if self._syncing is not None:
            self._syncing.join()

    def _sync(self, now_s: float) -> None:
        if self._syncing is not None and self._syncing.is_alive():
            return
        self._synced_s = now_s
        self._syncing = threading.Thread(target=_fsync, args=(self.path,), daemon=True)
        self._syncing.start()


def _fsync(path: Path) -> None:
    """Bring a file that is replaced now and then to the card, and its name."""
    for _ in range(_ROUNDS):
        try:
            with path.open("rb") as stream:
                os.fsync(stream.fileno())
                folder = os.open(path.parent, os.O_RDONLY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)
                # Replaced meanwhile: the card has the name of a file that it may not have yet. (While this one is open
                # no other is given its number.)
                if os.path.samestat(os.fstat(stream.fileno()), path.stat()):
                    return
        except OSError:
            return


def host_boot() -> str:
    """Which boot of this computer it is; monotonic clocks of the same one can be compared."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return ""  # never equal to a real one


def state_folder(environment: Mapping[str, str]) -> Path:
    """Where relative paths of the service file begin: systemd's StateDirectory, else the user's own."""
    given = environment.get("STATE_DIRECTORY", "").split(":")[0]
    if given:
        return Path(given)
    home = environment.get("XDG_STATE_HOME") or str(Path(environment.get("HOME", "/")) / ".local" / "state")
    return Path(home) / "bhm"
