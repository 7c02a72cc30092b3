"""The command line: `bhm replay`, `bhm run`. Commands import what they need when they are called."""

from __future__ import annotations

import sys
from pathlib import Path

import click

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

    LOG is a telemetry log (.tlog), an ArduPilot DataFlash log (.bin) or a table (.csv). For each, OUTPUT gets the log
    with our messages in it (.bhm.tlog), the series (.csv) and a page of figures (.html).
    """
    from bhm_service.commands.replay import Request, replay_logs

    request = Request(
        output=output, vehicle=vehicle, battery=battery, battery_id=battery_id, system=system, service=service
    )
    sys.exit(replay_logs(logs, request))


@cli.command()
@click.option("--link", default="udpin:127.0.0.1:14550", show_default=True, help="udpin:HOST:PORT, udpout:HOST:PORT.")
@click.option("--vehicle", type=_FILE, required=True, help="Vehicle file.")
@click.option("--battery", type=_FILE, help="Battery file; the vehicle file's if not given.")
@click.option("--service", type=_FILE, help="Service file: which models run, and how they predict.")
def run(link: str, vehicle: Path, battery: Path | None, service: Path | None) -> None:
    """Run beside an autopilot: estimate, predict, and tell the ground. Ctrl-C ends it."""
    from bhm_service.service import run_service

    sys.exit(run_service(link, vehicle, battery, service))


def main() -> None:
    """Entry point: bad input ends with one clear message and status 2."""
    try:
        cli()
    except BadInputError as why:
        click.echo(f"bhm: {why}", err=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
