"""The command line: `bhm replay`, `run`, `identify`, `prove`. Commands import what they need when called."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from bhm_service.allocator import keep_freed
from bhm_service.errors import BadInputError

_FILE = click.Path(path_type=Path, dir_okay=False)
_FOLDER = click.Path(path_type=Path, file_okay=False)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="bhm-service", prog_name="bhm")
def cli() -> None:
    """Remaining flying time of a multirotor's battery, onboard and from recordings."""


@cli.command()
@click.argument("logs", nargs=-1, required=True, type=_FILE, metavar="LOG...")
@click.option("-o", "--output", type=_FOLDER, required=True, help="Folder for the results; made if need be.")
@click.option("--vehicle", type=_FILE, help="Vehicle file; guessed from the log if not given, and said so.")
@click.option("--battery", type=_FILE, help="Battery file; the vehicle file's if not given.")
@click.option("--battery-id", type=click.IntRange(0, 255), help="MAVLink battery to follow; the vehicle file's.")
@click.option("--system", type=click.IntRange(1, 255), help="MAVLink system to follow; the first autopilot heard.")
@click.option("--service", type=_FILE, help="Service file: which models run, and how they predict.")
def replay(
    logs: tuple[Path, ...],
    output: Path,
    vehicle: Path | None,
    battery: Path | None,
    battery_id: int | None,
    system: int | None,
    service: Path | None,
) -> None:
    """Run recorded flights through the onboard apps.

    LOG is a telemetry log (.tlog), an ArduPilot DataFlash log (.bin), a table (.csv) or a recording of `bhm run`
    (.bhmlog), which needs no vehicle file. For each, OUTPUT gets the log
    with our messages in it (.bhm.tlog), the series (.csv) and a page of figures (.html).
    """
    from bhm_service.commands.replay import Request, replay_logs

    request = Request(
        output=output, vehicle=vehicle, battery=battery, battery_id=battery_id, system=system, service=service
    )
    sys.exit(replay_logs(logs, request))


@cli.command()
@click.option(
    "--link", "links", multiple=True, metavar="URL",
    help="serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:..., tcp:..., tcpin:...; may be given several times; "
    "the service file's if not given.",
)  # fmt: skip
@click.option("--config", type=_FILE, help="Service file; without one nothing is kept on disk.")
@click.option("--vehicle", type=_FILE, help="Vehicle file; the service file's if not given.")
@click.option("--battery", type=_FILE, help="Battery file; the service or vehicle file's if not given.")
def run(links: tuple[str, ...], config: Path | None, vehicle: Path | None, battery: Path | None) -> None:
    """Run beside an autopilot: estimate, predict, and tell the ground. Ctrl-C ends it."""
    from bhm_service.service import run_service

    sys.exit(run_service(links, config, vehicle, battery))


@cli.command()
@click.option("--link", "links", multiple=True, metavar="URL", help="As for run; the service file's if not given.")
@click.option("--config", type=_FILE, help="Service file.")
@click.option("--vehicle", type=_FILE, help="Vehicle file; the service file's if not given.")
@click.option("--battery", type=_FILE, help="Battery file; the service or vehicle file's if not given.")
@click.option("--seconds", type=click.FloatRange(0.0, 600.0), default=10.0, show_default=True,
              help="How long to listen to the vehicle; 0 looks at the computer only.")  # fmt: skip
def doctor(
    links: tuple[str, ...], config: Path | None, vehicle: Path | None, battery: Path | None, seconds: float
) -> None:
    """Look at this computer and at the vehicle on its links: what is wrong, and how to mend it.

    Stop the service first: a serial port serves one program at a time.
    """
    from bhm_service.commands.doctor import examine

    sys.exit(examine(links, config, vehicle, battery, seconds))


