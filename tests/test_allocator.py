"""Arrays that come and go cost the system no pages once freed memory is kept."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

_FAULTS = """
import resource
import sys
import numpy as np
from bhm_service.allocator import keep_freed
if sys.argv[1] == "kept":
    keep_freed()
small = np.ones(100_000)  # 800 kB
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(200):
    several = [small + k for k in range(4)]
    del several
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""
_ROUND_PAGES = 4 * 800_000 // 4096


def _faults(how: str) -> int:
    run = subprocess.run([sys.executable, "-c", _FAULTS, how], capture_output=True, text=True, check=True)
    return int(run.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc is told")
def test_freed_memory_serves_the_next_array() -> None:
    assert _faults("kept") < 10 * _ROUND_PAGES < 100 * _ROUND_PAGES < _faults("handed back")
