"""The battery as it is explained: the effects in its file, and what it changes for the time in the air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bhm_service.battery.battery_file import MODELS, BatteryFile, Joined
from bhm_service.battery.effects import Effect
from bhm_service.battery.pack import PackModel
from bhm_service.battery.parameters import parameters_of
from bhm_service.discrepancy.as_flown import as_flown
from bhm_service.discrepancy.candidate import Candidate
from bhm_service.discrepancy.explanation import Flying
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.joint import Joint
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.physical import physical
from bhm_service.discrepancy.quantities import teller
from bhm_service.prediction.end_of_discharge import Limits, end_of_discharge

RESERVE_SOC = 0.2
_CUTOFF_V = 3.2  # [V] of a cell


def repaired(battery: BatteryFile, fits: Sequence[Fitted], source: str) -> BatteryFile | None:
    """The battery with the members' effects joined; None where a file can hold none of them.

    ``fits`` has one of each cell model that the effects are to join: a model without them would go on as if nothing
    had been found, and the flying time is told by both. Each model has the sizes that the flights show with it; where
    one of them is at the end of what is physical that model does not follow the flights, and has those that are told.
    What differs from flight to flight stays out of the file: a start that is not full, times of a bad contact. The
    pack's own numbers are where the fits have them beside the effects.
    """
    joined = list(battery.joined)
    for fitted in fits:
        model = fitted.joint.lab.model
        for member in fitted.joint.members:
            by = fitted if physical(fitted, member) else teller(fits, member.id)
            for key, kind in member.parts:
                found = _joined(by, member, key, kind)
                if found is not None:
                    joined = [kept for j in joined for kept in _without(j, found.effect.id, fitted.joint.lab)]
                    joined.append(replace(found, model=model))
    if joined == list(battery.joined):
        return None
    mended = replace(battery, joined=tuple(joined), source=f"{battery.source}; {source}".lstrip("; "))
    return as_flown(mended, fits)


def _without(joined: Joined, name: str, lab: Lab) -> list[Joined]:
    """What stays of an entry where an effect of that name joins a model: all of it, its half for the other, nothing.

    What the fit had beside the effect stays: two pairs of slow diffusion are two. One effect alone carries a driver.
    """
    beside = joined.effect in lab.effects and not joined.effect.supplies
    if joined.effect.id != name or joined.model not in (None, lab.model) or beside:
        return [joined]
    return [replace(joined, model=other) for other in MODELS if joined.model is None and other != lab.model]


def _joined(fitted: Fitted, member: Candidate, key: str, kind: type[Effect]) -> Joined | None:
    values = fitted.joint.values(fitted.x[None, :])
    given: dict[str, float] = {}
    spread: dict[str, float] = {}
    for u in member.unknowns:
        if u.effect != key:
            continue
        if u.per_flight and u.declared.absent is not None:
            return None
        number, sd = values[u.name][0], fitted.sd(u.name)
        if u.log:
            sd = sd * number
        given[u.declared.name] = float(number.mean() * u.declared.scale)
        across = float(number.std()) if u.per_flight else 0.0
        spread[u.declared.name] = float(np.hypot(sd.mean(), across) * u.declared.scale)
    if kind.id == "intermittent-contact":
        return None
    last = {name.rsplit(".", 1)[1]: told[-1] for name, told in member.fixed.items() if name.startswith(f"{key}.")}
    return Joined(effect=kind(**given, **last), sd=spread)


def patched(battery: BatteryFile, error_v: float) -> BatteryFile:
    """The battery with its voltage trusted less: what nobody can name is no physics, and a filter must not be misled.

    ``error_v`` of a cell, lasting: the filters carry it as an error of the voltage, bounded by this.
    """
    known = battery.uncertainty
    trusted = replace(known, voltage_error_v=max(known.voltage_error_v, error_v))
    said = f"bhm explain: {1e3 * error_v:.0f} mV a cell that nothing in the catalogue explains"
    return replace(battery, uncertainty=trusted, source=f"{battery.source}; {said}".lstrip("; "))


def as_numbers(effect: Effect) -> Effect:
    """An effect of one column as one of plain numbers, as the predictor takes it."""
    names = [p.name for p in parameters_of(type(effect))]
    return replace(effect, **{n: float(np.ravel(getattr(effect, n))[0]) for n in names})  # type: ignore[type-var]


def flying(joint: Joint, fitted: Fitted, mended: BatteryFile | None = None) -> list[Flying]:
    """Time from the start of each flight to the reserve at its mean load, before and after: of ``mended``'s cell."""
    found = []
    lab = joint.lab
    cell = lab.cell if mended is None else mended.cell(lab.model)
    limits = Limits(threshold_soc=RESERVE_SOC, cutoff_v=_CUTOFF_V * lab.series)
    starts = joint.values(fitted.x[None, :])["start_soc"][0]
    for k, data in enumerate(joint.flights):
        power = np.nanmean((data.voltage_v * data.current_a)[data.airborne]) if data.airborne.any() else np.nan
        if not np.isfinite(power) or power <= 0.0:
            continue
        kelvin = None if data.temperature_k is None else float(data.temperature_k[0])
        times = []
        own = [as_numbers(e) for c in joint.members for e in c.effects(joint.values(fitted.x[None, :]), k)]
        soc = 1.0 if data.reading is None else data.reading
        for of, effects, start in ((lab.cell, (), soc), (cell, own, float(starts[k]))):
            pack = PackModel(of, lab.series, lab.parallel, [*lab.effects, *effects])
            states = np.array([[float(np.ravel(s)[0]) for s in pack.start(np.array(start))]])
            time_s, _ = end_of_discharge(pack, states, np.array([power]), limits, kelvin)
            times.append(float(time_s[0]))
        found.append(Flying(data.label, times[0], times[1]))
    return found
