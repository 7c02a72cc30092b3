"""The computer: its clock, the place for what is kept, the signing key, serial ports and those who hold them."""

from __future__ import annotations

import grp
import os
import shutil
import stat
from datetime import UTC, datetime
from pathlib import Path

from bhm_service.config import Service
from bhm_service.doctor.finding import Finding, bad, doubtful, good
from bhm_service.errors import BadInputError
from bhm_service.mavlink.signing import Signer, read_key
from bhm_service.mavlink.transport import LinkUrl

_NET = Path("/proc/net")


def machine(settings: Service, urls: tuple[LinkUrl, ...], state: Path, unix_s: float) -> list[Finding]:
    """Everything about the computer that can be known without a vehicle."""
    found = [clock(unix_s, settings.link.signing_key is not None)]
    if settings.link.signing_key is not None:
        found.append(key(settings.link.signing_key))
    if settings.checkpoint.file is not None or settings.recorder.folder is not None:
        found.append(place(state, settings.recorder.size_mb * 1e6 if settings.recorder.folder is not None else 1e6))
    found += [serial(Path(url.target)) for url in urls if url.kind == "serial"]
    found += [port(url) for url in urls if url.kind in ("udpin", "tcpin")]
    return found


def clock(unix_s: float, signing: bool) -> Finding:
    """A clock that was never set refuses every signature; else only dates of files are wrong."""
    day = datetime.fromtimestamp(max(unix_s, 0.0), UTC).strftime("%Y-%m-%d")
    if Signer.clock_is_set(unix_s):
        return good(f"the clock is set: {day}")
    mend = "timedatectl set-ntp true, or a clock module (RTC); without a network fit one"
    if signing:
        return bad(f"the clock says {day}: nothing can be signed or believed with it", mend)
    return doubtful(f"the clock says {day}: dates of recordings will be wrong", mend)


def key(path: Path) -> Finding:
    """The signing key."""
    try:
        read_key(path)
    except BadInputError as why:
        return bad(why.problem, why.hint or "see README, signing")
    return good(f"signing key {path}")


def place(folder: Path, needed_bytes: float) -> Finding:
    """Room and permission for checkpoint and recordings."""
    there = folder
    while not there.exists():
        there = there.parent
    if not there.is_dir() or not os.access(there, os.W_OK):
        return bad(f"{folder} cannot be written by this user", "run as the service's user, or see StateDirectory=")
    free = shutil.disk_usage(there).free
    if free < needed_bytes:
        words = f"{folder}: {free / 1e6:.0f} MB free, recordings may take {needed_bytes / 1e6:.0f} MB"
        return doubtful(words, "make room, or lower recorder.size_mb")
    return good(f"{folder} can be written, {free / 1e9:.1f} GB free")


def serial(device: Path) -> Finding:
    """A serial port: there, ours to open, and nobody else's."""
    if not device.exists():
        return bad(f"{device}: no such device", _ports_there())
    status = device.stat()
    if not stat.S_ISCHR(status.st_mode):
        return bad(f"{device} is not a serial port", _ports_there())
    if not os.access(device, os.R_OK | os.W_OK):
        try:
            group = grp.getgrgid(status.st_gid).gr_name
        except KeyError:
            group = "dialout"
        return bad(f"{device}: permission denied", f"sudo usermod -aG {group} $USER, then log in again")
    holders = holding(device.resolve())
    if holders:
        mend = "; ".join(_MENDS.get(name, f"stop {name}") for name in sorted(set(holders)))
        return bad(f"{device} is open in {', '.join(sorted(set(holders)))}", mend)
    return good(f"{device} is there and may be opened")


_MENDS = {
    "ModemManager": "sudo apt remove modemmanager, or install systemd/60-bhm-serial.rules",
    "agetty": "sudo raspi-config: no login shell over serial; or systemctl disable --now serial-getty@...",
    "bhm": "sudo systemctl stop bhm",
    "mavproxy.py": "stop MAVProxy, or let both use mavlink-router",
    "mavlink-routerd": "let the service use one of the router's UDP endpoints",
}


def _ports_there() -> str:
    ports = sorted(str(p) for kind in ("ttyUSB*", "ttyACM*", "ttyAMA*", "ttyS0") for p in Path("/dev").glob(kind))
    if not ports:
        return "plug the adapter in; on a Raspberry Pi enable_uart=1 in config.txt"
    return f"there are: {', '.join(ports)}"


def holding(path: Path) -> list[str]:
    """Names of the programs, other than this one, that have a file open; only those that this user may look into."""
    return [_program(process) for process in _processes() if _has_open(process, str(path))]


def port(url: LinkUrl) -> Finding:
    """A UDP or TCP port of ours: whether somebody else has it."""
    kind = url.kind.removesuffix("in")
    sockets = _bound(kind, url.number)
    if not sockets:
        return good(f"{kind.upper()} port {url.number} is free")
    programs = {_program(p) for p in _processes() if any(_has_open(p, f"socket:[{inode}]") for inode in sockets)}
    who = ", ".join(sorted(programs)) or "another program"
    mend = "; ".join(sorted(_MENDS.get(name, f"stop {name}, or use another port") for name in programs))
    return bad(f"{kind.upper()} port {url.number} is open in {who}", mend or "sudo ss -lunp shows which")


def _bound(kind: str, number: int) -> set[str]:
    """Inodes of the sockets that listen on a port."""
    inodes: set[str] = set()
    for table in (kind, f"{kind}6"):
        try:
            lines = (_NET / table).read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for fields in map(str.split, lines):
            listens = kind == "udp" or fields[3] == "0A"
            if listens and int(fields[1].rpartition(":")[2], 16) == number:
                inodes.add(fields[9])
    return inodes


def _processes() -> list[Path]:
    return [p for p in Path("/proc").iterdir() if p.name.isdigit() and p.name != str(os.getpid())]


def _has_open(process: Path, target: str) -> bool:
    try:
        return any(str(link.readlink()) == target for link in (process / "fd").iterdir())
    except OSError:
        return False


def _program(process: Path) -> str:
    try:
        words = (process / "cmdline").read_bytes().split(b"\0")
        names = [Path(word.decode("utf-8", "replace")).name for word in words if word]
    except OSError:
        return "another program"
    if names and names[0].startswith("python") and len(names) > 1:
        rest = [name for name in names[1:] if not name.startswith("-")]
        return "bhm" if rest and rest[0] in ("bhm_service.cli", "bhm") else (rest[0] if rest else names[0])
    return names[0] if names else "another program"
