"""Predictor: once a second, how long the pack lasts under the load to expect; one distribution a model, and both."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.pack import PackModel
from bhm_service.estimation.ukf import Belief
from bhm_service.messages import (
    BatterySample,
    Ending,
    EndOfDischarge,
    FlightPhase,
    Message,
    Model,
    PackChange,
    RemainingTime,
    StateEstimate,
    Tick,
)
from bhm_service.prediction.demand import Load, RecentLoad
from bhm_service.prediction.end_of_discharge import ENDINGS, Limits, end_of_discharge
from bhm_service.prediction.fusion import Voice, fuse
from bhm_service.prediction.uncertainty import Points, Samples, SigmaPoints
from bhm_service.units import Array

_STALE_S = 15.0  # an estimate older than this says nothing of now
_ERROR_MEMORY_S = 120.0
_AT_CUTOFF_S = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictorSettings:
    """How the flight ahead is imagined."""

    limits: Limits
    over: str = "samples"  # or "sigma-points"
    samples: int = 100
    seed: int = 1
    load_window_s: float = 90.0
    load_spread: str = "quiet"  # quiet: how the mean load may differ; 1sigma, 3sigma: the load of single seconds
    hover: Load | None = None  # before anything was flown


@dataclass(slots=True)
class _Model:
    pack: PackModel
    points: Points
    estimate: StateEstimate | None = None
    square_error: float | None = None  # [V^2] of a cell, rolling
    updated_s: float = -math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelState:
    """What the app remembers of one model."""

    estimate: StateEstimate | None
    square_error: float | None
    updated_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictorState:
    """What the app remembers."""

    recent: RecentLoad
    airborne: bool
    sample: BatterySample | None
    below_since_s: float | None
    models: dict[Model, ModelState]


class PredictorApp:
    """Predicts for every model that has a fresh, valid estimate."""

    name = "predictor"
    hears = (Tick, BatterySample, StateEstimate, FlightPhase, PackChange)
    says = (EndOfDischarge, RemainingTime)
    keeps = PredictorState

    def __init__(self, packs: Mapping[Model, PackModel], settings: PredictorSettings) -> None:
        self._settings = settings
        self._models = {model: _Model(pack, _points(pack, settings)) for model, pack in packs.items()}
        self._recent = RecentLoad(window_s=settings.load_window_s)
        self._airborne = False
        self._sample: BatterySample | None = None
        self._below_since_s: float | None = None

    def state(self) -> PredictorState:
        return PredictorState(
            recent=self._recent,
            airborne=self._airborne,
            sample=self._sample,
            below_since_s=self._below_since_s,
            models={
                name: ModelState(estimate=m.estimate, square_error=m.square_error, updated_s=m.updated_s)
                for name, m in self._models.items()
            },
        )

    def restore(self, state: PredictorState) -> None:
        self._recent, self._airborne = state.recent, state.airborne
        self._sample, self._below_since_s = state.sample, state.below_since_s
        for name, kept in state.models.items():
            if name in self._models:
                model = self._models[name]
                model.estimate, model.square_error, model.updated_s = kept.estimate, kept.square_error, kept.updated_s

    def on_message(self, message: Message) -> Sequence[Message]:
        if isinstance(message, Tick):
            return self._predict(message.time_s)
        if isinstance(message, BatterySample):
            self._take_sample(message)
        elif isinstance(message, StateEstimate):
            self._take_estimate(message)
        elif isinstance(message, FlightPhase):
            self._airborne = message.airborne
        elif isinstance(message, PackChange):
            self._below_since_s = None
            for model in self._models.values():
                model.estimate = None
        return []

    def _take_sample(self, sample: BatterySample) -> None:
        before, self._sample = self._sample, sample
        volts, amps = sample.voltage_v, sample.current_a
        if not self._airborne or volts is None or amps is None:
            self._below_since_s = None
            return
        if before is not None:
            self._recent = self._recent.add(volts * amps, sample.time_s - before.time_s)
        if volts > self._settings.limits.cutoff_v:
            self._below_since_s = None
        elif self._below_since_s is None:
            self._below_since_s = sample.time_s

    def _take_estimate(self, estimate: StateEstimate) -> None:
        model = self._models[estimate.model]
        model.estimate = estimate
        if estimate.rejected is not None or estimate.voltage_expected_v is None or estimate.voltage_measured_v is None:
            return
        error = (estimate.voltage_measured_v - estimate.voltage_expected_v) / model.pack.series
        if model.square_error is None:
            model.square_error = error * error
        else:
            keep = math.exp(-max(estimate.time_s - model.updated_s, 0.0) / _ERROR_MEMORY_S)
            model.square_error = keep * model.square_error + (1.0 - keep) * error * error
        model.updated_s = estimate.time_s

    # ---- predicting ---------------------------------------------------------------------------------------------

    def _predict(self, now_s: float) -> list[Message]:
        load = self._recent.load() or self._settings.hover
        voices: list[Voice] = []
        said: list[Message] = []
        for model in self._models.values():
            estimate = model.estimate
            if estimate is None or not estimate.valid or now_s - estimate.time_s > _STALE_S:
                continue
            prediction = None if load is None else self._end_of_discharge(model, estimate, load, now_s)
            if prediction is not None:
                said.append(prediction)
            voices.append(
                Voice(estimate=estimate, prediction=prediction, error_v=math.sqrt(model.square_error or 1e-4))
            )
        at_cutoff = (
            self._below_since_s is not None
            and self._sample is not None
            and self._sample.time_s - self._below_since_s >= _AT_CUTOFF_S
        )
        said.append(fuse(now_s, voices, len(self._models), at_cutoff))
        return said

    def _end_of_discharge(
        self, model: _Model, estimate: StateEstimate, load: Load, now_s: float
    ) -> EndOfDischarge | None:
        belief = Belief(np.array(estimate.mean), np.array(estimate.covariance))
        power = self._power(load, model.points.load())
        temperature = None if self._sample is None else self._sample.temperature_k
        times, endings = end_of_discharge(
            model.pack, model.points.states(belief), power, self._settings.limits, temperature
        )
        if not np.all(np.isfinite(times)):
            return None
        outcomes = model.points.outcomes(times)
        low, median, high = np.quantile(outcomes, (0.05, 0.5, 0.95))
        ending = ENDINGS[int(np.bincount(endings, minlength=len(ENDINGS)).argmax())]
        if ending is Ending.HORIZON:
            return None
        return EndOfDischarge(
            time_s=now_s,
            model=estimate.model,
            median_s=float(median),
            low_s=float(low),
            high_s=float(high),
            ending=ending,
            power_w=load.mean_w,
            samples_s=tuple(outcomes.tolist()),
        )

    def _power(self, load: Load, draws: Array) -> Array:
        factor = {"1sigma": 1.0, "3sigma": 3.0}.get(self._settings.load_spread)
        spread = load.mean_sd_w if factor is None else factor * load.instant_sd_w
        return np.maximum(load.mean_w + spread * draws, 0.05 * load.mean_w)


def _points(pack: PackModel, settings: PredictorSettings) -> Points:
    if settings.over == "sigma-points":
        return SigmaPoints(pack.n_states)
    return Samples(settings.samples, pack.n_states, settings.seed)
