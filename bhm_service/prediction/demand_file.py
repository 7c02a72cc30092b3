"""The demand model of a vehicle file: its `[[demand]]` tables, checked by the effects' own declarations, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import tomlkit
from pydantic import BaseModel, create_model

from bhm_service.battery.battery_file import Strict, in_si, quantity, section_table
from bhm_service.battery.parameters import parameters_of
from bhm_service.config import Vehicle, checked
from bhm_service.errors import BadInputError
from bhm_service.prediction.demand_effects import DEMAND_EFFECTS, DemandEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownDemand:
    """An effect that the vehicle's demand model has."""

    effect: DemandEffect
    sd: float | None = None  # of its number; None where the file does not say


@cache
def _schema(name: str) -> type[BaseModel]:
    kind = DEMAND_EFFECTS[name]
    fields: dict[str, Any] = {p.name: (quantity(p), ...) for p in parameters_of(kind)}
    fields["id"] = (Literal[name], ...)
    return create_model(kind.__name__, __base__=Strict, **fields)


def known_demand(vehicle: Vehicle, where: str) -> tuple[KnownDemand, ...]:
    """The effects of a vehicle file. Raises BadInputError naming effect, key, value and what is allowed."""
    found: list[KnownDemand] = []
    for entry in vehicle.demand:
        if entry.id not in DEMAND_EFFECTS:
            raise BadInputError(
                where, f"[[demand]] id = {entry.id!r} is not known", f"known: {', '.join(DEMAND_EFFECTS)}"
            )
        if any(k.effect.id == entry.id for k in found):
            raise BadInputError(where, f"[[demand]] id = {entry.id!r} stands there twice")
        kind = DEMAND_EFFECTS[entry.id]
        given = checked(_schema(entry.id), entry.model_dump(), f"{where}, [[demand]] {entry.id}")
        values, sd = in_si(kind, given)
        found.append(KnownDemand(effect=kind(**values), sd=next(iter(sd.values()), None)))
    return tuple(found)


def with_demand(text: str, known: Sequence[KnownDemand], efficiency: float) -> str:
    """The text of a vehicle file with these effects in place of its own, and with this efficiency of the hover."""
    document = tomlkit.parse(text)
    document.pop("demand", None)
    rotors: Any = document["rotors"]
    rotors["efficiency"] = round(efficiency, 4)
    tables = tomlkit.aot()
    for joined in known:
        table = tomlkit.table()
        table["id"] = joined.effect.id
        declared = parameters_of(type(joined.effect))
        sd = {} if joined.sd is None else {p.name: joined.sd for p in declared}
        for key, item in section_table(joined.effect, sd).items():
            table.add(key, item)
        tables.append(table)
    if known:
        document["demand"] = tables
    return tomlkit.dumps(document)
