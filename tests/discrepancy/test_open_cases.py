"""The eight open cases from the lab's recordings to the verdict, as `../shared/cases` describes it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from commanded import bhm
from identified_packs import identified_pack, shared_folder

from bhm_service.battery.battery_file import MODELS, read_battery
from bhm_service.discrepancy.findings import read_findings

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"
AT_ONCE = ("null", "fade", "connector")
LONG = ("cold-seen", "cold-hidden", "partial-charge", "unseen-load", "contact-and-cold")  # in `make proofs`
NAMES = [*AT_ONCE, *(pytest.param(name, marks=pytest.mark.long) for name in LONG)]
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is absent")


@pytest.fixture(scope="session")
def battery(tmp_path_factory):
    """The battery file of a pack by name."""
    return lambda pack: identified_pack(pack, CASES, shared_folder(tmp_path_factory))[0]


def missed(truth, found):
    """Steps [(flight, s)] that no change point is within 10 s of, and change points that are near no step."""
    true = [(k, at) for k, f in enumerate(truth["flights"]) for at, _ in f["knobs"]["steps"]]
    said = [(int(c.flight.split(".")[0]), c.time_s) for c in found.change_points]

    def near(a, b):
        return a[0] == b[0] and abs(a[1] - b[1]) <= 10.0

    return [t for t in true if not any(near(t, s) for s in said)], [
        s for s in said if not any(near(s, t) for t in true)
    ]


@pytest.mark.parametrize("case", NAMES)
def test_the_case_is_named_right(case, battery, tmp_path):
    folder = CASES / case
    truth = json.loads((folder / "truth.json").read_text())
    flights = folder / "flights"
    bhm("explain", *sorted(flights.glob("*.tlog")), "--battery", battery(truth["pack"]), "--sidecar",
        flights / "flights.csv", "-o", tmp_path)  # fmt: skip
    found = read_findings(tmp_path / "findings.json")
    named = {e.id for e in found.effects}
    said = f"{found.verdict}: {sorted(named)}"
    assert any(
        found.verdict == accepted if accepted in ("none", "unknown") else named == set(accepted.split("+"))
        for accepted in truth["accept"]
    ), said
    assert missed(truth, found) == ([], [])
    if named:
        assert found.fit.heldout_after_V < found.fit.heldout_before_V
    if named and found.battery_file is not None:
        new = read_battery(tmp_path / found.battery_file).joined
        circ, chem = ({j.effect.id for j in new if j.model == model} for model in MODELS)
        assert circ & named == chem & named != set()  # flying time is told by both models together
