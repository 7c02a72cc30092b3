"""What `bhm explain` says, as `findings.json`: the keys, their types and ranges."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Verdict = Literal["none", "parameter", "named", "ambiguous", "sensor-suspect", "unknown", "not-excited"]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Quantity(_Strict):
    """A number with its standard deviation."""

    value: float
    sd: Annotated[float, Field(ge=0.0)]
    unit: str


class EffectFound(_Strict):
    """One effect of the verdict."""

    id: str
    parameters: dict[str, Quantity]
    evidence_nats: float  # that it adds to the others
    p_familywise: _Share  # that the largest of all candidates does as well on noise alone
    share_of_misfit: _Share  # of the squared voltage error that goes with it
    decoys_beaten: _Share | None  # of the phantom drivers; None where the effect has no driver


class Region(_Strict):
    """Where the model is off: the range of each variable, in SI but temperature_C."""

    where: dict[str, tuple[float, float]]
    flights: list[str]
    share_of_misfit: _Share
    sign: Literal[-1, 1]  # of measured minus modelled voltage


class ChangePoint(_Strict):
    """A step, in seconds from the first sample of its log."""

    flight: str
    time_s: float


class Inferred(_Strict):
    """A file with the course of hidden states in one flight: time_s, then each state and its standard deviation."""

    flight: str
    file: str
    states: list[str]


class Fit(_Strict):
    """Errors of the pack's voltage. [V]"""

    rmse_before_V: float  # noqa: N815 - the file's own names
    rmse_after_V: float  # noqa: N815
    heldout_before_V: float | None  # noqa: N815 - on flights that no fit saw; None with too few flights
    heldout_after_V: float | None  # noqa: N815
    noise_floor_V: float  # noqa: N815


class Findings(_Strict):
    """The whole of `findings.json`."""

    verdict: Verdict
    effects: list[EffectFound]
    alternatives: list[list[str]]  # sets that the recordings cannot tell from the chosen one
    unexplained_rest: _Share
    localisation: list[Region]
    change_points: list[ChangePoint]
    inferred: list[Inferred]
    fit: Fit
    advice: list[str]
    battery_file: str | None


def write_findings(path: Path, findings: Findings) -> None:
    """Write `findings.json`."""
    path.write_text(findings.model_dump_json(indent=2) + "\n", encoding="utf-8")


def read_findings(path: Path) -> Findings:
    """Read and check a `findings.json`."""
    return Findings.model_validate_json(path.read_text(encoding="utf-8"))
