"""`findings.json`: its keys are those that were promised, and what cannot be true is refused."""

from __future__ import annotations

import json

import pytest
from pydantic import ValidationError

from bhm_service.discrepancy.findings import EffectFound, Findings, Fit, Quantity, read_findings, write_findings

# As the specification of `bhm explain` words them.
KEYS = {
    "verdict", "effects", "alternatives", "unexplained_rest", "localisation", "change_points", "inferred", "fit",
    "advice", "battery_file",
}  # fmt: skip
NESTED = {
    "EffectFound": {"id", "parameters", "evidence_nats", "p_familywise", "share_of_misfit", "decoys_beaten"},
    "Quantity": {"value", "sd", "unit"},
    "Region": {"where", "flights", "share_of_misfit", "sign"},
    "ChangePoint": {"flight", "time_s"},
    "Fit": {"rmse_before_V", "rmse_after_V", "heldout_before_V", "heldout_after_V", "noise_floor_V"},
}
VERDICTS = {"none", "parameter", "named", "ambiguous", "sensor-suspect", "unknown", "not-excited"}
FADE = EffectFound(
    id="capacity-fade",
    parameters={"k": Quantity(value=0.09, sd=0.01, unit="1")},
    evidence_nats=80.0,
    p_familywise=0.005,
    share_of_misfit=0.9,
    decoys_beaten=None,
)
FOUND = Findings(
    verdict="named",
    effects=[FADE],
    alternatives=[["unseen-load"]],
    unexplained_rest=0.1,
    localisation=[{"where": {"soc": (0.2, 0.4)}, "flights": ["00.tlog"], "share_of_misfit": 0.6, "sign": -1}],
    change_points=[{"flight": "00.tlog", "time_s": 12.0}],
    inferred=[],
    fit=Fit(
        rmse_before_V=0.2, rmse_after_V=0.02, heldout_before_V=0.2, heldout_after_V=None, noise_floor_V=0.01
    ),
    advice=["hover down to 15 % of charge"],
    battery_file="battery.toml",
)  # fmt: skip


def test_a_schema_can_be_given_to_other_tools_and_has_the_promised_keys():
    schema = Findings.model_json_schema()
    assert set(schema["properties"]) == KEYS == set(schema["required"])
    assert set(schema["properties"]["verdict"]["enum"]) == VERDICTS
    for name, keys in NESTED.items():
        assert set(schema["$defs"][name]["properties"]) == keys, name


def test_what_is_written_has_those_keys_and_reads_back(tmp_path):
    write_findings(tmp_path / "findings.json", FOUND)
    assert set(json.loads((tmp_path / "findings.json").read_text())) == KEYS
    assert read_findings(tmp_path / "findings.json") == FOUND


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("verdict", "maybe"),
        ("unexplained_rest", 1.2),
        ("unexplained_rest", float("nan")),
        ("battery_file", 3),
        ("effects", [FADE.model_dump() | {"p_familywise": -0.1}]),
        ("effects", [FADE.model_dump() | {"parameters": {"k": {"value": 1.0, "sd": -1.0, "unit": "1"}}}]),
        ("effects", [FADE.model_dump() | {"parameters": {"k": {"value": float("inf"), "sd": 1.0, "unit": "1"}}}]),
        ("localisation", [{"where": {}, "flights": [], "share_of_misfit": 0.5, "sign": 0}]),
        ("change_points", [{"flight": "00.tlog"}]),
        ("something_else", 1),
    ],
)
def test_what_cannot_be_true_is_refused(key, value):
    with pytest.raises(ValidationError):
        Findings.model_validate(FOUND.model_dump() | {key: value})
