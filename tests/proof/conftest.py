"""Suites for the assessor that are not of the world: a few answers, and outcomes made by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.proof.run import Proof, Request, prove
from sim.proof.suites import SHARED


@pytest.fixture(scope="session")
def proven(tmp_path_factory):
    """A whole run over the open cases by a stand-in; a test that asks for it is skipped where they are absent."""
    if not (SHARED / "cases").is_dir():
        pytest.skip(f"the open cases are not here: {SHARED / 'cases'}")
    done: dict[str, tuple[Path, Proof, list[str]]] = {}

    def run(answerer: str) -> tuple[Path, Proof, list[str]]:
        if answerer not in done:
            folder, said = tmp_path_factory.mktemp("proof") / "run", []
            request = Request(suites=("shared",), seed=5, answerer=answerer, output=folder, keep=True)
            done[answerer] = folder, prove(request, said.append, lambda *_: None), said
        return done[answerer]

    return run
