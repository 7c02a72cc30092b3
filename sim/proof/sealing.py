"""Answers are committed to before a tool runs and opened after: SHA-256 over a salt and the answers' text.

Until then they are in the memory of the process that made them and nowhere else; what is on disk is the hash. There is
no encrypted copy to break, and a run that dies before its end cannot be scored.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bhm_service.errors import BadInputError
from sim.proof.scoring.answers import Answer, answer_from_json, answer_to_json

SEALED, OPENED = "sealed.json", "answers.json"


@dataclass(frozen=True, slots=True)
class Seal:
    """Sealed answers. The seed is sealed with them: who knows it can draw the cases again."""

    text: str
    salt: str

    @property
    def digest(self) -> str:
        """SHA-256 of salt and text, in hexadecimal."""
        return hashlib.sha256(f"{self.salt}\n{self.text}".encode()).hexdigest()


def seal(suites: Mapping[str, Sequence[Answer]], seed: int) -> Seal:
    """Seal the answers of every suite of a run."""
    content = {"seed": seed, "suites": {name: [answer_to_json(a) for a in of] for name, of in suites.items()}}
    return Seal(json.dumps(content, sort_keys=True, separators=(",", ":")), secrets.token_hex(32))


def write_sealed(folder: Path, sealed: Seal, about: Mapping[str, Any]) -> None:
    """Commit: the hash, and what is public, before any tool runs."""
    (folder / SEALED).write_text(json.dumps({"sha256": sealed.digest, **about}, indent=1) + "\n")


def write_opened(folder: Path, sealed: Seal) -> None:
    """Open: salt and answers, for anybody to hash again."""
    (folder / OPENED).write_text(json.dumps({"salt": sealed.salt, "text": sealed.text}) + "\n")


def opened(folder: Path) -> tuple[int, dict[str, list[Answer]]]:
    """Seed and answers of a run, after checking them against what was committed.

    Raises BadInputError where they are not those that were sealed.
    """
    committed = json.loads((folder / SEALED).read_text())["sha256"]
    given = json.loads((folder / OPENED).read_text())
    found = Seal(given["text"], given["salt"])
    if found.digest != committed:
        raise BadInputError(
            str(folder / OPENED), f"is not what was sealed: its SHA-256 is {found.digest}, sealed was {committed}"
        )
    content = json.loads(found.text)
    return content["seed"], {name: [answer_from_json(a) for a in of] for name, of in content["suites"].items()}
