"""Logs of flights as tables, written the way a person would."""

from __future__ import annotations

import csv

import numpy as np

COLUMNS = ("t_s", "V", "I", "T_C", "alt_m", "speed_mps", "armed")


def columns(seconds=240.0, cells=6, amps=15.0, **changed):
    """A flight of a pack of 5 Ah: half a minute on the ground before and after it; columns by name, one may differ."""
    t = np.arange(0.0, seconds, 1.0)
    flying = (t >= 30.0) & (t < t[-1] - 30.0)
    current = np.where(flying, amps + np.sin(t), 0.3)
    volts = cells * (4.15 - np.cumsum(current) / 18000.0 - 0.006 * current)
    rows = {"t_s": t, "V": volts, "I": current, "T_C": np.full(t.size, 25.0)}
    rows |= {"alt_m": np.where(flying, 30.0, 0.0), "speed_mps": np.where(flying, 5.0, 0.0), "armed": flying * 1.0}
    return rows | changed


def write(path, rows):
    """A table; NaN is a blank."""
    with path.open("w", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(rows)
        for values in zip(*rows.values(), strict=True):
            out.writerow(["" if np.isnan(v) else f"{v:.4f}" for v in values])
    return path
