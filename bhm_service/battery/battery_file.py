"""The battery's TOML file: the cells' parameters and the effects, each number with its unit, spread and source.

A number may be written bare or as ``{ value = .., sd = .., unit = ".." }``. What names and ranges are allowed comes
from the declarations of the models and effects themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import tomlkit
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, create_model, model_validator

from bhm_service.battery.chem import Chem
from bhm_service.battery.circ import Circ
from bhm_service.battery.effects import KNOWN, Effect
from bhm_service.battery.left_open import LeftOpen
from bhm_service.battery.ocv import MOST_REST_V, CubicCapacitance, CurveRest, MonotoneSpline, OpenCircuit
from bhm_service.battery.parameters import Parameter, parameters_of
from bhm_service.battery.uncertainty import Uncertainty
from bhm_service.config import checked, read_toml
from bhm_service.errors import BadInputError

ModelName = Literal["circ", "chem"]
MODELS: tuple[ModelName, ...] = ("circ", "chem")


@dataclass(frozen=True, slots=True, kw_only=True)
class Joined:
    """An effect that has joined the pack; of one model only where the other has that physics in itself."""

    effect: Effect
    model: ModelName | None = None
    sd: Mapping[str, float] = field(default_factory=dict)  # SI


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryFile:
    """What a battery file says."""

    name: str
    source: str = ""
    series: int | None = None  # of the pack that was identified; None for a cell that any pack may be built from
    bench: bool = True  # a bench has seen that pack; flights alone leave its scales and where they began open
    circ: Circ | None = None
    chem: Chem | None = None
    joined: tuple[Joined, ...] = ()
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    sd: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # SI, per model and parameter
    shadow: str | None = None  # another battery file, relative to this one, that flies in its shadow
    left_open: Mapping[str, LeftOpen] = field(default_factory=dict)  # per model, by the lab's recordings

    def effects(self, model: ModelName) -> tuple[Effect, ...]:
        """The effects that a model's pack has."""
        return tuple(j.effect for j in self.joined if j.model in (None, model))

    def cell(self, model: ModelName) -> Circ | Chem:
        """The cell model asked for; BadInputError if the file has none."""
        cell = self.circ if model == "circ" else self.chem
        if cell is None:
            raise BadInputError(self.name, f"the battery file has no [{model}] section")
        return cell


