"""Tasks that do not wait for each other, on as many cores as there are.

Each worker is forked when a round of tasks begins, so it knows all that was known then, and only results are sent.
Threads would take turns: between two operations on arrays of this size the interpreter does as much as they do.
"""

from __future__ import annotations

import contextlib
import os
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection, wait
from typing import TypeVar

ResultT = TypeVar("ResultT")


def available() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_cores(tasks: Sequence[Callable[[], ResultT]], cores: int) -> list[ResultT]:
    """The results of tasks, in their order; what a task does to anything but its result is lost with its worker.

    What a worker fails at is done here, where its error is seen.
    """
    workers = min(cores, len(tasks))
    done = _worked(tasks, workers) if workers > 1 and "fork" in get_all_start_methods() else {}
    return [done[k] if k in done else task() for k, task in enumerate(tasks)]


def _worked(tasks: Sequence[Callable[[], ResultT]], workers: int) -> dict[int, ResultT]:
    """What the workers did, as many as could be had; each gets the next task when it has done one."""
    fork = get_context("fork")
    left = deque(range(len(tasks)))
    done: dict[int, ResultT] = {}
    lines: list[Connection] = []
    processes = []
    try:
        for _ in range(workers):
            here, there = fork.Pipe()
            lines.append(here)
            process = fork.Process(target=_work, args=(tasks, there, tuple(lines)), daemon=True)
            with warnings.catch_warnings():
                # Python warns of locks that other threads (a progress bar's) hold while it forks: a worker takes none.
                warnings.simplefilter("ignore", DeprecationWarning)
                try:
                    process.start()
                except OSError:  # no memory for one more, or no room in a group of processes
                    break
                finally:
                    there.close()
            processes.append(process)
        at: dict[Connection, int] = {}
        free = lines[: len(processes)]
        while free or at:
            for line in free[: len(left)]:
                at[line] = left.popleft()
                with contextlib.suppress(OSError):
                    line.send(at[line])
            ready = wait(list(at)) if at else []
            free = []
            for line in [line for line in at if line in ready]:
                k = at.pop(line)
                with contextlib.suppress(EOFError, OSError):
                    done[k] = line.recv()
                    free.append(line)
    finally:
        for line in lines:
            line.close()
        for process in processes:
            process.kill()
            process.join()
    return done


def _work(tasks: Sequence[Callable[[], object]], line: Connection, others: Sequence[Connection]) -> None:
    """Do what is asked for until nobody is there to ask."""
    with contextlib.suppress(BaseException):  # the asker does it again, and sees why it fails
        for other in others:
            other.close()  # so that a line ends with its asker
        while True:
            line.send(tasks[line.recv()]())
    os._exit(0)  # what the asker has not written yet is not this process's to write
