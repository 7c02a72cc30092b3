"""The proof's quick part: a few concealed cases of a fixed seed, from the draw to the score."""

from __future__ import annotations

from pathlib import Path

from sim.proof.run import Request, prove
from sim.proof.scoring.score import ANSWERED, FALSE_ALARMS, OF_ORACLE, PRECISION

# A null and flights that were not charged full: chosen for what it holds, not blind.
SEED, CASES = 6, 2


def test_on_a_few_concealed_cases_nothing_is_claimed_of_a_null_and_an_effect_is_named(tmp_path, monkeypatch):
    # As `make prove` asks for it: where the tool runs, in a folder of its own, that path means nothing.
    monkeypatch.chdir(tmp_path)
    request = Request(suites=("quick",), seed=SEED, cases=CASES, flying=False, output=Path("run"))
    (score,) = prove(request, lambda _: None, lambda *_: None).scores
    rows = {row.name: row for row in score.rows}
    assert rows[FALSE_ALARMS].n == 1
    assert rows[FALSE_ALARMS].value == 0.0
    assert rows[PRECISION].n >= 1
    assert rows[PRECISION].value == 1.0
    assert rows[ANSWERED].value == 1.0
    assert rows["no answer at all"].value == 0.0
    assert rows[OF_ORACLE].n >= 1
    assert rows[OF_ORACLE].value > 0.5
