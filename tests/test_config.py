from dataclasses import replace

import pytest

from bhm_service.assembly import Equipment
from bhm_service.battery.battery_file import read_battery
from bhm_service.config import BatterySettings, Service, Vehicle, read_vehicle, shipped
from bhm_service.equipment import configured, equipment_of, read_service
from bhm_service.errors import BadInputError
from bhm_service.messages import Model

VEHICLES = sorted(shipped("vehicles").glob("*.toml"))


@pytest.mark.parametrize("path", VEHICLES, ids=lambda p: p.stem)
def test_every_vehicle_that_ships_is_complete(path):
    equipment = equipment_of(path, None)
    assert equipment.series in (4, 6)
    for model in Model:
        equipment.tracker(model)
    assert 100.0 < equipment.hover().mean_w < 4000.0


def test_the_service_file_that_ships_says_the_defaults():
    said = read_service(shipped("service.toml"))
    assert said == Service(vehicle=said.vehicle)


def test_the_service_file_that_ships_names_a_vehicle_that_ships():
    equipment, _ = configured(shipped("service.toml"), None, None)
    assert equipment.vehicle.name == "Generic 4S quadrotor"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", ["which vehicle?", "--vehicle"]),
        ("[reserves]\ncritical_s = 200.0\n", ["reserves", "critical_s must not be more than warning_s"]),
        ("[reserves]\nwarnings_s = 200.0\n", ["unknown key 'reserves.warnings_s'", "did you mean 'warning_s'"]),
        ("[checkpoint]\nmax_age_s = 9000\n", ["checkpoint.max_age_s = 9000", "less than or equal to 600"]),
        ("[recorder]\nsize_mb = 0\n", ["recorder.size_mb = 0"]),
        ("[link]\nurls = []\n", ["link.urls"]),
    ],
)
def test_a_wrong_entry_of_the_service_file_is_named(tmp_path, text, said):
    path = tmp_path / "service.toml"
    path.write_text(text)
    with pytest.raises(BadInputError) as why:
        configured(path, None, None)
    for part in [str(path), *said]:
        assert part in str(why.value)


def test_an_empty_name_turns_checkpoint_and_recorder_off(tmp_path):
    path = tmp_path / "service.toml"
    path.write_text('[checkpoint]\nfile = ""\n[recorder]\nfolder = ""\n')
    settings = read_service(path)
    assert settings.checkpoint.file is None
    assert settings.recorder.folder is None


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "vehicle.toml"
    text = shipped("vehicles", "quad-4s.toml").read_text()
    path.write_text(text.replace("../batteries/generic-lipo.toml", str(shipped("batteries", "generic-lipo.toml"))))
    return path


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("series = 4", "serie = 4", ["unknown key 'battery.serie'", "did you mean 'series'"]),
        ("series = 4", "series = 40", ["battery.series = 40", "less than or equal to 28"]),
        ("capacity_ah = 5.0", 'capacity_ah = "five"', ["battery.capacity_ah = 'five'", "valid number"]),
        ("capacity_ah = 5.0", "capacity_ah = -5.0", ["battery.capacity_ah = -5.0", "greater than 0.05"]),
        ("threshold_soc = 0.20", "threshold_soc = 20", ["battery.threshold_soc = 20", "less than or equal to 0.9"]),
        ("rotors = 4", "rotors = 0", ["rotors.rotors = 0"]),
        ("mass_kg = 2.0", "", ["'rotors.mass_kg' is missing"]),
        ('name = "Generic 4S quadrotor"', "name = ", ["not valid TOML", "line 2"]),
        ("generic-lipo.toml", "no-such-pack.toml", ["battery.file", "no such file"]),
    ],
)
def test_a_wrong_entry_is_named_with_file_key_value_and_what_is_allowed(written, old, new, said):
    text = written.read_text()
    assert old in text
    written.write_text(text.replace(old, new, 1))
    with pytest.raises(BadInputError) as why:
        equipment_of(written, None)
    for part in [str(written), *said]:
        assert part in str(why.value)


def test_every_fault_of_a_file_is_told_at_once(written):
    written.write_text(written.read_text().replace("series = 4", "serie = 4").replace("cutoff_v = 3.3", "cutoff_v = 9"))
    with pytest.raises(BadInputError) as why:
        read_vehicle(written)
    assert "battery.serie" in str(why.value)
    assert "battery.cutoff_v = 9" in str(why.value)


def test_a_missing_file_and_a_binary_one_are_told_apart(tmp_path):
    with pytest.raises(BadInputError, match="no such file"):
        read_vehicle(tmp_path / "none.toml")
    (tmp_path / "bin.toml").write_bytes(bytes(range(128, 256)))
    with pytest.raises(BadInputError, match="not text"):
        read_vehicle(tmp_path / "bin.toml")
    with pytest.raises(BadInputError, match=r"directory|read"):
        read_vehicle(tmp_path)


