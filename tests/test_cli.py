"""The command as a person runs it: in a process of its own."""

import csv
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink import mavutil

from bhm_service.config import shipped

GOLDEN = "tests/golden"
VEHICLE = str(shipped("vehicles", "quad-4s.toml"))


def bhm(*arguments, timeout=120):
    return subprocess.run(
        [sys.executable, "-m", "bhm_service.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    return out, bhm("replay", f"{GOLDEN}/hover.tlog", "-o", out, "--vehicle", VEHICLE)


def test_help_says_what_there_is():
    run = bhm("--help")
    assert run.returncode == 0
    assert "replay" in run.stdout
    assert max(map(len, run.stdout.splitlines())) <= 100


def test_replay_prints_a_table_that_fits_a_hundred_columns(replayed):
    _, run = replayed
    assert run.returncode == 0, run.stderr
    assert "Flight 1: took off" in run.stdout
    assert re.search(r"^circ +\d+ % \(\d+-\d+\)", run.stdout, re.MULTILINE)
    assert max(map(len, run.stdout.splitlines())) <= 100


def test_replay_writes_a_series_a_page_and_a_log(replayed):
    out, _ = replayed
    assert sorted(p.name for p in out.iterdir()) == ["hover.bhm.tlog", "hover.csv", "hover.html"]
    with (out / "hover.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) > 170
    seconds = [float(row["time_s"]) for row in rows]
    assert all(b - a == pytest.approx(1.0) for a, b in pairwise(seconds))
    assert float(rows[-1]["circ_soc"]) < float(rows[10]["circ_soc"])
    page = (out / "hover.html").read_text()
    assert "http" not in re.sub(r"<script>.*?</script>", "", page.split("<body>")[0], flags=re.DOTALL)
    assert all(words in page for words in ("Voltage [V]", "State of charge [%]", "Remaining flying time [min]"))


def test_the_log_holds_the_original_and_ours_for_pymavlink_to_play(replayed):
    out, _ = replayed
    original, played = (list(messages(path)) for path in (f"{GOLDEN}/hover.tlog", out / "hover.bhm.tlog"))
    ours = [m for m in played if m.get_srcComponent() == 191]
    others = [m for m in played if m.get_srcComponent() != 191]
    assert [bytes(m.get_msgbuf()) for m in others] == [bytes(m.get_msgbuf()) for m in original]
    assert {m.name for m in ours} >= {"BHM_RFT", "BHM_RFTLO", "BHM_RFTHI", "BHM_SOC", "BHM_SOE", "BHM_HLTH"}
    stamps = [m._timestamp for m in played]
    assert stamps == sorted(stamps)


def messages(path):
    log = mavutil.mavlogfile(str(path))
    while (message := log.recv_match()) is not None:
        yield message
    log.close()


def test_without_a_vehicle_one_is_guessed_and_said_to_be(tmp_path):
    run = bhm("replay", f"{GOLDEN}/hover.tlog", "-o", tmp_path)
    assert run.returncode == 0
    assert "vehicle guessed: 4 cells in series" in run.stdout


def test_logs_of_the_same_name_do_not_overwrite_each_other(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "log.csv").write_text("t_s,V,I\n" + "".join(f"{k},16.0,0.1\n" for k in range(30)))
    run = bhm("replay", tmp_path / "a/log.csv", tmp_path / "b/log.csv", "-o", tmp_path / "out")
    assert run.returncode == 0
    assert {p.name for p in (tmp_path / "out").glob("*.html")} == {"a-log.html", "b-log.html"}


NO_BATTERY = b"t_s,V,I\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["missing.tlog"], ["missing.tlog", "no such file"]),
        (["{empty}"], ["is empty"]),
        (["{text}"], ["is not a log that can be read", ".tlog"]),
        (["{hover}", "--battery-id", "3"], ["battery.id = 3", "not in this log, which has 0"]),
        (["{hover}", "--vehicle", "{vehicle}"], ["unknown key 'battery.serie'", "did you mean 'series'"]),
        (["{hover}", "--vehicle", "none.toml"], ["none.toml", "no such file"]),
        (["{hover}", "--battery", "{vehicle}"], ["unknown key 'battery'"]),
        (["{hover}", "--service", "{service}"], ["prediction.samples = 3", "greater than or equal to 10"]),
        (["{hover}", "--system", "9"], ["no message of an autopilot"]),
        (["{silent}"], ["no battery message", "SRx_EXTRA3"]),
        (["{hover}", "--battery-id", "999"], ["999", "0<=x<=255"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_bad_input_is_one_clear_message_and_status_two(tmp_path, arguments, said):
    from mavlink.frames import heartbeat, tlog

    files = {
        "empty": b"",
        "text": b"dear diary\n" * 40,
        "vehicle": shipped("vehicles", "quad-4s.toml").read_bytes().replace(b"series =", b"serie ="),
        "service": b"[prediction]\nsamples = 3\n",
        "silent": tlog([(float(k), heartbeat()) for k in range(20)]),
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    names = {name: str(tmp_path / name) for name in files} | {"hover": f"{GOLDEN}/hover.tlog"}
    run = bhm("replay", *(a.format(**names) for a in arguments), "-o", tmp_path / "out")
    assert run.returncode == 2
    assert "Traceback" not in run.stderr
    flat = " ".join(run.stderr.split())
    for part in said:
        assert part in flat


def test_one_bad_log_does_not_cost_the_good_ones(tmp_path):
    (tmp_path / "bad.tlog").write_bytes(b"")
    run = bhm("replay", tmp_path / "bad.tlog", f"{GOLDEN}/slow_link.tlog", "-o", tmp_path / "out")
    assert run.returncode == 2
    assert "bad.tlog" in run.stderr
    assert (tmp_path / "out" / "slow_link.html").exists()


def test_a_truncated_log_is_read_and_said_to_be(tmp_path):
    (tmp_path / "cut.tlog").write_bytes(Path(GOLDEN, "hover.tlog").read_bytes()[:-13])
    run = bhm("replay", tmp_path / "cut.tlog", "-o", tmp_path / "out")
    assert run.returncode == 0
    assert "the last frame is cut off" in run.stdout


def test_the_input_is_never_overwritten(tmp_path):
    source = tmp_path / "flight.csv"
    source.write_text("t_s,V,I\n0,16,1\n1,16,1\n2,16,1\n")
    run = bhm("replay", source, "-o", tmp_path)
    assert run.returncode == 2
    assert "overwritten" in run.stderr
    assert source.read_text().startswith("t_s,V,I")
