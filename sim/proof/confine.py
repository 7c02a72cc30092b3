"""A process that cannot look: no sight of its parents, of folders that hold answers, or of a network.

On Linux the tool runs in mount, process and network namespaces of its own (util-linux `unshare`, as root or in a user
namespace): the processes that hold answers do not exist there, so neither /proc nor a system call reaches their memory,
and folders to hide are empty. Where namespaces are refused, the holders at least make their memory unreadable.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

_PR_SET_DUMPABLE = 4
_HIDE = 'while [ "$1" != -- ]; do mount -t tmpfs none "$1" || exit 97; shift; done; shift; exec "$@"'
_NAMESPACES = ("unshare", "--mount", "--pid", "--fork", "--mount-proc", "--net", "--ipc", "--kill-child")
_WAYS = (_NAMESPACES, ("unshare", "--user", "--map-root-user", *_NAMESPACES[1:]))


@dataclass(frozen=True, slots=True)
class Ran:
    """How a confined process ended."""

    status: int | None  # None: killed after its time
    said: str  # the last of its output
    seconds: float
    cpu_seconds: float
    peak_mib: float


@dataclass(frozen=True, slots=True)
class Confinement:
    """How processes are kept from looking, and which folders they find empty."""

    prefix: tuple[str, ...]
    hidden: tuple[Path, ...]

    def words(self) -> str:
        """For the score card."""
        if self.prefix:
            return "in its own mount, process and network namespaces, shared data hidden"
        return "in a process of its own; namespaces are refused here, so only memory is closed"

    def command(self, program: Sequence[str]) -> list[str]:
        """The program, confined."""
        if not self.prefix:
            return list(program)
        hidden = [str(folder) for folder in self.hidden]
        return [*self.prefix, "sh", "-c", _HIDE, "sh", *hidden, "--", *program]

    def run(self, program: Sequence[str], folder: Path, longest_s: float, env: Mapping[str, str]) -> Ran:
        """Run a program in ``folder``; its process group is killed after ``longest_s``."""
        begin = time.monotonic()
        with tempfile.TemporaryFile() as output:
            process = subprocess.Popen(
                self.command(program), cwd=folder, stdout=output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                env=dict(env), start_new_session=True,
            )  # fmt: skip
            status, cpu, peak = _wait(process.pid, longest_s)
            process.returncode = status if status is not None else -int(signal.SIGKILL)
            output.seek(max(0, output.seek(0, os.SEEK_END) - 4000))
            said = output.read().decode(errors="replace")
        return Ran(status, said, time.monotonic() - begin, cpu, peak)


def _wait(pid: int, longest_s: float) -> tuple[int | None, float, float]:
    """Exit status, processor time [s] and largest resident memory [MiB] of a process and what it waited for."""
    end = time.monotonic() + longest_s
    killed = False
    while True:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            ended = None if killed else os.waitstatus_to_exitcode(status)
            return ended, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0
        if time.monotonic() > end and not killed:
            killed = True
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
        time.sleep(0.02)


def confinement(hidden: Sequence[Path]) -> Confinement:
    """The strongest that this machine allows."""
    there = tuple(folder.resolve() for folder in hidden if folder.is_dir())
    for way in _WAYS:
        found = Confinement(way, there)
        with contextlib.suppress(OSError):
            if subprocess.run(found.command(["true"]), capture_output=True, timeout=20).returncode == 0:
                return found
    return Confinement((), there)


def close_memory() -> None:
    """Keep other processes of this user from reading this one's memory (Linux; elsewhere nothing happens)."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 0, 0, 0, 0)
