"""The memory of arrays that come and go: kept by the process instead of handed back to the system and asked for again.

A search makes thousands of arrays a second of some hundred kilobytes. What is handed back comes again page by page,
each page with a fault and cleared: a seventh of what `bhm explain` and `bhm identify` took.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # mallopt(3)
_KEPT = 64 << 20  # [bytes] free at the end of the heap, before any is handed back
_OWN_MAP = 32 << 20  # [bytes] from which an array is mapped by itself: the most that glibc takes on 64 bits


def keep_freed() -> None:
    """Keep freed memory for the next array, up to 64 MiB (glibc; with another C library nothing happens)."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            library = ctypes.CDLL(None)
            library.mallopt(_MMAP_THRESHOLD, _OWN_MAP)
            library.mallopt(_TRIM_THRESHOLD, _KEPT)
