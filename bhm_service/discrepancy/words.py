"""What was found, in words for a flight engineer: the verdict in a sentence, each effect's size, each region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.effects import EFFECTS
from bhm_service.discrepancy.bent_curve import BentCurve
from bhm_service.discrepancy.bent_lab import BentLab
from bhm_service.discrepancy.changed_lag import ChangedLag
from bhm_service.discrepancy.explanation import Course, Left
from bhm_service.discrepancy.findings import Findings, Region
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.flights import FlightData
from bhm_service.discrepancy.lab import Lab
from bhm_service.discrepancy.labels import flights_in_words
from bhm_service.discrepancy.patterns import Pattern
from bhm_service.discrepancy.recurring import Recurring
from bhm_service.discrepancy.sizes import Scene, size, volts, volts_between
from bhm_service.discrepancy.toll import Toll, tolls
from bhm_service.units import Value

_ADJUSTED = 0.5  # of the error of the battery as it is: what comes closer does so by adjusted numbers, and says so
_MOSTLY = 0.5  # of what an explanation gains: a reader who is not told would lay more than that on its effects
_LEAST_SHIFT = 0.01
_LEAST_V = 0.005  # a smaller change of the pack's voltage goes without saying
_MOST_OF = 0.5  # of the largest change: a flight with as much is named
_MOST_DIGITS = 9  # of odds that anybody reads
# Their size says it all: volts of the same thing again, or none of their own.
_NO_TOLL = {"voltage-gain", "voltage-offset", "intermittent-contact", "self-heating", "core-lag", "ocv-shape"}
_SENSOR = {"unseen-load", "current-gain", "current-offset", "partial-charge"}


@dataclass(frozen=True, slots=True)
class Variable:
    """What a misfit is laid over, as people call it."""

    title: str
    unit: str
    factor: float = 1.0
    digits: int = 0


VARIABLES = {
    "since_takeoff_s": Variable("time since take-off", "min", 1.0 / 60.0, 1),
    "soc": Variable("state of charge", "%", 100.0),
    "current_A": Variable("current", "A"),
    "current_slope_A_per_s": Variable("change of current", "A/s", digits=1),
    "temperature_C": Variable("pack temperature", "degC"),
    "altitude_m": Variable("altitude", "m"),
    "speed_mps": Variable("ground speed", "m/s", digits=1),
    "board_C": Variable("the autopilot's own temperature", "degC"),
    "cycles": Variable("charge cycles", ""),
    "storage_days": Variable("storage", "days"),
    "flight": Variable("flight", ""),
}


def sentence(
    findings: Findings,
    flights: int,
    moved: Mapping[str, float] | None = None,
    *,
    tuned_v: float | None = None,
    told: bool = False,
    left: str = "",
) -> str:
    """The verdict in one sentence; ``moved``: by which shares the lab's own numbers did, see `as_flown.moved_of`.

    ``tuned_v``: the error on unseen flights where these alone are adjusted. ``told``: the effects were given, not
    found. ``left``: what the explanation leaves, see `left_in_words`.
    """
    named = _titles([e.id for e in findings.effects])
    fit = _fit_clause(findings, tuned_v)
    verdict = findings.verdict
    if told:
        text = f"Measured as told, not found: {named}{fit}"
    elif verdict == "none":
        text = (
            f"Nothing is missing that these {flights} flights could show: the battery file explains their voltage "
            f"to {_millivolts(findings.fit.rmse_after_V)}{_adjusted_clause(findings, moved or {})}"
        )
    elif verdict == "parameter":
        how = named or _shifts(moved or {}) or "its numbers have moved"
        text = f"No physics is missing, but the pack is not as the battery file says: {how}{fit}"
    elif verdict == "named":
        text = f"The battery file leaves out physics: {named}{fit}"
    elif verdict == "ambiguous" and not findings.alternatives:
        text = f"The battery file leaves out physics, perhaps this: {named}; but drivers that cannot be the cause "
        text += f"fit as well{fit}"
    elif verdict == "ambiguous":
        others = [_titles(ids) for ids in findings.alternatives]
        shown = [t for t in (named, *others[:3]) if t]
        more = f", or {len(others) - 3} more" if len(others) > 3 else ""
        text = f"The battery file leaves out physics, but these flights cannot tell which: {', or '.join(shown)}{more}"
        text += fit
    elif verdict == "sensor-suspect":
        text = f"Suspect a sensor before the battery: {named}{fit}"
    elif verdict == "unknown":
        where = f"; {region_in_words(findings.localisation[0], ())}" if findings.localisation else ""
        seen, left = f": {left}" if left else "", ""
        text = (
            f"The flights disagree with the battery file, and no effect of the catalogue explains it{seen}{where}{fit}"
        )
    else:
        text = "Something may be missing, but these flights are too much alike to show it"
        text += f"; the nearest: {named}" if named else ""
    if findings.unexplained_rest > 0.0:
        text += f"; {100.0 * findings.unexplained_rest:.0f} % of the misfit stays unexplained"
    return f"{text}; {left}." if left else f"{text}."


def effect_in_words(
    effect_id: str, values: Mapping[str, Value], lab: Lab, flights: Sequence[FlightData], courses: Sequence[Course]
) -> str:
    """An effect's size in words, and what it did to the voltage at the load of these flights.

    ``values``: by parameter name in the declared units, one number or one for every flight; see `values_of`.
    """
    text = size(Scene(effect_id, values, lab, flights, courses))
    if effect_id not in _NO_TOLL:
        text += _toll_clause(effect_id, tolls(effect_id, values, lab, flights, courses))
    return text[0].upper() + text[1:] + "."


def values_of(fitted: Fitted, effect_id: str) -> dict[str, Value]:
    """What a fit found for one of its members, as `effect_in_words` takes it; episodes of a contact in rows."""
    found: dict[str, Value] = {}
    values = fitted.joint.unknowns.values(fitted.x)
    for member in (m for m in fitted.joint.members if effect_id in [kind.id for _, kind in m.parts]):
        keys = [key for key, kind in member.parts if kind.id == effect_id]
        rows: dict[str, list[Value]] = {}
        for key in keys:
            for u in (u for u in member.unknowns if u.effect == key):
                rows.setdefault(u.declared.name, []).append(values[u.name][0])
            # What the flights themselves gave; other drivers are in their notes.
            for name in ("begin", "end", "present"):
                if f"{key}.{name}" in member.fixed:
                    rows.setdefault(name, []).append(np.asarray(member.fixed[f"{key}.{name}"], dtype=float))
        found = {name: np.squeeze(np.stack(told)) for name, told in rows.items()}
    return found


def region_in_words(region: Region, every: Sequence[str]) -> str:
    """Where, on which flights and which way the model is off; ``every`` flight's label, none: not said."""
    parts = [_range_in_words(name, *between) for name, between in region.where.items() if name != "flight"]
    where = f" at {' and '.join(parts)}" if parts else ""
    on = f", on {flights_in_words(region.flights, every)}" if every and len(region.flights) < len(every) else ""
    way = "below" if region.sign < 0 else "above"
    return f"{100.0 * region.share_of_misfit:.0f} % of the misfit lies{where}{on}, measured {way} modelled"


