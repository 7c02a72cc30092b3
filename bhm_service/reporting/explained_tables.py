"""An explanation as rows of text; the page and the terminal show the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bhm_service.battery.effects import EFFECTS
from bhm_service.battery.parameters import Parameter
from bhm_service.discrepancy.confirm import LeftOutFlight
from bhm_service.discrepancy.explanation import Explanation
from bhm_service.discrepancy.findings import EffectFound, Quantity
from bhm_service.discrepancy.labels import flight_name
from bhm_service.discrepancy.odds import NEAR, Names
from bhm_service.discrepancy.words import region_in_words
from bhm_service.reporting.words import duration
from bhm_service.units import ZERO_CELSIUS_K

PARAMETER_HEADER = ("", "value", "meaning")
RIVAL_HEADER = ("instead", "evidence against the chosen", "so", "what would separate them")
DECOY_HEADER = ("phantom driver", "the true one is ahead by", "")
FLIGHT_HEADER = ("flight", "battery file", "its numbers adjusted", "explanation")
FLYING_HEADER = ("flight", "battery file", "explanation", "change")
_MOST_RIVALS = 8
_CERTAIN_NATS = 15.0  # a million to one and more reads as ruled out, not as odds
_NO_LIMIT_K = 200.0  # a kelvin number that cannot be below is a temperature, not a difference


@dataclass(frozen=True, slots=True)
class EffectBlock:
    """One effect as the reader meets it."""

    title: str
    id: str
    equation: str
    source: str
    words: str
    parameters: list[tuple[str, ...]]  # under `PARAMETER_HEADER`
    grounds: list[str]  # why it is believed


def effects(e: Explanation) -> list[EffectBlock]:
    """What was found, the largest first."""
    words = [*e.in_words, *[""] * len(e.findings.effects)]
    return [_effect(e, found, text) for found, text in zip(e.findings.effects, words, strict=False)]


def _effect(e: Explanation, found: EffectFound, words: str) -> EffectBlock:
    kind = EFFECTS[found.id]
    asked_for = e.search.needed(found.id, e.selection.names)
    # The commoner of two that the flights hardly tell apart comes first, by less than the likelier has.
    close = found.evidence_nats < asked_for and e.findings.alternatives
    grounds = [
        f"Evidence: {_nats(found.evidence_nats)} beyond the best explanation without it; "
        f"{asked_for:.0f} are asked for{', which one of its alternatives has' if close else ''}.",
        f"{100.0 * found.share_of_misfit:.0f} % of the squared voltage error goes with it.",
        f"Chance that noise alone makes any effect of the catalogue look as good: {_chance(found.p_familywise)}.",
    ]
    if beside := e.search.credit(frozenset({found.id})):
        grounds.append(f"Of its evidence {_nats(beside)} are of the voltages of single cells.")
    if found.decoys_beaten is not None:
        beaten = sum(c.beaten for c in e.contests)
        grounds.append(f"It beats {beaten} of {len(e.contests)} phantom drivers, see below.")
    return EffectBlock(
        kind.title, found.id, kind.equation, kind.source, words,
        [_parameter(found.id, key, told) for key, told in found.parameters.items()], grounds,
    )  # fmt: skip


def _chance(p: float) -> str:
    return f"{100.0 * p:.1f} % or less" if p < 0.01 else f"{100.0 * p:.0f} %"


def _parameter(effect_id: str, key: str, told: Quantity) -> tuple[str, ...]:
    declared, of = declaration(effect_id, key)
    value, unit = told.value, told.unit
    if unit == "K" and declared is not None and declared.low > _NO_LIMIT_K:
        value, unit = value - ZERO_CELSIUS_K, "degC"
    number = f"{with_sd(value, told.sd)} {'' if unit == '1' else unit}".rstrip()
    if declared is None:
        return key, number, ""
    on = f" (flight {flight_name(of)})" if of else ""
    return declared.symbol, number, declared.meaning + on


def declaration(effect_id: str, key: str) -> tuple[Parameter | None, str]:
    """What the catalogue says of a key of the findings (``d[00.tlog]``, ``self-heating.C``), and its flight."""
    name, _, of = key.removesuffix("]").partition("[")
    owner, _, own = name.rpartition(".")
    kind = EFFECTS.get((owner or effect_id).partition("#")[0], EFFECTS[effect_id])
    return next((p for p in kind.parameters() if p.name == own), None), of


def with_sd(value: float, sd: float) -> str:
    """A number to the digits that its standard deviation leaves: ``28.9 ± 1.2``."""
    if not sd > 0.0:
        return f"{value:.4g}"
    digits = int(np.clip(1 - np.floor(np.log10(sd)), 0, 8))
    return f"{value:.{digits}f} ± {sd:.{digits}f}"


def title(names: Names | Sequence[str]) -> str:
    """A set of effects as people read it."""
    return " + ".join(EFFECTS[n].title if n in EFFECTS else n for n in sorted(names)) or "nothing missing"


def regions(e: Explanation) -> list[str]:
    """Where the battery file is off, in words."""
    every = [c.flight.label for c in e.courses]
    return [f"{text[0].upper()}{text[1:]}." for text in (region_in_words(r, every) for r in e.findings.localisation)]


def rivals(e: Explanation) -> list[tuple[str, ...]]:
    """Rows under `RIVAL_HEADER`: what else it could have been, the hardest to tell apart first."""
    chosen = e.selection.names
    same = [frozenset(ids) for ids in e.findings.alternatives]
    own = _evidence(e, chosen) or 0.0
    tried = [names for names in e.search.fits if names and not names >= chosen] if chosen else _singles(e)
    close = [n for n in tried if n not in same and (len(n) == 1 or len(n) == len(chosen) == len(n & chosen) + 1)]
    close.sort(key=lambda names: -(_evidence(e, names) or 0.0))
    rows = [_rival(e, names, own, equal=True) for names in same]
    return (rows + [_rival(e, names, own, equal=False) for names in close])[:_MOST_RIVALS]


def _singles(e: Explanation) -> list[Names]:
    return [names for names in e.search.fits if len(names) == 1]


def _evidence(e: Explanation, names: Names) -> float | None:
    return e.search.evidence(names) if names in e.search.fits else None


def _rival(e: Explanation, names: Names, own: float, *, equal: bool) -> tuple[str, ...]:
    evidence = _evidence(e, names)
    behind = None if evidence is None else own - evidence
    shown = "-" if behind is None else f"{_nats(behind)}{' ahead' if behind < 0.0 else ''}"
    return title(names), shown, _standing(e, names, behind, equal=equal), _manoeuvre(e.selection.names, names)


def _standing(e: Explanation, names: Names, behind: float | None, *, equal: bool) -> str:
    if equal:
        return "cannot be told apart"
    if behind is None:
        return "-"
    if not e.selection.names:
        return f"not shown: {max(e.search.needed(name, names) for name in names):.0f} nats ahead are asked for"
    if behind < NEAR:
        return "refused: a part of it is too small, earns too little, or is beyond what is physical"
    return "ruled out" if behind > _CERTAIN_NATS else f"unlikely, 1 to {np.exp(behind):.0f}"


def _manoeuvre(chosen: Names, rival: Names) -> str:
    """The catalogue's manoeuvre that tells the two apart."""
    pairs = [(a, b) for a in sorted(chosen - rival) for b in sorted(rival - chosen) if b in EFFECTS[a].mimics]
    own = [a for a, _ in pairs] or sorted(rival - chosen) or sorted(chosen - rival)
    return EFFECTS[own[0]].manoeuvre if own and own[0] in EFFECTS else ""