def test_a_cell_needs_to_be_told_how_many_there_are(written):
    written.write_text(written.read_text().replace("series = 4             # cells in series\n", ""))
    with pytest.raises(BadInputError, match=r"battery\.series is missing"):
        _ = equipment_of(written, None).series


def test_each_model_has_the_charge_of_its_own_cell_where_the_vehicle_says_none():
    """A repaired battery has a capacity for each: the flights showed it with each model a little otherwise."""
    own = read_battery(shipped("batteries", "generic-lipo.toml"))
    repaired = replace(own, series=6, circ=replace(own.circ, c_max=1.01 * own.circ.c_max))
    settings = BatterySettings(file="repaired.toml")
    equipment = Equipment(vehicle=Vehicle(name="hexa", battery=settings), battery=repaired)
    for model, cell in ((Model.CIRC, repaired.circ), (Model.CHEM, own.chem)):
        assert equipment.tracker(model).pack.capacity_c == pytest.approx(float(cell.capacity_c), rel=1e-9)


def test_capacity_and_its_doubt_come_from_the_vehicle_file(written):
    vehicle = read_vehicle(written)
    equipment = Equipment(vehicle=vehicle, battery=read_battery(shipped("batteries", "generic-lipo.toml")))
    tracker = equipment.tracker(Model.CIRC)
    assert tracker.pack.capacity_c == pytest.approx(5.0 * 3600.0)
    assert tracker.uncertainty.capacity == pytest.approx(0.05)


@pytest.mark.parametrize(("label_ah", "remarks"), [(5.0, 1), (4.6, 0)])
def test_a_pack_that_was_identified_has_its_own_capacity_and_not_that_of_the_label(written, label_ah, remarks):
    written.write_text(written.read_text().replace("capacity_ah = 5.0", f"capacity_ah = {label_ah}"))
    cell = read_battery(shipped("batteries", "generic-lipo.toml"))
    known = replace(cell.uncertainty, capacity=0.01)
    pack = replace(cell, name="mine", series=4, circ=replace(cell.circ, c_max=4.6 * 3600.0), uncertainty=known)
    equipment = Equipment(vehicle=read_vehicle(written), battery=pack)
    tracker = equipment.tracker(Model.CIRC)
    assert tracker.pack.capacity_c == pytest.approx(4.6 * 3600.0)
    assert tracker.pack.parallel == 1.0
    assert tracker.uncertainty.capacity == 0.01
    assert len(equipment.remarks) == remarks
    assert all(part in " ".join(equipment.remarks) for part in ("5", "mine", "4.6 Ah") if remarks)


def test_a_pack_of_other_cells_than_the_vehicle_has_is_refused_and_one_cell_of_a_bench_is_built_from(written):
    cell = read_battery(shipped("batteries", "generic-lipo.toml"))
    vehicle = read_vehicle(written)
    with pytest.raises(BadInputError, match="mine: is a pack of 6 cells, and Generic 4S quadrotor has 4 in series"):
        _ = Equipment(vehicle=vehicle, battery=replace(cell, name="mine", series=6)).series
    built = Equipment(vehicle=vehicle, battery=replace(cell, series=1))
    assert (built.series, built.capacity_c) == (4, pytest.approx(5.0 * 3600.0))


def test_a_signing_key_is_found_from_where_the_service_file_is(tmp_path):
    path = tmp_path / "service.toml"
    path.write_text('[link]\nsigning_key = "keys/mine.key"\n')
    assert read_service(path).link.signing_key == tmp_path / "keys" / "mine.key"
    path.write_text('[link]\nsigning_key = "/etc/bhm/mavlink.key"\n')
    assert str(read_service(path).link.signing_key) == "/etc/bhm/mavlink.key"


def test_a_battery_file_may_name_another_that_flies_in_its_shadow(written, tmp_path):
    text = shipped("batteries", "generic-lipo.toml").read_text()
    (tmp_path / "new.toml").write_text(text)
    (tmp_path / "old.toml").write_text(text + '\n[shadow]\nfile = "new.toml"\n')
    equipment = equipment_of(written, tmp_path / "old.toml")
    assert equipment.shadow.battery_text == text
    assert equipment.shadow.vehicle == equipment.vehicle
    assert equipment.shadow.shadow is None
    alone = equipment_of(written, tmp_path / "new.toml")
    assert alone.shadow is None
    assert alone.fingerprint(Service()) != equipment.fingerprint(Service())
    (tmp_path / "new.toml").unlink()
    with pytest.raises(BadInputError, match=r"shadow.file = 'new.toml': no such file"):
        equipment_of(written, tmp_path / "old.toml")
