"""One thing that was looked at."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How bad it is."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """What was found, and what to do about it."""

    level: Level
    what: str
    mend: str = ""


def good(what: str) -> Finding:
    """Nothing to do."""
    return Finding(Level.GOOD, what)


def doubtful(what: str, mend: str) -> Finding:
    """The service runs, but not as well as it could."""
    return Finding(Level.DOUBTFUL, what, mend)


def bad(what: str, mend: str) -> Finding:
    """The service does not do its work."""
    return Finding(Level.BAD, what, mend)