def _range_in_words(name: str, low: float, high: float) -> str:
    known = VARIABLES.get(name)
    if known is None:
        return f"{name} {low:g} to {high:g}"
    ends = " to ".join(f"{known.factor * end:.{known.digits}f}" for end in (low, high))
    return f"{known.title} {ends} {known.unit}".rstrip()


def left_in_words(left: Left) -> str:
    """What is left, with its units: a description of these flights, bounded to what they saw."""
    if isinstance(left, Recurring):
        return f"what is left comes back every {left.period_s:.0f} s, and nothing that was recorded does"
    if isinstance(left, ChangedLag):
        way = "later" if left.change > 0.0 else "sooner"
        return f"from {left.flight} on the voltage follows the load {way} than before, as through another filter"
    if isinstance(left, BentCurve):
        way = "above" if left.cell_v > 0.0 else "below"
        off = "more than a lab is off by"
        if left.narrow:
            off = "no lab is off by as much within some percent of charge only"
        return (
            f"the resting voltage of a cell is {1e3 * abs(left.cell_v):.0f} mV {way} the lab's at {left.soc:.0%} of "
            f"charge, on all flights: {off}"
        )
    if isinstance(left, BentLab):
        odds = 10 ** int(min(left.nats / np.log(10.0), _MOST_DIGITS))
        return (
            "the pack's resistance, capacity, curve and starting charges would all have to be off at once, by more "
            f"than a lab is (odds below one in {odds:,})".replace(",000", " 000")
        )
    return _pattern_in_words(left)


