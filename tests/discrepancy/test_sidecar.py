"""The table beside the logs."""

from __future__ import annotations

import pytest

from bhm_service.discrepancy.sidecar import Notes, read_sidecar
from bhm_service.errors import BadInputError


def sidecar(tmp_path, text):
    path = tmp_path / "flights.csv"
    path.write_text(text)
    return path


def test_what_is_written_of_a_flight_is_read_in_si_and_blanks_are_unknown(tmp_path):
    path = sidecar(
        tmp_path,
        "file,rest_voltage_V,rest_minutes,cycles,storage_days,ambient_C,battery_id,pack,weather\n"
        "a.tlog,22.5,30,12,3,-5,1,blue,windy\n"
        "b.tlog,,,,,,,,\n",
    )
    notes = read_sidecar(path)
    assert notes["a.tlog"] == Notes(
        rest_voltage_v=22.5, rest_s=1800.0, cycles=12.0, storage_days=3.0, ambient_k=268.15, battery_id=1, pack="blue"
    )
    assert notes["b.tlog"] == Notes()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("log,cycles\na.tlog,3\n", "has no column 'file'; it has log, cycles"),
        ("", "has no column 'file'; it has none"),
        ("file,cycles\na.tlog,many\n", r"line 2: cycles = 'many' is not a number"),
        ("file,rest_voltage_V\na.tlog,22\nb.tlog,2200\n", r"line 3: rest_voltage_V = 2200 is outside 0 \.\.\. 200"),
        ("file,ambient_C\na.tlog,nan\n", r"line 2: ambient_C = nan is outside -60 \.\.\. 80"),
        ("file\na.tlog\na.tlog\n", r"line 3: file 'a\.tlog' stands there twice"),
    ],
)
def test_a_bad_line_is_named_with_its_value_and_what_is_allowed(tmp_path, text, said):
    with pytest.raises(BadInputError, match=said):
        read_sidecar(sidecar(tmp_path, text))


def test_a_sidecar_that_is_not_there_is_said_to_be_absent(tmp_path):
    with pytest.raises(BadInputError, match="no such file"):
        read_sidecar(tmp_path / "absent.csv")
