"""The proof's quick part: a few concealed cases of a fixed seed, from the draw to the score."""

from __future__ import annotations

from sim.proof.run import Request, prove
from sim.proof.scoring.score import FALSE_ALARMS, PRECISION

SEED, CASES = 4, 6
# "tool" from the day that bhm explain passes this in two minutes. On 2026-11-22 it took 2:15 on two cores, claimed
# nothing on the three nulls, and found neither of the two effects, which are of SNR 5 to 15; until then the harness
# examines itself.
ANSWERER = "oracle"


def test_on_a_few_concealed_cases_nothing_is_claimed_of_a_null_and_most_effects_are_right(tmp_path):
    request = Request(suites=("quick",), seed=SEED, cases=CASES, answerer=ANSWERER, output=tmp_path / "run")
    (score,) = prove(request, lambda _: None, lambda *_: None).scores
    rows = {row.name: row for row in score.rows}
    assert rows[FALSE_ALARMS].n >= 1
    assert rows[FALSE_ALARMS].value == 0.0
    assert rows[PRECISION].n >= 1
    assert rows[PRECISION].value > 0.5
    assert rows["no answer at all"].value == 0.0
