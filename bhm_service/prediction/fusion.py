"""One remaining flying time from both models.

Each model's samples count with a weight: how well it has lately predicted the voltage. The result is the weighted
pool of samples, so its band covers both models where they differ, and it is never more optimistic than the evidence:
its median is at most the weighted mean of the medians, and a pack that is at its cut-off voltage has nothing left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.messages import Ending, EndOfDischarge, Model, RemainingTime, StateEstimate

# A model is not trusted more for predicting voltage better than the sensor can tell. [V] of a cell
_INDISTINGUISHABLE_V = 0.004


@dataclass(frozen=True, slots=True, kw_only=True)
class Voice:
    """What one model has to say."""

    estimate: StateEstimate
    prediction: EndOfDischarge | None
    error_v: float  # rolling RMS of its voltage predictions, per cell

    @property
    def weight(self) -> float:
        """Inverse of the mean squared error."""
        return 1.0 / (self.error_v**2 + _INDISTINGUISHABLE_V**2)


def fuse(time_s: float, voices: Sequence[Voice], expected: int, at_cutoff: bool) -> RemainingTime:
    """What to tell the pilot.

    Parameters
    ----------
    voices : those models whose estimate is valid; at least none.
    expected : how many models there should be.
    at_cutoff : the pack has been at its cut-off voltage under load for some seconds.
    """
    if not voices:
        return _nothing(time_s, "no valid estimate of the state of charge")
    total = sum(voice.weight for voice in voices)
    weights = [voice.weight / total for voice in voices]
    soc = sum(w * v.estimate.soc for w, v in zip(weights, voices, strict=True))
    soe = sum(w * v.estimate.soe for w, v in zip(weights, voices, strict=True))
    named: tuple[tuple[Model, float], ...] = tuple((v.estimate.model, w) for w, v in zip(weights, voices, strict=True))
    talking = [(w, v.prediction) for w, v in zip(weights, voices, strict=True) if v.prediction is not None]
    reasons = [] if len(voices) == expected else ["one model has no valid estimate"]
    if at_cutoff:
        return RemainingTime(
            time_s=time_s, median_s=0.0, low_s=0.0, high_s=0.0, soc=soc, soe=soe, weights=named,
            ending=Ending.VOLTAGE, health=1, because="the pack is at its cut-off voltage",
        )  # fmt: skip
    if not talking:
        return RemainingTime(
            time_s=time_s, median_s=None, low_s=None, high_s=None, soc=soc, soe=soe, weights=named,
            ending=None, health=1, because="the load to expect is not known yet",
        )  # fmt: skip
    low, median, high = _pooled(talking)
    mean = sum(w * p.median_s for w, p in talking) / sum(w for w, _ in talking)
    median = min(median, mean)
    if len(talking) > 1 and _apart([p for _, p in talking]):
        reasons.append("the models disagree")
    if high > 2.5 * max(low, 1.0) and low > 60.0:
        reasons.append("the band is wide")
    heaviest = max(talking, key=lambda pair: pair[0])[1]
    return RemainingTime(
        time_s=time_s,
        median_s=median,
        low_s=min(low, median),
        high_s=max(high, median),
        soc=soc,
        soe=soe,
        weights=named,
        ending=heaviest.ending,
        health=1 if reasons else 0,
        because="; ".join(reasons),
    )


def _nothing(time_s: float, because: str) -> RemainingTime:
    return RemainingTime(
        time_s=time_s, median_s=None, low_s=None, high_s=None, soc=None, soe=None, weights=(),
        ending=None, health=2, because=because,
    )  # fmt: skip


def _pooled(talking: Sequence[tuple[float, EndOfDischarge]]) -> tuple[float, float, float]:
    samples = np.concatenate([prediction.samples_s for _, prediction in talking])
    weights = np.concatenate([np.full(len(p.samples_s), w / len(p.samples_s)) for w, p in talking])
    order = np.argsort(samples, kind="stable")
    rank = (np.cumsum(weights[order]) - 0.5 * weights[order]) / weights.sum()
    low, median, high = np.interp((0.05, 0.5, 0.95), rank, samples[order])
    return float(low), float(median), float(high)


def _apart(predictions: Sequence[EndOfDischarge]) -> bool:
    """Whether one model's whole band lies above another's."""
    return max(p.low_s for p in predictions) > min(p.high_s for p in predictions)
