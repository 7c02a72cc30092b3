"""The eight open cases of ../shared/cases as a suite: for development, never evidence."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from sim.proof.cases import write_pack
from sim.proof.scoring.answers import Answer, Moment
from sim.proof.scoring.names import NONE, UNKNOWN

_SERIES = 6
_CONTACT = "intermittent-contact"


@dataclass(frozen=True, slots=True)
class SharedCase:
    """One of them, under a name that says nothing."""

    source: Path
    name: str

    def __call__(self, folder: Path, held: Path) -> list[Answer]:
        """Copy what a tool may see."""
        case = folder / self.name
        write_pack(case, _SERIES)
        for part in ("lab", "flights"):
            shutil.copytree(self.source / part, case / part, copy_function=shutil.copyfile)
            (case / part).chmod(0o755)
        return [answer_of_truth(json.loads((self.source / "truth.json").read_text()), self.name, case / "flights")]


def shared_cases(folder: Path, order: list[int]) -> list[SharedCase]:
    """The cases in this order."""
    sources = sorted(path.parent for path in folder.glob("*/truth.json"))
    return [SharedCase(sources[k], f"shared-{n:03d}") for n, k in enumerate(order)]


def answer_of_truth(truth: dict[str, object], name: str, flights: Path) -> Answer:
    """A truth.json as an answer."""
    accept = tuple(frozenset(str(entry).split("+")) for entry in truth["accept"])  # type: ignore[attr-defined]
    case = truth["case"]
    steps = case.get("per_flight", []) if isinstance(case, dict) else []
    points = tuple(
        Moment(f"{k:02d}.tlog", float(at)) for k, knobs in enumerate(steps) for at, _ in knobs.get("steps", [])
    )
    nothing = frozenset({NONE}) in accept or frozenset({UNKNOWN}) in accept
    return Answer(
        case=name,
        kind="shared",
        group="open case",
        accept=accept,
        truth=frozenset() if frozenset({NONE}) in accept else frozenset({_CONTACT}) if nothing else accept[0],
        change_points=points,
        starts_s={log.name: first_stamp_s(log) for log in sorted(flights.glob("*.tlog"))},
        note=str(truth["name"]),
    )


def first_stamp_s(path: Path) -> float:
    """The first time stamp of a tlog: eight bytes, microseconds since 1970, before every frame."""
    with path.open("rb") as stream:
        return int.from_bytes(stream.read(8), "big") / 1e6