class Strict(BaseModel):
    """A section of a file: frozen, and no key that it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class _Quantity(Strict):
    value: Annotated[float, Field(allow_inf_nan=False)]
    sd: Annotated[float | None, Field(ge=0.0)] = None
    unit: str | None = None


class _Shadow(Strict):
    file: str


class _LeftOpen(Strict):
    mean: dict[str, tuple[Annotated[float, Field(allow_inf_nan=False)], ...]]
    factor: tuple[tuple[Annotated[float, Field(allow_inf_nan=False)], ...], ...]
    error_v: Annotated[float, Field(gt=0.0, le=0.2)] | None = None
    load_error_v: Annotated[float, Field(gt=0.0, le=0.2)] | None = None

    @model_validator(mode="after")
    def _is_a_triangle(self) -> _LeftOpen:
        count = sum(len(values) for values in self.mean.values())
        if [len(row) for row in self.factor] != list(range(1, count + 1)):
            raise ValueError(f"factor must have {count} rows of 1 to {count} numbers, as many as mean has numbers")
        if any(row[-1] <= 0.0 for row in self.factor):
            raise ValueError("every row of factor must end with a number above 0")
        return self


class _LeftOpens(Strict):
    circ: _LeftOpen | None = None
    chem: _LeftOpen | None = None


class _Cubic(Strict):
    kind: Literal["cubic"]
    q_max_over_c_max: Annotated[float, Field(ge=1.0, le=2.0)] = 1.02
    v_0: Annotated[float, Field(ge=1.0, le=5.0)]
    cbp0: float
    cbp1: float
    cbp2: float


class _Spline(Strict):
    kind: Literal["spline"]
    soc: tuple[float, ...]
    volts: tuple[float, ...]

    @model_validator(mode="after")
    def _rises(self) -> _Spline:
        MonotoneSpline(self.soc, self.volts)
        return self


class _Rest(Strict):
    soc: tuple[float, ...]
    volts: tuple[Annotated[float, Field(ge=-MOST_REST_V, le=MOST_REST_V)], ...]

    @model_validator(mode="after")
    def _is_a_rest(self) -> _Rest:
        CurveRest(self.soc, self.volts)
        return self


def quantity(declared: Parameter) -> Any:
    """The type of one number in a file: bare or with its unit, inside the declared range."""

    def bare(given: Any) -> Any:
        return {"value": given} if isinstance(given, int | float) and not isinstance(given, bool) else given

    def in_range(quantity: _Quantity) -> _Quantity:
        if quantity.unit is not None and quantity.unit != declared.unit:
            raise ValueError(f"the unit must be {declared.unit!r}")
        if not declared.low <= quantity.value <= declared.high:
            raise ValueError(f"{quantity.value:g} is outside {declared.low:g} ... {declared.high:g} {declared.unit}")
        return quantity

    return Annotated[_Quantity, BeforeValidator(bare), AfterValidator(in_range)]


def _default(model: type, declared: Parameter) -> Any:
    default = model.__dataclass_fields__[declared.name].default  # type: ignore[attr-defined]
    return ... if default is MISSING else _Quantity(value=default / declared.scale)


@lru_cache(maxsize=1)
def _schema() -> type[BaseModel]:
    def section(name: str, of: type, **extra: Any) -> type[BaseModel]:
        fields: dict[str, Any] = {p.name: (quantity(p), _default(of, p)) for p in parameters_of(of)}
        return create_model(name, __base__=Strict, **fields, **extra)

    coefficients = Annotated[tuple[float, ...], Field(min_length=1, max_length=24)]
    circ = section("Circ", Circ, ocv=(Annotated[_Cubic | _Spline, Field(discriminator="kind")], ...))
    chem = section("Chem", Chem, a_p=(coefficients, ...), a_n=(coefficients, (0.0,)), curve_rest=(_Rest | None, None))
    effects = tuple(
        section(effect.__name__, effect, id=(Literal[name], ...), model=(ModelName | None, None))
        for name, effect in KNOWN.items()
    )
    union: Any = effects[0]
    for effect in effects[1:]:
        union = union | effect
    if len(effects) > 1:
        union = Annotated[union, Field(discriminator="id")]
    fields: dict[str, Any] = {
        "name": (str, ...),
        "source": (str, ""),
        "series": (Annotated[int | None, Field(ge=1, le=28)], None),
        "bench": (bool, True),
        "circ": (circ | None, None),
        "chem": (chem | None, None),
        "effect": (tuple[union, ...], ()),
        "uncertainty": (section("Uncertainty", Uncertainty) | None, None),
        "shadow": (_Shadow | None, None),
        "left_open": (_LeftOpens, _LeftOpens()),
    }
    return create_model("Battery", __base__=Strict, **fields)


def read_battery(path: Path) -> BatteryFile:
    """Read and check a battery file; BadInputError names file, key, value and what is allowed."""
    return checked_battery(read_toml(path), str(path))


def checked_battery(tables: dict[str, Any], where: str) -> BatteryFile:
    """The tables of a battery file, checked."""
    given: Any = checked(_schema(), tables, where)
    if given.circ is None and given.chem is None:
        raise BadInputError(where, "has neither a [circ] nor a [chem] section")
    sd: dict[str, dict[str, float]] = {}
    circ = chem = None
    if given.circ is not None:
        values, sd["circ"] = in_si(Circ, given.circ)
        circ = Circ(ocv=_open_circuit(given.circ.ocv, values["c_max"]), **values)
    if given.chem is not None:
        values, sd["chem"] = in_si(Chem, given.chem)
        rest = given.chem.curve_rest and CurveRest(given.chem.curve_rest.soc, given.chem.curve_rest.volts)
        chem = Chem(a_p=given.chem.a_p, a_n=given.chem.a_n, curve_rest=rest, **values)
    joined = []
    for entry in given.effect:
        kind = KNOWN[entry.id]
        values, spread = in_si(kind, entry)
        joined.append(Joined(effect=kind(**values), model=entry.model, sd=spread))
    return BatteryFile(
        name=given.name,
        source=given.source,
        series=given.series,
        bench=given.bench,
        circ=circ,
        chem=chem,
        joined=tuple(joined),
        uncertainty=Uncertainty(**in_si(Uncertainty, given.uncertainty)[0]) if given.uncertainty else Uncertainty(),
        sd=sd,
        shadow=None if given.shadow is None else given.shadow.file,
        left_open={
            model: LeftOpen(**dict(found)) for model in MODELS if (found := getattr(given.left_open, model)) is not None
        },
    )


def in_si(model: type, given: BaseModel) -> tuple[dict[str, float], dict[str, float]]:
    """Values and spreads of a model's parameters, in SI."""
    values, sd = {}, {}
    for declared in parameters_of(model):
        quantity: _Quantity = getattr(given, declared.name)
        values[declared.name] = quantity.value * declared.scale
        if quantity.sd is not None:
            sd[declared.name] = quantity.sd * declared.scale
    return values, sd


