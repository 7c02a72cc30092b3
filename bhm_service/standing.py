"""How new physics stands against the old, kept from flight to flight beside the checkpoint."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from bhm_service.codec import NotThisKindError, packed, unpacked
from bhm_service.messages import Message, Standing


class StandingFile:
    """A sink that writes each standing down. Another pair of battery files begins anew."""

    name = "standing"
    hears = (Standing,)
    says: tuple[type, ...] = ()

    def __init__(self, path: Path, belongs_to: str) -> None:
        self._path, self._belongs_to = path, belongs_to

    def read(self) -> Standing | None:
        """What was written for these battery files; None where there is nothing, or nothing that can be read."""
        try:
            kept = json.loads(self._path.read_bytes())
            if kept["belongs_to"] != self._belongs_to:
                return None
            return unpacked(Standing, kept["standing"])
        except (OSError, ValueError, KeyError, TypeError, NotThisKindError):
            return None

    def on_message(self, message: Message) -> Sequence[Message]:
        # Once a flight, so it goes to the card at once. Without it the next run only asks for two more flights.
        fresh = self._path.with_name(self._path.name + ".new")
        text = json.dumps({"belongs_to": self._belongs_to, "standing": packed(message)}, indent=1)
        with suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with fresh.open("w", encoding="utf-8") as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            fresh.replace(self._path)
        return []
