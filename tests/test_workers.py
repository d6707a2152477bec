"""Worker processes end when whoever started them does: at its end, by a signal, by a kill."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from hil.workers import worker_pool

BUSY = """
import os, time
from hil.workers import worker_pool

def sleep():
    print(os.getpid(), flush=True)
    time.sleep(60)

if __name__ == "__main__":
    with worker_pool(2) as pool:
        for future in [pool.submit(sleep), pool.submit(sleep)]:
            future.result()
"""
PATIENCE_S = 10.0


def lives(pid):
    """Whether a process runs; one that has ended may wait for long until somebody takes note of it."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def ended(pids):
    """Whether all `pids` are gone before patience is."""
    until = time.monotonic() + PATIENCE_S
    while any(map(lives, pids)) and time.monotonic() < until:
        time.sleep(0.02)
    return not any(map(lives, pids))


@pytest.fixture
def busy(tmp_path):
    """A process with two workers that would sleep for a minute, and their numbers."""
    (tmp_path / "busy.py").write_text(BUSY)
    with subprocess.Popen(
        [sys.executable, tmp_path / "busy.py"], stdout=subprocess.PIPE, text=True
    ) as parent:
        pids = [int(parent.stdout.readline()) for _ in range(2)]
        yield parent, pids
        parent.kill()
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_a_parent_that_is_killed(busy, number):
    parent, pids = busy
    parent.send_signal(number)
    assert parent.wait(PATIENCE_S) == -number
    assert ended(pids)


def test_workers_end_at_once_where_the_parent_is_interrupted():
    pids = []

    def interrupted():
        with worker_pool(1) as pool:
            pids.append(pool.submit(os.getpid).result())
            pool.submit(time.sleep, 60.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert ended(pids)


def test_ctrl_c_is_the_parents_to_answer():
    with worker_pool(1) as pool:
        pid = pool.submit(os.getpid).result()
        os.kill(pid, signal.SIGINT)
        assert pool.submit(os.getpid).result() == pid
