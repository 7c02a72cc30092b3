"""The two simulated packs of `../shared/cases`, identified by the command once for all tests of a run."""

from __future__ import annotations

import fcntl
import os
import pickle
from pathlib import Path

import pytest
from commanded import bhm

from bhm_service.commands import identify as command
from bhm_service.identification.identify import Identified

# The lab's recordings are the same in all cases of one pack (the README there says which): a case to read them from.
CASES = {"kokam12": "null", "nca16": "fade"}


def shared_folder(factory: pytest.TempPathFactory) -> Path:
    """A folder of this run, the same for all its workers."""
    own = factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


def identified_pack(pack: str, cases: Path, folder: Path) -> tuple[Path, Identified]:
    """The battery file from the three recordings of a pack's lab, and all that the command knew when it wrote it."""
    written, known = folder / f"{pack}.toml", folder / f"{pack}.pickle"
    with (folder / f"{pack}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not known.exists():
            lab = cases / CASES[pack] / "lab"
            with pytest.MonkeyPatch.context() as listening:
                found: list[Identified] = []
                identify = command.identify
                listening.setattr(command, "identify", lambda *asked: found.append(identify(*asked)) or found[-1])
                bhm("identify", "--slow", lab / "slow.csv.gz", "--one-c", lab / "one_c.csv.gz", "--variable",
                    lab / "variable.csv.gz", "--series", "6", "-o", written)  # fmt: skip
            known.write_bytes(pickle.dumps(found[-1]))
    return written, pickle.loads(known.read_bytes())