def _nats(value: float) -> str:
    return f"{abs(value):.0f} nats" if abs(value) >= 10.0 else f"{abs(value):.1f} nats"


def decoys(e: Explanation) -> list[tuple[str, ...]]:
    """Rows under `DECOY_HEADER`."""
    return [
        (c.decoy, f"{c.nats:+.0f} nats", "beaten" if c.beaten else "explains the flights as well") for c in e.contests
    ]


def worst(e: Explanation) -> list[tuple[str, LeftOutFlight]]:
    """The held-out flights that the battery file and the explanation predict worst, each with who does; may be one."""
    if e.held_out is None:
        return []
    before = max(e.held_out.flights, key=lambda f: f.rmse(f.before_v))
    after = max(e.held_out.flights, key=lambda f: f.rmse(f.after_v))
    if before.label == after.label:
        return [("the battery file and the explanation predict", before)]
    return [("the battery file predicts", before), ("the explanation predicts", after)]


def held_out(e: Explanation) -> list[tuple[str, ...]]:
    """Rows under `FLIGHT_HEADER`: errors on the part of each flight that no fit saw."""
    if e.held_out is None:
        return []
    return [
        (flight_name(f.label), *(_millivolts(f.rmse(v)) for v in (f.before_v, f.tuned_v, f.after_v)))
        for f in e.held_out.flights
    ]


