"""TOML files to frozen settings: a misspelt key, a missing one or a value out of range stops the start by name."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from bhm_service.errors import BadInputError


class Settings(BaseModel):
    """A section of a file: frozen, and no key that it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Section = TypeVar("Section", bound=BaseModel)


class BatterySettings(Settings):
    """Which battery the vehicle carries and when it counts as empty."""

    file: Annotated[str, Field(description="battery file, relative to the vehicle file")]
    series: Annotated[int | None, Field(ge=1, le=28, description="cells in series; the battery file's if absent")] = (
        None
    )
    capacity_ah: Annotated[
        float | None, Field(gt=0.05, le=500.0, description="[Ah] of the pack, where its battery file is of a cell only")
    ] = None
    capacity_sd: Annotated[float, Field(ge=0.0, le=0.3, description="[-] how well that is known, one sigma")] = 0.04
    id: Annotated[int, Field(ge=0, le=255, description="MAVLink battery id to follow")] = 0
    cutoff_v: Annotated[float, Field(ge=2.0, le=4.0, description="[V] a cell under load: empty")] = 3.2
    threshold_soc: Annotated[float, Field(ge=0.0, le=0.9, description="[-] state of charge that ends the flight")] = (
        0.20
    )


class RotorSettings(Settings):
    """What momentum theory needs (paper section 3)."""

    mass_kg: Annotated[float, Field(gt=0.05, le=500.0, description="[kg] with battery and payload")]
    rotors: Annotated[int, Field(ge=1, le=32, description="number of rotors")]
    rotor_radius_m: Annotated[float, Field(gt=0.01, le=5.0, description="[m]")]
    efficiency: Annotated[float, Field(gt=0.05, le=1.0, description="[-] battery to air, in the hover")] = 0.6
    avionics_w: Annotated[float, Field(ge=0.0, le=2000.0, description="[W] everything but the motors")] = 10.0


class DemandSettings(BaseModel):
    """One effect of the vehicle's demand model; its numbers are checked by the effect's own declaration."""

    model_config = ConfigDict(extra="allow", frozen=True)

    id: Annotated[str, Field(description="name of a demand effect")]


class Vehicle(Settings):
    """A vehicle file."""

    name: str
    battery: BatterySettings
    rotors: RotorSettings | None = None
    demand: Annotated[tuple[DemandSettings, ...], Field(description="what the hover's power leaves out, known")] = ()
    airborne_a: Annotated[
        float | None,
        Field(gt=0.0, le=1000.0, description="[A] more than this is flying; a share of the capacity if absent"),
    ] = None


class EstimatorSettings(Settings):
    """One estimator app."""

    model: Literal["circ", "chem"]


class Prediction(Settings):
    """How the flight ahead is imagined."""

    over: Annotated[Literal["samples", "sigma-points"], Field(description="what is run forward")] = "samples"
    samples: Annotated[int, Field(ge=10, le=5000, description="samples of state and load per prediction")] = 100
    seed: Annotated[int, Field(ge=0, description="of the samples, drawn once")] = 1
    load_spread: Annotated[
        Literal["quiet", "1sigma", "3sigma"],
        Field(description="quiet: how the mean load may differ; else that of single seconds (paper section 9)"),
    ] = "quiet"
    load_window_s: Annotated[float, Field(ge=10.0, le=600.0, description="[s] of flight that the load comes from")] = (
        90.0
    )


class LinkSettings(Settings):
    """Ways to the autopilot, and who we are there."""

    urls: Annotated[
        tuple[str, ...],
        Field(min_length=1, description="serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:, tcp: or tcpin:HOST:PORT"),
    ] = ("udpin:127.0.0.1:14550",)
    system: Annotated[int | None, Field(ge=1, le=255, description="vehicle to follow; the first heard if absent")] = (
        None
    )
    component: Annotated[int, Field(ge=191, le=194, description="our MAVLink component")] = 191
    signing_key: Annotated[Path | None, Field(description="key file; MAVLink 2 signing is on where given")] = None


class Reserves(Settings):
    """What the pilot is told at, in flight."""

    warning_s: Annotated[float, Field(ge=0.0, le=7200.0, description="[s] flying time left: a warning")] = 180.0
    critical_s: Annotated[float, Field(ge=0.0, le=7200.0, description="[s] flying time left: land now")] = 90.0
    landing_soc: Annotated[float, Field(ge=0.0, le=0.9, description="[-] state of charge: land now")] = 0.20

    @model_validator(mode="after")
    def _in_order(self) -> Reserves:
        if self.critical_s > self.warning_s:
            raise ValueError("critical_s must not be more than warning_s")
        return self


