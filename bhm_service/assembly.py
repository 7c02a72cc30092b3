"""The whole wiring on one page: which apps there are, what each is given, in which order they are served."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bhm_service.apps.duel import DuelApp
from bhm_service.apps.estimator import EstimatorApp
from bhm_service.apps.housekeeping import HousekeepingApp
from bhm_service.apps.limits import LimitsApp, Reserves
from bhm_service.apps.predictor import PredictorApp, PredictorSettings
from bhm_service.apps.publisher import PublisherApp
from bhm_service.apps.reader import ReaderApp
from bhm_service.battery.battery_file import BatteryFile
from bhm_service.bus import App, Bus, Counters
from bhm_service.config import Service, Vehicle
from bhm_service.errors import BadInputError
from bhm_service.estimation.tracker import Tracker
from bhm_service.executive import Supervised
from bhm_service.messages import Model, Standing
from bhm_service.prediction.demand import Load, hover_power
from bhm_service.prediction.end_of_discharge import Limits
from bhm_service.telemetry import default_airborne_a, resting_a
from bhm_service.units import SECONDS_PER_HOUR, coulombs

_HOVER_SPREAD = 0.2  # of a load that momentum theory says, before anything was flown


@dataclass(frozen=True, slots=True, kw_only=True)
class Equipment:
    """A vehicle with its battery: all that the wiring needs to know."""

    vehicle: Vehicle
    battery: BatteryFile
    battery_text: str = ""  # the battery file as it was read
    shadow: Equipment | None = None  # the same with another battery file, which flies in the shadow of this one

    @property
    def series(self) -> int:
        """Cells in series; BadInputError when neither file says, and when they contradict each other."""
        ours, own = self.vehicle.battery.series, self.battery.series
        series = own if self._is_its_pack else ours
        if series is None:
            raise BadInputError(
                self.vehicle.name,
                "battery.series is missing, and the battery file is of a single cell: how many are in series?",
            )
        if own not in (None, 1, series):
            raise BadInputError(
                self.battery.name, f"is a pack of {own} cells, and {self.vehicle.name} has {series} in series",
                "another battery file, or take series out of this one if the pack is built from such cells",
            )  # fmt: skip
        return series

    @property
    def capacity_c(self) -> float:
        """Charge of the pack. [C]"""
        if self._label_ah is not None:
            return coulombs(self._label_ah)
        return self._own_c

    @property
    def remarks(self) -> tuple[str, ...]:
        """What of the vehicle's file is not used, and why."""
        label, own = self.vehicle.battery.capacity_ah, self._own_c / SECONDS_PER_HOUR
        if label is None or not self._is_its_pack or f"{label:.3g}" == f"{own:.3g}":
            return ()
        return (f"capacity_ah = {label:.3g} of the vehicle is not used: {self.battery.name} is a pack of {own:.3g} Ah",)

    @property
    def _is_its_pack(self) -> bool:
        """Whether the battery file is of the pack on board, and not of a cell that it may be built from.

        A pack that was identified has its own capacity, and how well that is known: a label says neither. One cell on
        a bench is a pack of one to its file, and a cell to a vehicle that has more of them.
        """
        own = self.battery.series
        return own is not None and self.vehicle.battery.series in (None, own)

    @property
    def _label_ah(self) -> float | None:
        """Capacity that the vehicle's file gives to a cell that any pack may be built from. [Ah]"""
        return None if self._is_its_pack else self.vehicle.battery.capacity_ah

    @property
    def _own_c(self) -> float:
        cell = self.battery.circ or self.battery.chem
        assert cell is not None
        return float(np.asarray(cell.capacity_c))

    def fingerprint(self, service: Service) -> str:
        """Of everything that a belief rests on: with another one it means something else."""
        pack = self.vehicle.battery.model_dump_json(exclude={"file"})
        models = ",".join(estimator.model for estimator in service.estimators)
        text = self.battery_text or repr(self.battery)
        if self.shadow is not None:
            text += self.shadow.battery_text
        return hashlib.sha256(f"{pack}\n{models}\n{text}".encode()).hexdigest()

    def tracker(self, model: Model) -> Tracker:
        """A filter for this pack."""
        cell = self.battery.cell(model.value)
        uncertainty, parallel = self.battery.uncertainty, 1.0
        if self._label_ah is not None:
            uncertainty = replace(uncertainty, capacity=self.vehicle.battery.capacity_sd)
            parallel = self.capacity_c / float(np.asarray(cell.capacity_c))
        return Tracker(model, cell, self.series, parallel, self.battery.effects(model.value), uncertainty)

    def hover(self) -> Load | None:
        """Load in the hover by momentum theory, where the vehicle file gives the rotors."""
        rotors = self.vehicle.rotors
        if rotors is None:
            return None
        power = hover_power(rotors.mass_kg, rotors.rotors, rotors.rotor_radius_m, rotors.efficiency, rotors.avionics_w)
        return Load(mean_w=power, mean_sd_w=_HOVER_SPREAD * power, instant_sd_w=_HOVER_SPREAD * power)


