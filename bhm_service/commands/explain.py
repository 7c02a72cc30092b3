"""`bhm explain`: flights that disagree with a battery in, the physics that was left out of it out."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomlkit
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from bhm_service.assembly import Equipment
from bhm_service.battery.battery_file import BatteryFile, ModelName, read_battery, write_battery
from bhm_service.battery.effects import EFFECTS
from bhm_service.config import read_vehicle
from bhm_service.discrepancy.cores import available
from bhm_service.discrepancy.demand_side import DemandSide
from bhm_service.discrepancy.explain import Request, explain
from bhm_service.discrepancy.explanation import Explanation
from bhm_service.discrepancy.findings import write_findings
from bhm_service.discrepancy.flights import read_flights
from bhm_service.discrepancy.lab_file import lab_of
from bhm_service.discrepancy.sidecar import read_sidecar
from bhm_service.errors import BadInputError
from bhm_service.prediction.demand_file import known_demand, with_demand
from bhm_service.reporting.explained import explained_lines, explained_page
from bhm_service.units import SECONDS_PER_HOUR

_WIDTH = 100
_PAGE = "report.html"
_STEPS = 10  # that the search announces, about


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """What was asked for on the command line."""

    logs: tuple[Path, ...]
    battery: Path
    output: Path
    vehicle: Path | None = None
    sidecar: Path | None = None
    battery_id: int | None = None
    model: ModelName | None = None
    install: bool = False
    as_json: bool = False
    told: str | None = None  # effects, joined by +
    cores: int | None = None  # to use; all that there are


def explain_logs(task: Task) -> int:
    """Explain, write and say. Raises BadInputError for what cannot be explained; returns the exit status."""
    out, err = Console(width=_WIDTH, highlight=False), Console(stderr=True, width=_WIDTH, highlight=False)
    battery = read_battery(task.battery)
    model: ModelName = task.model or ("circ" if battery.circ is not None else "chem")
    vehicle = read_vehicle(task.vehicle) if task.vehicle is not None else None
    if vehicle is not None:
        known_demand(vehicle, str(task.vehicle))  # a wrong table is said now, not after the search
    series = vehicle.battery.series if vehicle is not None else None
    ampere_hours = vehicle.battery.capacity_ah if vehicle is not None else None
    capacity_c = None if ampere_hours is None else ampere_hours * SECONDS_PER_HOUR
    lab = lab_of(battery, model, series, capacity_c)
    for remark in () if vehicle is None else Equipment(vehicle=vehicle, battery=battery).remarks:
        err.print(remark, markup=False)
    notes = read_sidecar(task.sidecar) if task.sidecar is not None else {}
    told = _known_effects(task.told)
    _make(task.output)
    battery_id = task.battery_id if task.battery_id is not None else (vehicle.battery.id if vehicle else None)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True) as bar:
        shown = bar.add_task("reading", total=_STEPS + 1)

        def progress(what: str) -> None:
            bar.update(shown, description=what, advance=1)

        flights, left_out = read_flights(task.logs, lab.series, lab.capacity_c, notes, battery_id)
        found = explain(
            Request(
                battery=battery,
                flights=flights,
                left_out=left_out,
                model=model,
                series=series,
                capacity_c=capacity_c,
                vehicle=vehicle,
                told=told,
                cores=task.cores or available(),
            ),
            progress,
        )
    found = _written(task, found)
    if task.as_json:
        out.print_json(json.dumps(found.joined.model_dump(mode="json")))
    else:
        for line in explained_lines(found):
            out.print(line)
        out.print(f"written: findings.json and {_PAGE} in {task.output}", markup=False, soft_wrap=True)
    if task.install:
        said = "nothing to install" if found.repaired is None else f"installed: {install(task, found.repaired)}"
        err.print(said, markup=False, soft_wrap=True)
    return 0


def _known_effects(told: str | None) -> frozenset[str]:
    """The battery effects that were told. Raises BadInputError for a name that is none of the pack's."""
    names = frozenset(name.strip() for name in told.split("+")) if told is not None else frozenset[str]()
    for name in sorted(names - set(EFFECTS)):
        raise BadInputError("bhm explain --told", f"no effect of a pack is called {name!r}", ", ".join(EFFECTS))
    return names


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as why:
        raise BadInputError(str(folder), f"cannot be made: {why.strerror}") from why


def _written(task: Task, found: Explanation) -> Explanation:
    """Writes everything; the same explanation, which now knows its battery file."""
    findings = found.findings
    if found.repaired is not None:
        name = "battery.toml"
        write_battery(task.output / name, found.repaired)
        findings = findings.model_copy(update={"battery_file": name})
    for course in found.courses:
        if course.hidden:
            _write_hidden(task.output / "hidden" / f"{course.flight.label}.csv", course.flight.time_s, course.hidden)
    found = replace(found, findings=findings)
    write_findings(task.output / "findings.json", found.joined)
    if task.vehicle is not None and isinstance(found.demand, DemandSide) and found.demand.repaired is not None:
        text = with_demand(task.vehicle.read_text(encoding="utf-8"), found.demand.repaired, found.demand.efficiency)
        (task.output / "vehicle.toml").write_text(text, encoding="utf-8")
    (task.output / _PAGE).write_text(explained_page(found), encoding="utf-8")
    return found


def install(task: Task, battery: BatteryFile) -> Path:
    """Put the repaired battery beside the old one, which names it as its shadow; named by data and model.

    `bhm run` flies it in the shadow of the old for two flights, and takes it up only when it has predicted better.
    """
    document = tomlkit.parse(task.battery.read_text(encoding="utf-8"))
    document.pop("shadow", None)
    digest = hashlib.sha256(tomlkit.dumps(document).rstrip().encode())
    for log in sorted(task.logs):
        digest.update(log.read_bytes())
    beside = task.battery.with_name(f"{task.battery.stem}-{digest.hexdigest()[:12]}.toml")
    write_battery(beside, replace(battery, shadow=None))
    document["shadow"] = {"file": beside.name}
    fresh = task.battery.with_name(f".{task.battery.name}.new")
    fresh.write_text(tomlkit.dumps(document), encoding="utf-8")
    fresh.replace(task.battery)
    return beside


def _write_hidden(path: Path, time_s: np.ndarray, hidden: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """One flight's hidden states: time_s, then each state and its standard deviation; temperatures in kelvin."""
    path.parent.mkdir(parents=True, exist_ok=True)
    names = [n for state in hidden for n in (_column(state), f"{_column(state)}_sd")]
    table = np.column_stack([time_s, *(part for state in hidden.values() for part in state)])
    np.savetxt(path, table, delimiter=",", header=",".join(["time_s", *names]), comments="", fmt="%.4f")


def _column(state: str) -> str:
    return f"{state}_K" if state == "temperature" else state
