"""Vehicle, battery and service files from what was given on the command line."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

from bhm_service.assembly import Equipment
from bhm_service.battery.battery_file import checked_battery, read_battery
from bhm_service.config import Service, Vehicle, checked, read_toml, read_vehicle
from bhm_service.errors import BadInputError
from bhm_service.recorded import Recorded


def read_service(path: Path | None) -> Service:
    """The service file, or its defaults; the key file that it names is found from where it is itself."""
    if path is None:
        return Service()
    said = checked(Service, read_toml(path), str(path))
    if said.link.signing_key is None:
        return said
    link = said.link.model_copy(update={"signing_key": path.parent / said.link.signing_key})
    return said.model_copy(update={"link": link})


def configured(config: Path | None, vehicle: Path | None, battery: Path | None) -> tuple[Equipment, Service]:
    """What the service file says, with the vehicle and battery of the command line before its own."""
    settings = read_service(config)
    folder = Path() if config is None else config.parent
    if vehicle is None:
        if settings.vehicle is None:
            where = "bhm run" if config is None else str(config)
            raise BadInputError(
                where, "which vehicle? none is given", "vehicle = FILE in the service file, or --vehicle"
            )
        vehicle = folder / settings.vehicle
        battery = battery or (None if settings.battery is None else folder / settings.battery)
    return equipment_of(vehicle, battery), settings


def equipment_of(vehicle: Path, battery: Path | None, battery_id: int | None = None) -> Equipment:
    """What a vehicle file says, with another battery or battery id if given."""
    said = read_vehicle(vehicle)
    file = vehicle.parent / said.battery.file if battery is None else battery
    if battery is None and not file.is_file():
        raise BadInputError(str(vehicle), f"battery.file = {said.battery.file!r}: no such file")
    known = read_battery(file)
    carried = Equipment(
        vehicle=_with_id(said, battery_id), battery=known, battery_text=file.read_text(encoding="utf-8")
    )  # fmt: skip
    if known.shadow is None:
        return carried
    other = file.parent / known.shadow
    if not other.is_file():
        raise BadInputError(str(file), f"shadow.file = {known.shadow!r}: no such file")
    shadow = replace(carried, battery=read_battery(other), battery_text=other.read_text(encoding="utf-8"))
    return replace(carried, shadow=shadow)


def recorded_equipment(recorded: Recorded, where: str) -> tuple[Equipment, Service] | None:
    """What a flight recording was made with; None where its head is damaged."""
    head = recorded.head
    if not {"vehicle", "battery", "service"} <= head.keys():
        return None
    vehicle = checked(Vehicle, head["vehicle"], f"{where}, vehicle")
    equipment = _recorded_with(vehicle, head["battery"], where)
    if head.get("shadow"):
        equipment = replace(equipment, shadow=_recorded_with(vehicle, head["shadow"], where))
    return equipment, checked(Service, head["service"], f"{where}, service file")


def _recorded_with(vehicle: Vehicle, text: str, where: str) -> Equipment:
    try:
        tables = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, TypeError) as why:
        raise BadInputError(where, f"its battery file cannot be read: {why}") from None
    return Equipment(vehicle=vehicle, battery=checked_battery(tables, f"{where}, battery file"), battery_text=text)


def _with_id(vehicle: Vehicle, battery_id: int | None) -> Vehicle:
    if battery_id is None:
        return vehicle
    return vehicle.model_copy(update={"battery": vehicle.battery.model_copy(update={"id": battery_id})})