def assemble(
    equipment: Equipment,
    service: Service,
    sinks: Iterable[App] = (),
    stopwatch: Callable[[], float] | None = None,
    standing: Standing | None = None,
) -> Bus:
    """The bus of the service; ``sinks`` hear what they like of it (the wire, a log, a screen)."""
    counters: dict[str, Counters] = {}
    makers = _chain(equipment, service)
    if equipment.shadow is not None:
        makers = [_duel(equipment, equipment.shadow, service, counters, standing or Standing(time_s=0.0))]
    makers += [lambda: HousekeepingApp(counters), *(partial(_given, sink) for sink in sinks)]
    return _bus(makers, counters, stopwatch)


def _chain(equipment: Equipment, service: Service) -> list[Callable[[], App]]:
    """From the autopilot's messages to what the ground is told."""
    settings, capacity_a = equipment.vehicle.battery, equipment.capacity_c / SECONDS_PER_HOUR
    trackers = {Model(e.model): equipment.tracker(Model(e.model)) for e in service.estimators}
    return [
        lambda: ReaderApp(  # autopilot -> BatterySample, FlightPhase, PackChange
            settings.id,
            equipment.series,
            rest_a=resting_a(capacity_a),
            airborne_a=equipment.vehicle.airborne_a or default_airborne_a(capacity_a),
        ),
        *(partial(EstimatorApp, tracker) for tracker in trackers.values()),  # BatterySample -> StateEstimate
        lambda: PredictorApp(  # StateEstimate -> EndOfDischarge, RemainingTime
            {model: tracker.pack for model, tracker in trackers.items()},
            PredictorSettings(
                limits=Limits(threshold_soc=settings.threshold_soc, cutoff_v=settings.cutoff_v * equipment.series),
                over=service.prediction.over,
                samples=service.prediction.samples,
                seed=service.prediction.seed,
                load_window_s=service.prediction.load_window_s,
                load_spread=service.prediction.load_spread,
                hover=equipment.hover(),
            ),
        ),
        PublisherApp,  # estimates, predictions -> NamedValue
        lambda: LimitsApp(  # predictions -> StatusText
            Reserves(
                warning_s=service.reserves.warning_s,
                critical_s=service.reserves.critical_s,
                landing_soc=service.reserves.landing_soc,
            )
        ),
    ]


def _duel(
    equipment: Equipment, shadow: Equipment, service: Service, counters: dict[str, Counters], standing: Standing
) -> Callable[[], App]:
    """Two chains on buses of their own, whose apps are counted under their side's name."""

    def side(name: str, carried: Equipment) -> Bus:
        own: dict[str, Counters] = {}
        bus = _bus(_chain(carried, service), own)
        counters.update({f"{name} {app}": counted for app, counted in own.items()})
        return bus

    return lambda: DuelApp(lambda: side("old", equipment), lambda: side("new", shadow), standing)


def _bus(
    makers: Iterable[Callable[[], App]],
    counters: dict[str, Counters],
    stopwatch: Callable[[], float] | None = None,
) -> Bus:
    return Bus([_supervised(make, counters) for make in makers], counters, stopwatch)


def _given(sink: App) -> App:
    return sink


def _supervised(make: Callable[[], App], counters: dict[str, Counters]) -> App:
    mine = Counters()
    app = Supervised(make, mine)
    counters[app.name] = mine
    return app