def left_advice(left: Left) -> str:
    """What to do about what is left."""
    if isinstance(left, BentLab):
        return "Identify the pack again on a bench: what its lab recordings say of it does not hold in flight."
    return f"Look for a cause that goes with it: {left_in_words(left)}."


def _pattern_in_words(pattern: Pattern) -> str:
    known = VARIABLES.get(pattern.variable, Variable(pattern.variable, ""))
    unit = "mV" if pattern.kind == "voltage" else "mOhm"
    ends = sorted((int(np.argmin(pattern.heights)), int(np.argmax(pattern.heights))))
    told = [
        f"{1e3 * pattern.heights[k]:+.0f} +- {1e3 * pattern.sd[k]:.0f} {unit} at "
        + f"{known.factor * pattern.knots[k]:.{known.digits}f} {known.unit}".rstrip()
        for k in ends
    ]
    return f"what is left looks like a {pattern.kind} of the pack that follows {known.title}, {' and '.join(told)}"


def _titles(ids: Sequence[str]) -> str:
    """What effects say, joined: ``resistance follows temperature and the pack heats itself``."""
    titles = [EFFECTS[name].title if name in EFFECTS else name for name in ids]
    return " and ".join(t[0].lower() + t[1:] for t in titles)


def _shifts(moved: Mapping[str, float]) -> str:
    told = [
        f"its {name} is {100.0 * abs(share):.0f} % {'higher' if share > 0.0 else 'lower'}"
        for name, share in moved.items()
        if abs(share) >= _LEAST_SHIFT
    ]
    return " and ".join(told)


def _adjusted_clause(findings: Findings, moved: Mapping[str, float]) -> str:
    """What a battery that needs no effect needs all the same: its own numbers, within what its lab leaves open."""
    before, after = findings.fit.rmse_before_V, findings.fit.rmse_after_V
    if after > _ADJUSTED * before:
        return ""
    shifts = _shifts(moved)
    which = f" ({shifts})" if shifts else ""
    return (
        f" once its numbers are adjusted within what a lab leaves open{which}; as it stands, to {_millivolts(before)}"
    )


def _fit_clause(findings: Findings, tuned_v: float | None = None) -> str:
    fit = findings.fit
    before, after, where = fit.heldout_before_V, fit.heldout_after_V, "on flights that no fit saw"
    if before is None or after is None:
        before, after, where = fit.rmse_before_V, fit.rmse_after_V, "on the flights themselves"
    alone = "with the file's own numbers adjusted and no effect"
    if after >= 0.995 * before:
        if tuned_v is not None and tuned_v < _ADJUSTED * before:
            return f"; {where} the voltage error falls from {_millivolts(before)} to {_millivolts(tuned_v)} {alone}"
        return f"; {where} the voltage error stays what it was, {_millivolts(after)}"
    text = f"; {where} the voltage error falls from {_millivolts(before)} to {_millivolts(after)}"
    if tuned_v is not None and before - tuned_v > _MOSTLY * (before - after):
        text += f" ({_millivolts(tuned_v)} {alone})"
    return text


def _millivolts(value: float) -> str:
    return f"{1e3 * value:.0f} mV"


def _toll_clause(effect_id: str, paid: Sequence[Toll]) -> str:
    """What it cost where it cost most: at take-off, towards landing or all along, and on which flights."""
    if effect_id == "time-skew":
        most = max(abs(t.most_v) for t in paid)
        return f"; at throttle steps this is up to {volts(most)}" if most >= _LEAST_V else ""
    ends = {"at take-off": [t.takeoff_v for t in paid], "towards landing": [t.landing_v for t in paid]}
    when, largest = max(((name, max(v, key=abs)) for name, v in ends.items()), key=lambda found: abs(found[1]))
    if abs(largest) < _LEAST_V:
        return ""
    struck = [k for k, cost in enumerate(ends[when]) if cost / largest >= _MOST_OF]
    told = [ends[when][k] for k in struck]
    other = [ends[name][k] for name in ends if name != when for k in struck]
    if min(cost / largest for cost in other) >= _MOST_OF:
        when, told = "from take-off to landing", told + other
    size_v = volts_between(min(map(abs, told)), max(map(abs, told)))
    on = flights_in_words([paid[k].label for k in struck], [t.label for t in paid])
    if effect_id in _SENSOR:
        return f"; the true voltage is {size_v} {'below' if largest > 0.0 else 'above'} the modelled {when} on {on}"
    return f"; this {'cost' if largest > 0.0 else 'gave'} {size_v} {when} on {on}"
