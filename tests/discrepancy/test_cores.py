"""Tasks on several cores: their results, their errors, and what is left of them."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from bhm_service.discrepancy.cores import available, on_cores

_ABANDONED = """
import os, time
from bhm_service.discrepancy.cores import on_cores

def brief():
    os.write(1, b"%d\\n" % os.getpid())
    time.sleep(1.0)

on_cores([brief] * 8, 2)
"""

_CROWDED = """
import multiprocessing.popen_fork, os, resource
from functools import partial
from bhm_service.discrepancy.cores import on_cores

if os.getuid() == 0:
    os.setuid(65534)  # root may have any number of processes
resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))
assert on_cores([partial(pow, k, 2) for k in range(3)], 2) == [0, 1, 4]
"""


def test_results_come_in_the_order_of_their_tasks():
    assert on_cores([partial(pow, k, 2) for k in range(7)], 3) == [k**2 for k in range(7)]
    assert on_cores([], 2) == []


def test_two_tasks_run_at_the_same_time():
    """Each waits for a word of the other: one after the other neither would end."""
    (first_in, first_out), (second_in, second_out) = os.pipe(), os.pipe()

    def meet(say, hear):
        os.write(say, b"!")
        heard, _, _ = select.select([hear], [], [], 20.0)
        return os.read(hear, 1) if heard else b""

    assert on_cores([partial(meet, first_out, second_in), partial(meet, second_out, first_in)], 2) == [b"!", b"!"]
    for end in (first_in, first_out, second_in, second_out):
        os.close(end)


def test_an_error_is_raised_where_it_is_asked_for():
    with pytest.raises(ZeroDivisionError):
        on_cores([partial(divmod, 1, 0), partial(divmod, 1, 1)], 2)


def test_what_a_killed_worker_had_to_do_is_done_all_the_same():
    asker = os.getpid()

    def killed(number):
        if os.getpid() != asker:
            os.kill(os.getpid(), signal.SIGKILL)
        return number

    assert on_cores([partial(killed, k) for k in range(5)], 2) == list(range(5))


def test_workers_end_with_their_asker_however_that_ends():
    asker = subprocess.Popen([sys.executable, "-c", _ABANDONED], stdout=subprocess.PIPE, text=True)
    workers = [int(asker.stdout.readline()) for _ in range(2)]
    asker.kill()
    asker.wait()
    asker.stdout.close()
    for _ in range(200):
        if not any(map(_runs, workers)):
            break
        time.sleep(0.05)
    left = [pid for pid in workers if _runs(pid)]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert not left


def test_where_no_process_can_be_had_the_tasks_are_done_all_the_same():
    assert subprocess.run([sys.executable, "-c", _CROWDED], check=False, timeout=60).returncode == 0


def test_there_is_a_core():
    assert available() >= 1


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
