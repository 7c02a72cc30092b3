"""`make run`: the simulated vehicle flies over loopback UDP while the service beside it says what it thinks."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from pathlib import Path

_LINK = "127.0.0.1:14550"
_VEHICLE = Path(__file__).parent.parent / "config" / "vehicles" / "quad-4s.toml"


def main() -> int:
    """Start both, end both; the exit status is the service's."""
    service = [sys.executable, "-m", "bhm_service.cli", "run", "--link", f"udpin:{_LINK}", "--vehicle", str(_VEHICLE)]
    vehicle = [sys.executable, "-m", "bhm_service.cli", "sim", "--quiet", "--link", f"udpout:{_LINK}"]
    with subprocess.Popen(service) as listening, subprocess.Popen(vehicle) as flying:
        try:
            while listening.poll() is None and flying.poll() is None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    listening.wait(timeout=0.5)
        except KeyboardInterrupt:
            pass  # both have had the same Ctrl-C
        for process in (listening, flying):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
    return listening.returncode


if __name__ == "__main__":
    sys.exit(main())
