"""A proof from the draw to the card: it is sealed, it cannot be looked into, and it can fail."""

from __future__ import annotations

import json
import re
import sys

import pytest
from click.testing import CliRunner

from bhm_service.cli import cli
from bhm_service.errors import BadInputError
from sim.proof.answerers import StandIn, answerer
from sim.proof.card import write_card
from sim.proof.cases import Case
from sim.proof.confine import Ran, confinement
from sim.proof.readme import BEGIN, END, write
from sim.proof.run import Request, all_met, prove, scored
from sim.proof.scoring.answers import Answer
from sim.proof.scoring.findings import outcome_from_json
from sim.proof.scoring.judge import judge
from sim.proof.sealing import OPENED, seal
from sim.proof.suites import SHARED, checked_seed, exam_seed


@pytest.mark.parametrize("who", ["none", "always:resistance-temperature", "random:1"])
def test_the_card_condemns_an_answerer_that_does_not_look(proven, who):
    _, proof, _ = proven(who)
    assert not all_met(proof.scores)
    (score,) = proof.scores
    assert score.failed == 2  # answered right, and the connector's times


def test_the_card_passes_an_oracle(proven):
    _, proof, _ = proven("oracle")
    assert all_met(proof.scores)


def test_the_hash_is_said_before_the_verdicts_and_the_seed_after(proven):
    folder, proof, said = proven("oracle")
    sealed = json.loads((folder / "sealed.json").read_text())
    assert said[0] == f"sealed: SHA-256 {sealed['sha256']}"
    assert "seed" not in sealed
    assert said[1].endswith(f"seed {proof.about['seed']}")


def test_answers_that_were_changed_after_the_seal_are_refused(proven, tmp_path):
    folder, _, _ = proven("none")
    for name in ("sealed.json", "ended.json", "outcomes.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    text = (folder / OPENED).read_text()
    (tmp_path / OPENED).write_text(text)
    assert scored(tmp_path).scores[0].failed
    (tmp_path / OPENED).write_text(text.replace("capacity-fade", "none"))
    with pytest.raises(BadInputError, match="is not what was sealed"):
        scored(tmp_path)


def test_equal_answers_have_unequal_hashes_so_that_nobody_can_guess_them():
    answers = {"s": [Answer(case="c", kind="null", accept=(frozenset({"none"}),))]}
    assert seal(answers, 1).digest != seal(answers, 1).digest


def test_what_a_tool_sees_names_no_effect(proven):
    folder, proof, _ = proven("none")
    seen = [str(path.relative_to(folder / "cases")) for path in (folder / "cases").rglob("*")]
    assert len(seen) > 8 * 9
    words = {word for answers in proof.answers.values() for a in answers for word in re.split(r"\W+", a.label + a.note)}
    for word in words - {"open"}:
        assert not any(word and word in name for name in seen), word
    assert not list((folder / "cases").rglob("truth*"))


def test_a_confined_program_finds_neither_the_answers_nor_the_process_that_holds_them(tmp_path):
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "answers").write_text("weak-cell")
    kept_in = confinement([tmp_path / "secret"])
    if not kept_in.prefix:
        pytest.skip("this machine refuses namespaces")
    look = (
        "import os, pathlib; print(list(pathlib.Path('secret').iterdir()), os.getpid() < 50, "
        "len([p for p in os.listdir('/proc') if p.isdigit()]) < 50)"
    )
    ran = kept_in.run([sys.executable, "-c", look], tmp_path, 30.0, {})
    assert (ran.status, ran.said.strip()) == (0, "[] True True")
    assert (tmp_path / "secret" / "answers").exists()


def test_a_program_that_never_ends_is_ended(tmp_path):
    ran = confinement([]).run([sys.executable, "-c", "while True: pass"], tmp_path, 0.5, {})
    assert ran.status is None


def test_an_exam_has_a_seed_that_no_development_run_can_have():
    assert checked_seed(99_999, exam=False) == 99_999
    with pytest.raises(BadInputError, match="belongs to exams"):
        checked_seed(exam_seed(0), exam=False)


def test_the_page_says_first_what_it_cannot_do(proven, tmp_path):
    _, proof, _ = proven("always:resistance-temperature")
    page, _ = write_card(tmp_path, proof)
    body = page.read_text().split("<body>")[1]
    parts = [
        "NOT PROVEN",
        "What it cannot do",
        "weak-cell",
        "Nobody can tell apart",
        "voltage-gain and voltage-offset",
        "MISSED",
    ]
    places = [body.index(part) for part in parts]
    assert places == sorted(places)
    json.loads((tmp_path / "score.json").read_text())


def test_the_readme_gets_the_card_between_its_marks_misses_included(proven, tmp_path):
    _, proof, _ = proven("none")
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    write(proof, readme)
    text = readme.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    for part in (
        "NOT PROVEN",
        "MISSED",
        proof.about["commit"],
        f"seed {proof.about['seed']}",
        proof.about["started"][:10],
    ):
        assert part in text
    readme.write_text("no marks")
    with pytest.raises(BadInputError, match="once each"):
        write(proof, readme)


def test_a_run_never_overwrites_another(tmp_path):
    (tmp_path / "something").touch()
    with pytest.raises(BadInputError, match="is not empty"):
        prove(Request(suites=("shared",), seed=1, output=tmp_path), lambda _: None, lambda *_: None)


def test_an_answerer_or_suite_that_is_not_known_is_named(tmp_path):
    with pytest.raises(BadInputError, match=r"always:EFFECT"):
        answerer("always:gremlins", tmp_path, confinement([SHARED]))
    with pytest.raises(BadInputError, match=r"known are .*shared, real"):
        prove(Request(suites=("nowhere",), seed=1, output=tmp_path / "o"), lambda _: None, lambda *_: None)


class Printing:
    """A confinement that runs nothing: its program has already said this and ended so."""

    def __init__(self, status: int, said: str) -> None:
        self.ran = Ran(status, said, 1.0, 1.0, 50.0)

    def run(self, program, folder, longest_s, env):
        return self.ran


@pytest.mark.parametrize(
    ("status", "said", "refused"),
    [
        (2, "bhm: 03.csv: is of a pack of 4 cells, the others are of 6", True),
        (2, "Usage: bhm explain [OPTIONS]\nError: No such option", False),
        (1, "Traceback", False),
    ],
)
def test_only_a_sentence_about_the_input_is_a_refusal(proven, tmp_path, status, said, refused):
    folder, proof, _ = proven("none")
    name = proof.answers["shared"][0].case
    outcome = StandIn("none", Printing(status, said)).answer(Case(folder / "cases" / name), tmp_path, None)
    assert outcome["refused"] is refused
    assert said.splitlines()[0][:20] in outcome["failure"]
    control = Answer(case=name, kind="control", accept=(frozenset({"none"}), frozenset({"unknown"})), may_refuse=True)
    assert judge(control, outcome_from_json(outcome)).accepted is refused


def test_a_finished_run_can_be_scored_again_from_the_command_line(proven):
    folder, _, _ = proven("random:1")
    again = CliRunner().invoke(cli, ["prove", "--again", str(folder)])
    assert again.exit_code == 1
    assert "NOT PROVEN" in again.output
    assert max(map(len, again.output.splitlines())) <= 100
