"""What the gateway does on the network, whoever else is there and however badly they behave."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from hil.daemon.zenoh_session import INBOX, Inbox, RigSession, client_identity
from tests.daemon.gateway_rig import free_port, plain, rig_at

STUCK = """
import sys, time, zenoh
from hil.client import zenoh_config
session = zenoh.open(zenoh_config("client", (), (sys.argv[1],)))
held = session.declare_subscriber("hil/**", lambda sample: None)
print("here", flush=True)
time.sleep(60)
"""


@contextmanager
def stuck_subscriber(endpoint):
    """A client that has subscribed to everything and then hangs."""
    process = subprocess.Popen(
        [sys.executable, "-c", STUCK, endpoint], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "here\n"
        process.send_signal(signal.SIGSTOP)
        yield
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def opened(rig):
    """A session that has declared everything and listens to nobody; within a running loop."""
    session = RigSession(rig)
    session.declare(
        {},
        on_cue=lambda arrival: None,
        on_query=lambda query: None,
        on_client=lambda change: None,
    )
    return session


def test_a_subscriber_that_hangs_never_holds_up_a_publication(tmp_path):
    rig = rig_at(free_port(), tmp_path)

    async def publish() -> tuple[float, float]:
        session = opened(rig)
        try:
            with stuck_subscriber(rig.zenoh.listen[0]):
                slowest_s = 0.0
                begin_s = time.monotonic()
                for _ in range(800):  # 48 MB: more than sockets and queues on the way hold
                    start_s = time.monotonic()
                    session.publish("state", b"x" * 60_000, is_stream=True)
                    slowest_s = max(slowest_s, time.monotonic() - start_s)
                return slowest_s, time.monotonic() - begin_s
        finally:
            session.close()

    slowest_s, took_s = asyncio.run(publish())
    assert slowest_s < 0.1
    assert took_s < 2.0


def test_one_hung_subscriber_does_not_silence_the_others(tmp_path):
    rig = rig_at(free_port(), tmp_path)

    async def publish() -> None:
        session = opened(rig)
        try:
            with stuck_subscriber(rig.zenoh.listen[0]), plain(rig.zenoh.listen[0]) as client:
                seen = client.subscribe("state")
                await asyncio.sleep(0.05)
                for _ in range(400):
                    session.publish("state", b'"' + b"x" * 60_000 + b'"', is_stream=True)
                end_s = time.monotonic() + 1.5
                while "now" not in seen:
                    assert time.monotonic() < end_s
                    session.publish("state", b'"now"', is_stream=True)
                    await asyncio.sleep(0.01)
        finally:
            session.close()

    asyncio.run(publish())


def test_nothing_listens_beyond_the_endpoints_of_the_rig_file(tmp_path):
    """No multicast scouting, no gossip: every socket of the session is the one TCP listener."""
    rig = rig_at(free_port(), tmp_path)
    script = (
        "import asyncio, sys\n"
        "from tests.daemon.gateway_rig import rig_at\n"
        "from tests.daemon.test_zenoh_session import opened\n"
        "from pathlib import Path\n"
        "async def main():\n"
        f"    session = opened(rig_at({rig.zenoh.listen[0].rpartition(':')[2]}, Path('.')))\n"
        "    print('up', flush=True)\n"
        "    sys.stdin.read()\n"
        "    session.close()\n"
        "asyncio.run(main())\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "up\n"
        listening = internet_sockets(process.pid)
    finally:
        process.communicate()
    assert listening == [("tcp", "0100007F", int(rig.zenoh.listen[0].rpartition(":")[2]))]


def internet_sockets(pid):
    """(protocol, address, port) of each internet socket of a process, from /proc."""
    from pathlib import Path

    inodes = set()
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        target = str(fd.readlink())
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    found = []
    for protocol in ("tcp", "udp", "tcp6", "udp6"):
        for line in Path(f"/proc/{pid}/net/{protocol}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes:
                address, port = fields[1].split(":")
                found.append((protocol, address, int(port, 16)))
    return found


def test_an_inbox_takes_so_many_and_no_more_while_the_loop_is_busy():
    async def fill() -> tuple[list[int], int]:
        seen: list[int] = []
        inbox = Inbox(asyncio.get_running_loop(), seen.append)
        taken = await asyncio.to_thread(lambda: None) or [inbox.put(k) for k in range(INBOX + 5)]
        assert taken == [True] * INBOX + [False] * 5
        await asyncio.sleep(0.01)
        return seen, inbox.dropped

    seen, dropped = asyncio.run(fill())
    assert seen == list(range(INBOX))
    assert dropped == 5


def test_an_inbox_outlives_its_loop():
    async def make() -> Inbox:
        return Inbox(asyncio.get_running_loop(), print)

    assert asyncio.run(make()).put(1)


@pytest.mark.parametrize(
    ("name", "zid", "identity"),
    [
        (b"sim", "", "sim"),
        (b"sim", "9ce05bc440cb6659", "sim@9ce05bc4"),
        (b"", "9ce05bc440cb6659", "@9ce05bc4"),
        (b"", "", "anonymous"),
        (b"a\nb/c;d\x00", "", "abcd"),
        (b"\xff\xfe", "", "anonymous"),
        (b"x" * 10_000, "9ce05bc440cb6659", "x" * 20 + "@9ce05bc4"),
        ("ü".encode() * 30, "", "ü" * 10),
    ],
)
def test_who_sent_a_cue_is_told_in_a_short_clean_word(name, zid, identity):
    assert client_identity(name, zid) == identity
    assert len(client_identity(name, zid).encode()) <= 32