def _open_circuit(given: _Cubic | _Spline, c_max: float) -> OpenCircuit:
    if isinstance(given, _Spline):
        return MonotoneSpline(given.soc, given.volts)
    return CubicCapacitance(
        c_max=c_max,
        q_max=given.q_max_over_c_max * c_max,
        v_0=given.v_0,
        cbp0=given.cbp0,
        cbp1=given.cbp1,
        cbp2=given.cbp2,
    )


def write_battery(path: Path, battery: BatteryFile) -> None:
    """Write a battery file that `read_battery` gives back, with symbols and meanings as comments."""
    document = tomlkit.document()
    document["name"] = battery.name
    document["source"] = battery.source
    if battery.series is not None:
        document["series"] = battery.series
    if not battery.bench:
        document["bench"] = tomlkit.item(False).comment("identified from flights alone: its scales stay open")
    if battery.circ is not None:
        section = section_table(battery.circ, battery.sd.get("circ", {}))
        section["ocv"] = _ocv_table(battery.circ)
        document["circ"] = section
    if battery.chem is not None:
        section = section_table(battery.chem, battery.sd.get("chem", {}))
        section.add("a_p", _numbers(battery.chem.a_p).comment("[J/mol] A_p,k: Redlich-Kister, positive electrode"))
        section.add("a_n", _numbers(battery.chem.a_n).comment("[J/mol] A_n,k: negative electrode"))
        if battery.chem.curve_rest is not None:
            section["curve_rest"] = _rest_table(battery.chem.curve_rest)
        document["chem"] = section
    document["uncertainty"] = section_table(battery.uncertainty, {})
    if battery.shadow is not None:
        document["shadow"] = {"file": battery.shadow}
    if battery.joined:
        tables = tomlkit.aot()
        for joined in battery.joined:
            table = tomlkit.table()
            table["id"] = joined.effect.id
            if joined.model is not None:
                table["model"] = joined.model
            for key, item in section_table(joined.effect, joined.sd).items():
                table.add(key, item)
            tables.append(table)
        document["effect"] = tables
    if battery.left_open:
        document["left_open"] = {model: _left_open_table(found) for model, found in battery.left_open.items()}
    path.write_text(tomlkit.dumps(document), encoding="utf-8")


def section_table(model: object, sd: Mapping[str, float]) -> Any:
    """The numbers of a model or an effect as a TOML table, each with its spread, unit and meaning."""
    table = tomlkit.table()
    for declared in parameters_of(type(model)):
        entry = tomlkit.inline_table()
        entry["value"] = _rounded(getattr(model, declared.name) / declared.scale)
        if declared.name in sd:
            entry["sd"] = _rounded(sd[declared.name] / declared.scale, 2)
        entry["unit"] = declared.unit
        table.add(declared.name, entry)
        entry.comment(f"{declared.symbol}: {declared.meaning}")
    return table


def _ocv_table(circ: Circ) -> Any:
    table = tomlkit.table()
    curve = circ.ocv
    if isinstance(curve, MonotoneSpline):
        table["kind"] = "spline"
        table["soc"] = list(curve.soc)
        table["volts"] = [round(v, 5) for v in curve.volts]
    elif isinstance(curve, CubicCapacitance):
        table["kind"] = "cubic"
        table["q_max_over_c_max"] = _rounded(curve.q_max / curve.c_max)
        for name in ("v_0", "cbp0", "cbp1", "cbp2"):
            table[name] = _rounded(getattr(curve, name))
    return table


def _rest_table(rest: CurveRest) -> Any:
    table = tomlkit.table()
    table.add(tomlkit.comment("What the series leaves of the open-circuit curve."))
    table["soc"] = [round(s, 6) for s in rest.soc]
    table["volts"] = [round(v, 6) for v in rest.volts]
    return table


def _left_open_table(found: LeftOpen) -> Any:
    table = tomlkit.table()
    table.add(tomlkit.comment("Errors of this model's form, as the recordings leave them: for bhm explain."))
    for name, volts in (("error_v", found.error_v), ("load_error_v", found.load_error_v)):
        if volts is not None:
            table[name] = _rounded(volts)
    table["mean"] = {name: _numbers(values, 4) for name, values in found.mean.items()}
    rows = tomlkit.array()
    rows.extend([_numbers(row, 4) for row in found.factor])
    table.add("factor", rows.multiline(multiline=True))
    return table


def _numbers(values: tuple[Any, ...], digits: int = 10) -> Any:
    array = tomlkit.array()
    array.extend([_rounded(float(v), digits) for v in values])
    return array


def _rounded(value: Any, digits: int = 8) -> float:
    return float(f"{float(value):.{digits}g}")
