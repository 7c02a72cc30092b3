from dataclasses import replace

import numpy as np
import pytest
from battery.cells import CUBIC, chem, circ

from bhm_service.battery.battery_file import BatteryFile, Joined, read_battery, write_battery
from bhm_service.battery.effects import ResistanceTemperature, SlowDiffusion
from bhm_service.battery.left_open import left_open
from bhm_service.battery.ocv import CurveRest
from bhm_service.errors import BadInputError

COVARIANCE = np.array([[4e-6, 1e-6, 0.0], [1e-6, 9e-6, -2e-6], [0.0, -2e-6, 1e-4]])
LEFT_OPEN = left_open({"bends": np.array([0.001, -0.002]), "curve": np.array([0.3])}, COVARIANCE)
OWN = replace(LEFT_OPEN, error_v=0.0017, load_error_v=0.0042)
REST = CurveRest((0.0, 0.9, 1.0), (0.001, -0.002, 0.013))
R_S = 'value = 0.004, sd = 0.0002, unit = "ohm"'


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "pack.toml"
    write_battery(
        path,
        BatteryFile(
            name="test pack",
            series=6,
            circ=circ(),
            chem=chem(curve_rest=REST),
            joined=(
                Joined(effect=ResistanceTemperature(activation_energy=21.5e3), sd={"activation_energy": 900.0}),
                Joined(effect=SlowDiffusion(resistance=0.002, time_constant=400.0), model="circ"),
            ),
            sd={"circ": {"r_s": 2e-4}},
            left_open={"circ": OWN},
        ),
    )
    return path


def test_what_is_written_is_read_back(written):
    back = read_battery(written)
    assert back.series == 6
    assert back.circ.r_s == pytest.approx(0.004)
    assert back.circ.c_max == pytest.approx(18000.0)
    assert back.chem.a_p == pytest.approx(chem().a_p)
    assert back.joined[0].effect.activation_energy == pytest.approx(21.5e3)
    assert back.joined[0].sd["activation_energy"] == pytest.approx(900.0)
    assert back.sd["circ"]["r_s"] == pytest.approx(2e-4)
    assert back.left_open["circ"].mean == {"bends": (0.001, -0.002), "curve": (0.3,)}
    np.testing.assert_allclose(back.left_open["circ"].covariance, COVARIANCE, rtol=2e-3, atol=1e-9)
    assert back.left_open["circ"].error_v == pytest.approx(0.0017)
    assert back.left_open["circ"].load_error_v == pytest.approx(0.0042)
    assert "chem" not in back.left_open
    soc = np.linspace(0, 1, 50)
    np.testing.assert_allclose(back.circ.open_circuit(soc), circ().open_circuit(soc), atol=1e-5)
    np.testing.assert_allclose(back.chem.open_circuit(soc), chem(curve_rest=REST).open_circuit(soc), atol=1e-5)
    assert back.chem.curve_rest == REST


def test_an_effect_of_one_model_joins_that_model_only(written):
    back = read_battery(written)
    assert [type(e) for e in back.effects("circ")] == [ResistanceTemperature, SlowDiffusion]
    assert [type(e) for e in back.effects("chem")] == [ResistanceTemperature]


def test_the_papers_cubic_curve_survives_the_file(tmp_path):
    path = tmp_path / "cubic.toml"
    write_battery(path, BatteryFile(name="cubic", circ=circ(ocv=CUBIC)))
    soc = np.linspace(0, 1, 50)
    np.testing.assert_allclose(read_battery(path).circ.open_circuit(soc), CUBIC.voltage(soc), rtol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("r_s = ", "r_ss = ", ["unknown key 'circ.r_ss'", "did you mean 'r_s'", "'circ.r_s' is missing"]),
        (R_S, 'value = 40.0, unit = "ohm"', ["circ.r_s", "40", "1e-05 ... 1 ohm"]),
        (R_S, 'value = 4.0, unit = "mohm"', ["circ.r_s", "unit must be 'ohm'"]),
        ("soc = [0.0, 0.9, 1.0]", "soc = [0.0, 1.0, 0.9]", ["chem.curve_rest", "states of charge that rise"]),
        ("volts = [0.001, -0.002, 0.013]", "volts = [0.001, 0.013]", ["chem.curve_rest", "as many voltages"]),
        ("volts = [0.001, -0.002, 0.013]", "volts = [0.001, 0.0, 1.3]", ["chem.curve_rest", "0.2"]),
        ('kind = "spline"', 'kind = "polynomial"', ["circ.ocv", "polynomial", "spline"]),
        ("4.2]", "3.1]", ["circ.ocv", "rise"]),
        ("curve = [0.3]", "curve = [0.3, 0.4]", ["left_open.circ", "factor must have 4 rows of 1 to 4 numbers"]),
        ("[0.002],", "[-0.002],", ["left_open.circ", "every row of factor must end with a number above 0"]),
        ("curve = [0.3]", "curve = [nan]", ["left_open.circ.mean.curve", "finite"]),
        ("error_v = 0.0017", "error_v = 1.7", ["left_open.circ.error_v", "less than or equal to 0.2"]),
        ("series = 6", "series = 0", ["series = 0", "greater than or equal to 1"]),
        ('id = "resistance-temperature"', 'id = "phlogiston"', ["phlogiston", "resistance-temperature"]),
    ],
)  # fmt: skip
def test_a_wrong_entry_is_named_with_file_key_value_and_what_is_allowed(written, old, new, said):
    text = written.read_text()
    assert old in text
    written.write_text(text.replace(old, new, 1))
    with pytest.raises(BadInputError) as why:
        read_battery(written)
    for part in [str(written), *said]:
        assert part in str(why.value)


def test_a_file_without_a_model_is_refused(tmp_path):
    path = tmp_path / "empty.toml"
    path.write_text('name = "nothing"\n')
    with pytest.raises(BadInputError, match=r"neither a \[circ\] nor a \[chem\]"):
        read_battery(path)


def test_bare_numbers_are_taken_in_the_declared_unit(written):
    text = written.read_text().replace('r_s = {value = 0.004, sd = 0.0002, unit = "ohm"}', "r_s = 0.005")
    written.write_text(text)
    assert read_battery(written).circ.r_s == 0.005


def test_the_battery_that_ships_has_rising_curves(generic):
    soc = np.linspace(0.0, 1.0, 400)
    for cell in (generic.circ, generic.chem):
        assert np.all(np.diff(cell.open_circuit(soc)) > 0.0)
    assert generic.circ.open_circuit(1.0) == pytest.approx(4.2, abs=1e-3)


def test_a_file_of_before_models_had_errors_of_their_own_is_read(written):
    lines = written.read_text().splitlines(keepends=True)
    written.write_text("".join(line for line in lines if not line.startswith(("error_v", "load_error_v"))))
    back = read_battery(written).left_open["circ"]
    assert (back.error_v, back.load_error_v) == (None, None)
