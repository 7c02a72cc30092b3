"""The series of a replay, one line a second (.csv)."""

from __future__ import annotations

import csv
from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path

from bhm_service.messages import EndOfDischarge, StateEstimate
from bhm_service.replay import Replay
from bhm_service.units import celsius

_ESTIMATE = ("soc", "soc_low", "soc_high", "soe", "expected_V", "expected_sd_V", "nis", "valid", "rejected")
_PREDICTION = ("rft_s", "rft_low_s", "rft_high_s", "ends_by")


def write_series(path: Path, pages: Replay) -> None:
    """Write what was measured, estimated and predicted at every whole second of the replay; blank is not known."""
    models = list(pages.estimates)
    header = ["time_s", "voltage_V", "current_A", "temperature_C", "airborne"]
    for model in models:
        header += [f"{model.value}_{name}" for name in (*_ESTIMATE, *_PREDICTION)]
    header += ["rft_s", "rft_low_s", "rft_high_s", "soc", "soe", "health"]
    sample_times = [s.time_s for s in pages.samples]
    phase_times = [p.time_s for p in pages.phases]
    estimate_times = {m: [e.time_s for e in pages.estimates[m]] for m in models}
    predictions = {m: {p.time_s: p for p in pages.predictions.get(m, [])} for m in models}
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(header)
        for fused in pages.remaining:
            now = fused.time_s
            k = bisect_right(sample_times, now) - 1
            sample = pages.samples[k] if k >= 0 and now - sample_times[k] < 15.0 else None
            phase = bisect_right(phase_times, now) - 1
            line: list[object] = [f"{now:.3f}"]
            if sample is None:
                line += ["", "", ""]
            else:
                kelvin = sample.temperature_k
                line += [_text(sample.voltage_v, 3), _text(sample.current_a, 2)]
                line.append(_text(None if kelvin is None else celsius(kelvin), 1))
            line.append(int(pages.phases[phase].airborne) if phase >= 0 else "")
            for model in models:
                k = bisect_right(estimate_times[model], now) - 1
                fresh = k >= 0 and now - estimate_times[model][k] < 15.0
                line += _estimate(pages.estimates[model][k] if fresh else None)
                line += _prediction(predictions[model].get(now))
            line += [_text(fused.median_s, 1), _text(fused.low_s, 1), _text(fused.high_s, 1)]
            line += [_text(fused.soc, 4), _text(fused.soe, 4), fused.health]
            writer.writerow(line)


def _estimate(estimate: StateEstimate | None) -> Sequence[object]:
    if estimate is None:
        return [""] * len(_ESTIMATE)
    e = estimate
    return [
        *(_text(value, 4) for value in (e.soc, e.soc_low, e.soc_high, e.soe)),
        _text(e.voltage_expected_v, 3),
        _text(e.voltage_expected_sd_v, 4),
        _text(e.nis, 3),
        int(e.valid),
        "" if e.rejected is None else e.rejected.value,
    ]


def _prediction(prediction: EndOfDischarge | None) -> Sequence[object]:
    if prediction is None:
        return [""] * len(_PREDICTION)
    p = prediction
    return [_text(p.median_s, 1), _text(p.low_s, 1), _text(p.high_s, 1), p.ending.value]


def _text(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