class _Several(click.Command):
    """An option that may be repeated also takes several values: ``--rate *.csv``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        repeatable = {name for p in self.params if isinstance(p, click.Option) and p.multiple for name in p.opts}
        spread: list[str] = []
        name, values = "", 0
        for arg in args:
            if arg.startswith("-"):
                name, values = arg, 0
            else:
                if values and name in repeatable:
                    spread.append(name)
                values += 1
            spread.append(arg)
        return super().parse_args(ctx, spread)


def _recordings(name: str, what: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    return click.option(name, multiple=True, type=_FILE, metavar="FILE...", help=what)


@cli.command(cls=_Several)
@_recordings("--slow", "Slow discharge from full to empty: capacity and open-circuit curve.")
@_recordings("--one-c", "Discharge at the rated current.")
@_recordings("--variable", "Load as in flight, or a drive cycle.")
@_recordings("--pulses", "Pulses and rests.")
@_recordings("--rate", "Discharges at other rates.")
@_recordings("--flights", "Logs of flights, alone: adapts the generic LiPo to them.")
@_recordings("--held-out", "Not fitted: shows how good the result is.")
@click.option("--oracle", is_flag=True, help="Show beside the held-out errors the best that each model could reach.")
@click.option("--series", type=click.IntRange(1, 28), help="Cells in series of the recorded voltage.")
@click.option("--model", type=click.Choice(["circ", "chem", "both"]), default="both", show_default=True)
@click.option("--ocv", type=click.Choice(["auto", "spline", "cubic"]), default="auto", show_default=True,
              help="Circ's open-circuit curve; cubic is the paper's.")  # fmt: skip
@click.option("--method", type=click.Choice(["trf", "nelder-mead"]), default="trf", show_default=True,
              help="Bounded trust region, or the paper's simplex.")  # fmt: skip
@click.option("--capacity-ah", type=click.FloatRange(0.01, 1000.0), help="Capacity, if you know better.")
@click.option("--columns", multiple=True, metavar="QUANTITY=NAME,...", help="Columns of tables: time=T,current=I ...")
@click.option("--current-unit", type=click.Choice(["A", "mA"]))
@click.option("--voltage", type=click.Choice(["pack", "cell"]), help="Whose voltage was recorded.")
@click.option("--discharge", type=click.Choice(["positive", "negative"]), help="Sign of a discharging current.")
@click.option("--battery-id", type=click.IntRange(0, 255), default=0, show_default=True, help="MAVLink battery id.")
@click.option("--name", help="Name of the pack; that of the output if not given.")
@click.option("-o", "--output", type=_FILE, required=True, help="Battery file to write.")
@click.option("--report", type=click.Path(path_type=Path), help="Page of figures, or folder for it; beside OUTPUT.")
def identify(**given: Any) -> None:
    """Identify a pack's cells from bench recordings, or from flights alone.

    Recordings are tables (.csv, .csv.gz) or logs. The paper's three experiments are --slow, --one-c and --variable;
    it works with less, and says what the recordings left open.
    """
    keep_freed()
    from bhm_service.commands.identify import identify_pack, task_of

    identify_pack(task_of(given))


@cli.command()
@click.option("--suite", "suites", multiple=True, help="exam, truth, real, development, quick or shared; repeatable.")
@click.option("--seed", type=click.IntRange(0), help="Development seed; without one an exam seed is drawn now.")
@click.option("--cases", type=click.IntRange(1), help="Cases of each suite; as many as it has.")
@click.option("--jobs", type=click.IntRange(1), default=2, show_default=True, help="Cases at a time.")
@click.option("--answerer", default="tool", show_default=True, help="tool, none, always:EFFECT, random or oracle.")
@click.option("--keep", is_flag=True, help="Keep the cases and all that was written on them.")
@click.option("-o", "--output", type=_FOLDER, help="Empty folder for the run and its score card.")
@click.option("--again", type=_FOLDER, metavar="DIR", help="Check the seal of a finished run and score it again.")
def prove(again: Path | None, **given: Any) -> None:
    """Prove `bhm explain` on concealed cases: sealed answers, verdicts without sight of them, a score card.

    The exit status is 0 when every target is met, 1 when not. The cases come from sim/.
    """
    from bhm_service.commands.prove import prove_it, score_again

    if again is not None:
        sys.exit(score_again(again))
    for name in ("suites", "output"):
        if not given[name]:
            raise click.UsageError(f"--{name.removesuffix('s')} is needed")
    sys.exit(prove_it(**given))


@cli.command()
@click.argument("logs", nargs=-1, required=True, type=_FILE, metavar="LOG...")
@click.option("--battery", type=_FILE, required=True, help="The battery file that the flights disagree with.")
@click.option(
    "--vehicle",
    type=_FILE,
    help="Vehicle file: power is held against its [rotors] and [[demand]]; cells and "
    "capacity where the battery file is of a cell only.",
)
@click.option("--sidecar", type=_FILE, help="CSV about the flights: file, rest_voltage_V, rest_minutes, cycles, "
              "storage_days, ambient_C.")  # fmt: skip
@click.option("--battery-id", type=click.IntRange(0, 255), help="MAVLink battery id. [the sidecar's, else the first]")
@click.option(
    "--model", type=click.Choice(["circ", "chem"]), help="Cell model to explain with. [circ where there is one]"
)
@click.option("--told", metavar="A+B", help="Effects to measure, as if somebody had told them: nothing is searched.")
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, metavar="DIR",
              help="Where findings and report go.")  # fmt: skip
@click.option("--install", is_flag=True, help="Put the repaired battery beside the old one, to fly in its shadow.")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
@click.option("--cores", type=click.IntRange(1, 64), help="Cores to use. [all there are]")
def explain(**given: Any) -> None:
    """Say which physics the battery file leaves out, by the flights that disagree with it.

    Writes findings.json, report.html and, where something was found, the repaired battery.toml and vehicle.toml.
    """
    keep_freed()
    from bhm_service.commands.explain import Task, explain_logs

    sys.exit(explain_logs(Task(**given)))


_SHARE = click.FloatRange(0.0, 0.9)


@cli.command()
@click.option("--link", "links", multiple=True, metavar="URL", help="udpout:, udpin:, tcpin:, tcp:HOST:PORT, or "
              "serial:PATH:BAUD, a pseudo terminal under that name. [udpout:127.0.0.1:14550]")  # fmt: skip
@click.option("--autopilot", type=click.Choice(["ardupilot", "px4"]), default="ardupilot", show_default=True)
@click.option("--system", type=click.IntRange(1, 255), default=1, show_default=True, help="MAVLink system id.")
@click.option("--cells", type=click.IntRange(1, 14), default=4, show_default=True, help="In series.")
@click.option("--capacity", type=click.FloatRange(0.1, 500.0), default=5.0, show_default=True, help="[Ah]")
@click.option("--charge", type=click.FloatRange(0.05, 1.0), default=0.97, show_default=True, help="At the start.")
@click.option("--batteries", type=click.IntRange(1, 2), default=1, show_default=True, help="Two share the load.")
@click.option("--truth", type=click.Choice(["own", "pybamm"]), default="own", show_default=True, help="The battery.")
@click.option("--power", type=click.FloatRange(10.0, 20000.0), default=240.0, show_default=True, help="Hover [W].")
@click.option("--flight", type=click.FloatRange(30.0, 7200.0), default=780.0, show_default=True, help="In the air [s].")
@click.option("--wind", type=click.FloatRange(0.0, 25.0), default=0.0, show_default=True, help="From the west [m/s].")
@click.option("--gusts", type=click.FloatRange(0.0, 10.0), default=0.0, show_default=True, help="One sigma [m/s].")
@click.option("--speed", type=click.FloatRange(0.1, 100.0), default=1.0, show_default=True, help="Seconds a second.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option("--loss", type=_SHARE, default=0.0, help="Share of frames lost.")
@click.option("--double", type=_SHARE, default=0.0, help="Share of frames sent twice.")
@click.option("--overtake", type=_SHARE, default=0.0, help="Share of frames that come late.")
@click.option("--garbage", type=_SHARE, default=0.0, help="Share of frames damaged or after noise.")
@click.option("--silence", multiple=True, metavar="BEGIN:SECONDS", help="Nothing is sent; may be given several times.")
@click.option("--reboot", type=float, multiple=True, metavar="SECOND", help="The autopilot boots; several times.")
@click.option("--signing-key", type=_FILE, help="The autopilot signs, and believes only what is signed.")
@click.option("--tlog", type=_FILE, help="Write a telemetry log instead of flying.")
@click.option("--quiet", is_flag=True, help="No words.")
def sim(**given: Any) -> None:
    """Fly a simulated multirotor that speaks MAVLink as ArduPilot or PX4 does.

    Its battery shares nothing with the models of the service. Ctrl-C ends the flight.
    """
    from sim.command import Options, simulate

    sys.exit(simulate(Options(**given)))


def main() -> None:
    """Entry point: bad input ends with one clear message and status 2."""
    # Our matrices are small: BLAS threads fight over the cores (a fit took three times as long on two).
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        cli()
    except BadInputError as why:
        click.echo(f"bhm: {why}", err=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
