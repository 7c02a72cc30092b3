"""An identified pack as rows of text; the terminal and the page show the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bhm_service.battery.battery_file import ModelName
from bhm_service.battery.parameters import Parameter, parameters_of
from bhm_service.identification.assess import Assessment, Error, step_resistance
from bhm_service.identification.extras import PARTS, Extras
from bhm_service.identification.identify import Identified, ModelResult
from bhm_service.units import SECONDS_PER_HOUR, Value

QUALITY_HEADER = ("recording", "", "model", "RMSE", "bias", "best possible")
PARAMETER_HEADER = ("", "value", "± sd", "unit", "sd, covariance", "sd, bootstrap", "meaning")
_FACTOR = 0.5  # of a logarithm: a wider spread is told as a factor
_BEYOND = 10.0  # times its own size: a wider spread is told as more than that
_NOT_TOLD = "not told"
_CAPACITY = "capacity"  # the block, where flights tell the capacity; c_max and q_max follow it


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One number of a model."""

    cells: tuple[str, ...]  # under `PARAMETER_HEADER`
    told: bool  # the recordings say something of it


@dataclass(frozen=True, slots=True)
class SplitTable:
    """Errors of one model: a row per recording, a column per part of it; None where a recording has none."""

    model: ModelName
    header: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Error | None, ...]], ...]


def headline(identified: Identified) -> list[str]:
    """One sentence per model: how good, and how much of that is the model's structure."""
    return [_headline(result) for result in identified.results]


def _headline(result: ModelResult) -> str:
    fitted = [a.whole.rmse for a in result.assessments if not a.held_out and a.whole.samples]
    held = [a for a in result.assessments if a.held_out and a.whole.samples]
    said = [f"{_span(fitted)} mV on the recordings of the fit"] if fitted else []
    if held:
        worst = max(held, key=lambda a: a.whole.rmse)
        best = "" if worst.oracle is None else f" (a fit to it alone reaches {_millivolt(worst.oracle.rmse)} mV)"
        said.append(f"at most {_millivolt(worst.whole.rmse)} mV on what was held out{best}")
    if np.isfinite(result.unseen_v):
        said.append(f"{_millivolt(result.unseen_v)} mV on pieces that no fit saw")
    if np.isfinite(result.flying_v):
        said.append(f"{_millivolt(result.flying_v)} mV on a varying load that the other recordings foretell")
    return f"{result.model}: {'; '.join(said)}"


def subtitle(identified: Identified) -> str:
    """The pack in a line."""
    battery = identified.battery
    amp_hours = float(np.asarray(identified.results[0].cell.capacity_c)) / SECONDS_PER_HOUR
    series = f"{battery.series} cells in series" if battery.series and battery.series > 1 else "one cell"
    return f"{series}, {amp_hours:.4g} Ah; all voltages and errors are of one cell"


def quality(identified: Identified) -> list[tuple[str, ...]]:
    """Rows under `QUALITY_HEADER`: every recording, every model."""
    found: list[tuple[str, ...]] = []
    for group in recordings(identified):
        for number, (model, a) in enumerate(group):
            found.append(
                (
                    a.label if number == 0 else "",
                    ("held out" if a.held_out else "fitted") if number == 0 else "",
                    model,
                    f"{_millivolt(a.whole.rmse)} mV",
                    f"{_millivolt(a.whole.bias, sign=True)} mV",
                    "" if a.oracle is None else f"{_millivolt(a.oracle.rmse)} mV",
                )
            )
    return found


def recordings(identified: Identified) -> list[list[tuple[ModelName, Assessment]]]:
    """Every recording with the models that were judged on it; a model may have left one out."""
    found: dict[str, list[tuple[ModelName, Assessment]]] = {}
    for result in identified.results:
        for a in result.assessments:
            found.setdefault(a.label, []).append((result.model, a))
    return list(found.values())


def splits(identified: Identified) -> list[SplitTable]:
    """Where each model's error lies: by state of charge, by current, at rest and under load."""
    return [_split(result) for result in identified.results]


def _split(result: ModelResult) -> SplitTable:
    names = [name for name, _ in _parts(result.assessments[0])]
    rows = [
        (a.label + (" *" if a.held_out else ""), tuple(e if e.samples else None for _, e in _parts(a)))
        for a in result.assessments
    ]
    return SplitTable(result.model, tuple(names), tuple(rows))


def _parts(assessment: Assessment) -> list[tuple[str, Error]]:
    soc = [(name.removeprefix("SoC ").replace("%-", "-").replace("%", " %"), e) for name, e in assessment.by_soc]
    return [*soc, *assessment.by_current]


def parameters(result: ModelResult) -> list[ParameterRow]:
    """Rows under `PARAMETER_HEADER`: every number of the cell and of its effects."""
    blocks = [b.name for b in result.solution.problem.unknowns.blocks]
    rows = []
    for declared in parameters_of(type(result.cell)):
        follows = declared.name in ("c_max", "q_max") and _CAPACITY in blocks
        rows.append(
            _row(result, declared, getattr(result.cell, declared.name), _CAPACITY if follows else declared.name)
        )
    rows += [_row(result, declared, value, block) for _, declared, value, block in _of_effects(result)]
    shown = {p.name for p in parameters_of(type(result.cell))} | {_CAPACITY, *Extras.names}
    for scale in result.solution.problem.unknowns.blocks:
        if scale.log and scale.size == 1 and scale.name not in shown:
            declared = Parameter(scale.name, scale.name, "1", 0.0, np.inf, "times that of the known cell")
            rows.append(_row(result, declared, float(result.solution.values[scale.name][0, 0]), scale.name))
    return rows


