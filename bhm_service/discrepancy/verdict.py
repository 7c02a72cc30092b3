"""What may be said: the grammar of verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.discrepancy.decoys import BEATEN
from bhm_service.discrepancy.explanation import Contest, Course, Left
from bhm_service.discrepancy.findings import Verdict
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.odds import LEAST_SNR
from bhm_service.discrepancy.search import Search
from bhm_service.discrepancy.selection import LEAST_V, Selection
from bhm_service.discrepancy.slow import SLOW_S, slow, slow_samples, without_strays
from bhm_service.units import Array

SENSORS = frozenset({"current-gain", "current-offset", "voltage-gain", "voltage-offset", "time-skew"})
_SHIFTED = 4.5  # standard deviations of the lab by which a parameter has moved: ten nats of what was known before
_REST = 0.4  # of the misfit's RMS: what is left beyond this is said to be left
_LONE_LAB = 0.6  # times the lab's voltage error: a misfit that only some flights have is no error of the lab from here
_COLOURED_V = 0.005  # [V] of a cell: the most that a sensor may wander by itself
_UNLIKE = 3.0  # times the usual flight: a misfit that only some flights have
_FEWEST_VISIBLE = 3  # effects that recordings must be able to show before their silence says anything


@dataclass(frozen=True, slots=True)
class Judged:
    """A verdict and what is left unexplained."""

    verdict: Verdict
    rest: float


def judge(
    found: Search,
    chosen: Selection,
    fitted: Fitted,
    courses: Sequence[Course],
    rivals: Sequence[Contest],
    leftover: Left | None,
) -> Judged:
    """The verdict on a selection and on what it leaves."""
    before = [slow(without_strays(c.flight.voltage_v - c.before_v), c.flight) for c in courses]
    after = [slow(without_strays(c.flight.voltage_v - c.after_v), c.flight) for c in courses]
    floor = found.noise.sigma_v**2 / SLOW_S
    rest = float(np.sqrt(_power(after, floor) / max(_power(before, floor), 1e-12)))
    samples = [c.flight.time_s.size for c in courses]
    coloured = found.noise.worst_averaged_v(slow_samples(courses[0].flight), samples)
    named = chosen.names
    strange = leftover is not None or ((bool(named) or beyond_lab(found)) and _strange(found, after, floor, coloured))
    verdict: Verdict
    if named:
        unproven = bool(rivals) and float(np.mean([c.beaten for c in rivals])) < BEATEN
        alone: Verdict = "sensor-suspect" if named <= SENSORS else "named"
        verdict = "ambiguous" if chosen.alternatives or unproven else alone
    elif strange:
        verdict = "unknown"
    elif moved(fitted):
        verdict = "parameter"
    elif sum(snr >= LEAST_SNR for snr in found.snr.values()) < _FEWEST_VISIBLE:
        verdict = "not-excited"
    else:
        verdict = "none"
    left = float(np.clip(rest, 0.0, 1.0)) if strange or (named and rest > _REST) else 0.0
    return Judged(verdict, left)


def beyond_lab(found: Search) -> bool:
    """Whether the battery follows the flights less well than those of the lab's recordings that no fit saw."""
    misfit = np.concatenate(found.base.misfits)
    lab = found.base.lab
    return float(np.nanmean(misfit**2)) - found.noise.sigma_v**2 > (lab.series * lab.voltage_error_v) ** 2


def _power(parts: Sequence[Array], floor: float) -> float:
    return max(float(np.mean(np.concatenate(parts) ** 2)) - floor, 0.0)


def _strange(found: Search, after: Sequence[Array], floor: float, coloured_v: float) -> bool:
    """Whether more is left than errors of the lab and coloured noise, or far more in some flights than in most."""
    series = found.base.lab.series
    left = np.sqrt(np.maximum([np.mean(a**2) - floor for a in after], 0.0))
    usual = max(float(np.median(left)), 0.5 * LEAST_V * series)
    worst = float(left.max())
    known = found.base.lab.voltage_error_v * series
    lab = max(np.hypot(known, min(coloured_v, _COLOURED_V * series)), 2.0 * LEAST_V * series)
    return bool(worst > lab or worst > max(_UNLIKE * usual, _LONE_LAB * known, 2.0 * LEAST_V * series))


def moved(fitted: Fitted) -> bool:
    """Whether the pack's resistance or its capacity has moved by itself, further than chance would have it."""
    unknowns = fitted.joint.unknowns
    for name in ("lab_resistance", "lab_capacity"):
        where = unknowns.slice_of(name)
        if abs(float(fitted.x[where][0])) > _SHIFTED * float(fitted.joint.scale[where][0]):
            return True
    return False
