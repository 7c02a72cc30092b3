"""The command line, run where the tests run."""

from __future__ import annotations

import sys

from bhm_service.cli import main


def bhm(*words):
    """Run a command in this process; it has to succeed."""
    before, sys.argv = sys.argv, ["bhm", *map(str, words)]
    try:
        main()
    except SystemExit as ended:
        assert not ended.code, words
    finally:
        sys.argv = before
