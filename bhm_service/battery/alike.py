"""What is the same in many rows is worked out once.

A fit runs a recording for many vectors side by side, and most of them move a number that a given state or voltage does
not depend on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bhm_service.units import Array, Flags, Places, Value

_AXES = 3  # rows, recordings, samples: what a filter steps has fewer, and nothing to save


def once(function: Callable[..., Value], *series: Value) -> Value:
    """A function of series (M, .., T) that takes each row by itself, worked out for the rows that differ.

    Series may have a first axis of one, or fewer axes, for what is the same in all rows. Bit for bit what the function
    makes of all of them.
    """
    for s in series:  # at every step of a filter: quicker than the largest of them
        if isinstance(s, np.ndarray) and s.ndim >= _AXES:
            break
    else:
        return function(*series)
    arrays = [np.asarray(s) for s in series]
    axes = max(a.ndim for a in arrays)
    own = [a.ndim == axes and a.shape[0] > 1 for a in arrays]
    if not any(own):
        return function(*series)
    first, of = _different([a for a, has_rows in zip(arrays, own, strict=True) if has_rows])
    if first.size == of.size:
        return function(*series)
    rows = (a[first] if has_rows else a for a, has_rows in zip(arrays, own, strict=True))
    found: Array = np.asarray(function(*rows))[of]
    return found


def _different(series: list[Array]) -> tuple[Places, Places]:
    """Which rows of series (M, .., T) differ from all before them, and which of those each row is."""
    count = series[0].shape[0]
    # Rows that differ hardly ever end alike; those that do are compared in full.
    ends = np.concatenate([s[..., -1].reshape(count, -1) for s in series], axis=1)
    alike: dict[bytes, list[int]] = {}
    for k, end in enumerate(ends):
        alike.setdefault(end.tobytes(), []).append(k)
    of = np.empty(count, dtype=np.intp)
    first: list[int] = []
    for places in alike.values():
        left = places
        while left:
            others = np.array(left[1:], dtype=np.intp)
            same = _same(series, left[0], others)
            of[left[0]] = of[others[same]] = len(first)
            first.append(left[0])
            left = others[~same].tolist()
    return np.array(first, dtype=np.intp), of


def _same(series: list[Array], row: int, others: Places) -> Flags:
    """Which of some other rows are the same as one."""
    same = np.ones(others.size, dtype=bool)
    for own in series if others.size else ():
        same &= (own[others] == own[row]).reshape(others.size, -1).all(axis=1)
    return same
