"""What systemd's notification socket hears."""

import socket
from contextlib import closing

from bhm_service.watchdog import Notifier


def test_readiness_progress_and_the_end_are_told_to_the_socket(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(str(tmp_path / "notify"))
        with closing(Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify")})) as notifier:
            notifier.ready()
            notifier.progress("RFT 5:00")
            notifier.stopping()
        assert [ear.recv(200) for _ in range(3)] == [b"READY=1", b"WATCHDOG=1\nSTATUS=RFT 5:00", b"STOPPING=1"]


def test_an_abstract_socket_is_found():
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind("\0bhm-test-notify")
        with closing(Notifier({"NOTIFY_SOCKET": "@bhm-test-notify"})) as notifier:
            notifier.ready()
        assert ear.recv(200) == b"READY=1"


def test_without_systemd_or_with_one_that_is_gone_nothing_happens(tmp_path):
    for environment in ({}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": str(tmp_path / "gone")}):
        with closing(Notifier(environment)) as notifier:
            notifier.progress("")


def test_an_ear_that_is_full_holds_nobody_up(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(str(tmp_path / "notify"))
        with closing(Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify")})) as notifier:
            for _ in range(2000):
                notifier.progress("x" * 100)
