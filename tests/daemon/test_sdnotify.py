"""What the service tells systemd arrives as systemd reads it, and nobody listening is no trouble."""

import os
import secrets
import socket
import time

import pytest

from hil.daemon.sdnotify import Notifier


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    """A service manager's socket, and the environment that points at it."""
    name = f"hil-test-{secrets.token_hex(6)}"
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(path if request.param == "path" else f"\0{name}")
        sock.settimeout(1.0)
        yield sock, {"NOTIFY_SOCKET": path if request.param == "path" else f"@{name}"}


def test_each_message_is_one_datagram_of_assignments(manager):
    sock, environment = manager
    with Notifier(environment) as notifier:
        notifier.ready("motorcycle is parked")
        notifier.status("engaged, cue from simulator")
        notifier.alive()
        notifier.stopping("parking")
        heard = [sock.recv(4096).decode() for _ in range(4)]
    assert heard == [
        "READY=1\nSTATUS=motorcycle is parked",
        "STATUS=engaged, cue from simulator",
        "WATCHDOG=1",
        "STOPPING=1\nSTATUS=parking",
    ]


def test_a_status_cannot_smuggle_in_an_assignment(manager):
    sock, environment = manager
    with Notifier(environment) as notifier:
        notifier.status("a rig called\nMAINPID=1")
        assert sock.recv(4096).decode() == "STATUS=a rig called MAINPID=1"


@pytest.mark.parametrize("address", ["", "relative", "/nowhere/at/all", "@nobody-listens-here"])
def test_without_a_manager_nothing_happens(address):
    with Notifier({"NOTIFY_SOCKET": address}) as notifier:
        notifier.ready("up")
        notifier.alive()


def test_a_manager_that_does_not_read_never_blocks_the_loop(manager):
    _, environment = manager
    with Notifier(environment) as notifier:
        start_s = time.perf_counter()
        for _ in range(2000):
            notifier.alive()
        assert time.perf_counter() - start_s < 1.0


@pytest.mark.parametrize(
    ("period", "pid", "expected"),
    [
        ("3000000", "", 1.5),
        ("3000000", "self", 1.5),
        ("3000000", "1", None),
        ("0", "", None),
        ("soon", "", None),
        ("", "", None),
    ],
)
def test_the_watchdog_is_fed_at_half_its_period(period, pid, expected):
    pid = str(os.getpid()) if pid == "self" else pid
    with Notifier({"WATCHDOG_USEC": period, "WATCHDOG_PID": pid}) as notifier:
        assert notifier.watchdog_s == expected