def _of_effects(result: ModelResult) -> Iterator[tuple[str, Parameter, Value, str]]:
    """The numbers of the effects that joined: whose, which, how large, and the block of the fit that each was."""
    for k, joined in enumerate(result.joined):
        earlier = sum(j.effect.id == joined.effect.id for j in result.joined[:k])
        for declared in parameters_of(type(joined.effect)):
            one_each = [
                p.unknowns[declared.name]
                for p in PARTS
                if p.effect is type(joined.effect) and declared.name in p.unknowns
            ]
            block = one_each[earlier] if earlier < len(one_each) else declared.name
            whose = f"the second {joined.effect.id}" if earlier else joined.effect.id
            yield whose, declared, getattr(joined.effect, declared.name), block


def _row(result: ModelResult, declared: Parameter, in_si: Value, block_name: str) -> ParameterRow:
    value = float(np.asarray(in_si)) / declared.scale
    unknowns = result.solution.problem.unknowns
    block = next((b for b in unknowns.blocks if b.name == block_name and b.size == 1), None)
    if block is None:
        return ParameterRow(
            (declared.symbol, f"{value:.4g}", "held", declared.unit, "", "", declared.meaning), told=True
        )
    k = unknowns.slice_of(block_name).start
    # Of a number's own size; an effect's may be looked for in another unit than the file's.
    inner = abs(float(block.outer(result.solution.x[k])))
    own = 1.0 if block.log else 1.0 / max(inner, 1e-300)
    by_covariance = float(np.sqrt(result.spread.covariance[k, k])) * own
    by_bootstrap = float(result.spread.bootstrap_sd[k]) * own
    larger = result.spread.sd(k) * own
    told = block_name not in result.not_told
    return ParameterRow(
        (
            declared.symbol,
            f"{value:.4g}",
            (_reach(larger, block.log) or f"{larger * abs(value):.2g}") if told else _NOT_TOLD,
            declared.unit,
            _reach(by_covariance, block.log) or _share(by_covariance),
            _reach(by_bootstrap, block.log) or _share(by_bootstrap),
            declared.meaning,
        ),
        told,
    )


def _reach(spread: float, log: bool) -> str | None:
    """A spread too wide for plus and minus, as a factor."""
    if not log or spread <= _FACTOR:
        return None
    return f"x/÷ {np.exp(spread):.1f}" if spread < 4.0 else "any size"


def _share(spread: float) -> str:
    """A spread of a number's own size; of one that is next to nothing it says no more than that."""
    return f"{spread:.1%}" if spread < _BEYOND else f"> {_BEYOND:.0%}"


def open_questions(result: ModelResult) -> list[str]:
    """What the recordings leave open of a model."""
    names = {p.name: p.symbol for p in parameters_of(type(result.cell))}
    names |= {block: f"{declared.symbol} of {whose}" for whose, declared, _, block in _of_effects(result)}
    found = []
    if result.not_told:
        listed = ", ".join(names.get(n, n) for n in result.not_told)
        found.append(f"not told by these recordings, so left near what was assumed: {listed}")
    found += [
        f"{names.get(a, a)} and {names.get(b, b)} are not told apart: only their combination is "
        f"(correlation {share:+.2f})"
        for a, b, share in result.spread.alike
    ]
    return found


def resistance(identified: Identified) -> list[str]:
    """The resistance at load steps beside each model's own at the same steps."""
    if identified.step_ohm is None:
        return ["no step of the current: nothing to check the resistance against"]
    median, spread, count = identified.step_ohm
    found = [f"measured at {count} steps of the current: {_milliohm(median)} ± {_milliohm(spread)} mOhm a cell"]
    for result in identified.results:
        fitted = [a for a in result.assessments if not a.held_out]
        seen = step_resistance([a.experiment for a in fitted])
        own = step_resistance([replace(a.experiment, voltage_v=a.modelled_v) for a in fitted])
        if seen is not None and own is not None:
            found.append(
                f"{result.model} at the steps of the fit: {_milliohm(own[0])} mOhm, measured there "
                f"{_milliohm(seen[0])} mOhm ({own[0] / seen[0] - 1.0:+.0%})"
            )
    return found


def _span(errors: Sequence[float]) -> str:
    low, high = _millivolt(min(errors)), _millivolt(max(errors))
    return low if low == high else f"{low}-{high}"


def _millivolt(volts: float, *, sign: bool = False) -> str:
    if not np.isfinite(volts):
        return "-"
    return f"{1e3 * volts:+.1f}" if sign else f"{1e3 * volts:.1f}"


def error_text(error: Error | None) -> str:
    """An error's RMSE in millivolt; a dash where there is nothing."""
    return "-" if error is None else _millivolt(error.rmse)


def _milliohm(ohm: float) -> str:
    return f"{1e3 * ohm:.3g}"