class CheckpointSettings(Settings):
    """What is believed, kept over restarts."""

    file: Annotated[
        Path | None, Field(description="under $STATE_DIRECTORY or ~/.local/state/bhm; not kept if empty")
    ] = Path("checkpoint")
    max_age_s: Annotated[float, Field(ge=5.0, le=600.0, description="[s] an older one is not used")] = 120.0

    _empty = field_validator("file", mode="before")(lambda given: given or None)


class RecorderSettings(Settings):
    """The flight recorder."""

    folder: Annotated[
        Path | None, Field(description="under $STATE_DIRECTORY or ~/.local/state/bhm; nothing is recorded if empty")
    ] = Path("recordings")
    size_mb: Annotated[float, Field(ge=1.0, le=100_000.0, description="[MB] of all segments")] = 64.0

    _empty = field_validator("folder", mode="before")(lambda given: given or None)


class Service(Settings):
    """The service file: what runs, beside the vehicle."""

    vehicle: Annotated[Path | None, Field(description="vehicle file, relative to this file")] = None
    battery: Annotated[Path | None, Field(description="battery file, likewise; the vehicle file's if absent")] = None
    link: LinkSettings = LinkSettings()
    estimators: tuple[EstimatorSettings, ...] = (
        EstimatorSettings(model="circ"),
        EstimatorSettings(model="chem"),
    )
    prediction: Prediction = Prediction()
    reserves: Reserves = Reserves()
    checkpoint: CheckpointSettings = CheckpointSettings()
    recorder: RecorderSettings = RecorderSettings()


def read_toml(path: Path) -> dict[str, Any]:
    """The file's tables; BadInputError when it is missing or not TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BadInputError(str(path), "no such file") from None
    except (IsADirectoryError, PermissionError) as why:
        raise BadInputError(str(path), why.strerror or "cannot be read") from None
    except UnicodeDecodeError:
        raise BadInputError(str(path), "is not text, so not a TOML file") from None
    except tomllib.TOMLDecodeError as why:
        raise BadInputError(str(path), f"is not valid TOML: {why}") from None


def checked(schema: type[Section], data: object, where: str) -> Section:
    """``data`` as ``schema``; BadInputError names every key that is at fault, its value and what is allowed."""
    try:
        return schema.model_validate(data)
    except ValidationError as why:
        problems = [_problem(schema, error) for error in why.errors(include_url=False)]
        raise BadInputError(where, "; ".join(problems)) from None


def _problem(schema: type[BaseModel], error: Any) -> str:
    path = [part for part in error["loc"] if not (isinstance(part, str) and part.startswith("function-"))]
    key = ".".join(str(part) for part in path)
    kind = error["type"]
    if kind == "extra_forbidden":
        known = _keys_at(schema, path[:-1])
        near = difflib.get_close_matches(str(path[-1]), known, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(known)}"
        return f"unknown key {key!r}: {hint}"
    if kind == "missing":
        return f"key {key!r} is missing"
    message = error["msg"].removeprefix("Value error, ")
    message = message.replace("Input should be", "must be")
    return f"{key} = {error['input']!r}: {message}"


def _keys_at(schema: type[BaseModel], path: list[Any]) -> list[str]:
    here: Any = schema
    for part in path:
        if isinstance(part, int):
            continue
        field = here.model_fields.get(part) if hasattr(here, "model_fields") else None
        if field is None:
            return []
        inner = [a for a in getattr(field.annotation, "__args__", (field.annotation,)) if hasattr(a, "model_fields")]
        if not inner:
            return []
        here = inner[0]
    return sorted(here.model_fields) if hasattr(here, "model_fields") else []


def shipped(*parts: str) -> Path:
    """A file of ``config/``: beside the package in a checkout, inside it when installed."""
    package = Path(__file__).parent
    inside = package / "config"
    return (inside if inside.is_dir() else package.parent / "config").joinpath(*parts)


def read_vehicle(path: Path) -> Vehicle:
    """A vehicle file, checked."""
    return checked(Vehicle, read_toml(path), str(path))