def fit_header(e: Explanation) -> tuple[str, ...]:
    """Over the columns of `fit`: without an effect, flights are followed by what the lab leaves open at best."""
    return "voltage error (RMSE)", "battery file", "explanation" if e.findings.effects else "its numbers adjusted"


def fit(e: Explanation) -> list[tuple[str, ...]]:
    """Rows under `fit_header`."""
    f = e.findings.fit
    rows = [("on the flights of the fit", _millivolts(f.rmse_before_V), _millivolts(f.rmse_after_V))]
    before, after = f.heldout_before_V, f.heldout_after_V
    if not e.findings.effects and e.held_out is not None:
        after = e.held_out.tuned_v
    if before is not None and after is not None:
        rows.append(("on flights that no fit saw", _millivolts(before), _millivolts(after)))
    return [*rows, ("noise of the recordings", "", _millivolts(f.noise_floor_V))]


def flying(e: Explanation) -> list[tuple[str, ...]]:
    """Rows under `FLYING_HEADER`: time to the reserve at each flight's mean load."""
    return [
        (flight_name(f.flight), duration(f.before_s), duration(f.after_s), _change(f.after_s - f.before_s))
        for f in e.flying
    ]


def flying_in_words(e: Explanation) -> str:
    """What the explanation changes for the pilot, in a sentence; empty where it changes nothing."""
    changes = [(f.after_s - f.before_s, flight_name(f.flight)) for f in e.flying]
    moved = e.findings.effects or e.findings.verdict == "parameter"
    if not moved or not changes or max(abs(c) for c, _ in changes) < 1.0:
        return ""
    largest, label = max(changes, key=lambda found: abs(found[0]))
    way = "more" if largest < 0.0 else "less"
    span = duration(abs(largest))
    return f"The battery file promises up to {span} min {way} flying time than there is (flight {label})."


def _change(seconds: float) -> str:
    return f"{'-' if seconds < 0.0 else '+'}{duration(abs(seconds))}"


def change_points(e: Explanation) -> list[tuple[str, str]]:
    """Flight and time of every step."""
    return [(flight_name(c.flight), duration(c.time_s)) for c in e.findings.change_points]


def not_shown(e: Explanation) -> list[tuple[str, str, str]]:
    """Effects that the recordings cannot show: what, why, and what would."""
    return [
        (EFFECTS[n.id].title, n.because, "" if n.because.endswith("is recorded") else EFFECTS[n.id].excited_by)
        for n in e.not_excited
    ]


def _millivolts(value: float) -> str:
    return f"{1e3 * value:.0f} mV" if np.isfinite(value) else "-"
