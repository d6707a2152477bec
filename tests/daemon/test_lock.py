"""One daemon a rig and bus, told by name; a dead one never blocks the next."""

import os
import secrets
import subprocess
import sys

import pytest

from hil.daemon.lock import RigLock
from hil.errors import RigInUse

HOLD = """
import sys
from hil.daemon.lock import RigLock
with RigLock(sys.argv[1], sys.argv[2]):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def rig():
    """A name that no other test run uses: locks are the machine's."""
    return f"rig_{secrets.token_hex(4)}"


@pytest.fixture
def holder(rig):
    """Another process that runs the rig on can7."""
    bus = f"socketcan:{rig}"
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, rig, bus],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdin is not None
    assert process.stdout.readline() == "held\n"
    yield process, bus
    process.kill()
    process.wait()
    process.stdin.close()
    process.stdout.close()


def test_a_second_daemon_is_refused_and_told_which_process_has_the_rig(rig, holder):
    process, bus = holder
    with pytest.raises(RigInUse, match=rf"bus {bus} is already run .*process {process.pid}"):
        RigLock(rig, bus).acquire()


def test_another_rig_on_the_same_bus_is_refused(rig, holder):
    _, bus = holder
    with pytest.raises(RigInUse, match="bus"):
        RigLock("another", bus).acquire()


def test_the_same_rig_on_another_real_bus_is_refused_and_that_bus_stays_free(rig, holder):
    with pytest.raises(RigInUse, match=f"rig {rig}"):
        RigLock(rig, f"socketcan:{rig}_b").acquire()
    with RigLock("another", f"socketcan:{rig}_b"):
        pass


def test_a_killed_daemon_leaves_no_lock(rig, holder):
    process, bus = holder
    process.kill()
    process.wait()
    with RigLock(rig, bus):
        pass


def test_simulated_rigs_of_one_name_run_side_by_side_on_hubs_of_their_own(rig, tmp_path):
    one, two = (
        f"hub:{tmp_path / name}" for name in ("long/" * 30 + "a.sock", "long/" * 30 + "b.sock")
    )
    with RigLock(rig, one), RigLock(rig, two), pytest.raises(RigInUse):
        RigLock("another", one).acquire()


def test_one_hub_under_two_names_is_one_hub(rig, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with RigLock(rig, f"hub:{tmp_path}/hub.sock"), pytest.raises(RigInUse):
        RigLock(rig, "hub:hub.sock").acquire()


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("hub:{}.sock", "hub:{}.sock?node=control"),
        ("socketcan:{}", "socketcan:{}?filter=371:7ff"),
        ("socketcan:{}", "python-can:socketcan:{}"),
    ],
)
def test_one_bus_by_two_ways_is_one_bus(rig, tmp_path, monkeypatch, one, other):
    monkeypatch.chdir(tmp_path)
    with RigLock(rig, one.format(rig)), pytest.raises(RigInUse, match="bus"):
        RigLock("another", other.format(rig)).acquire()


def test_a_lock_that_was_given_back_can_be_taken_again(rig):
    lock = RigLock(rig, f"socketcan:{rig}")
    for _ in range(2):
        with lock, pytest.raises(RigInUse, match=str(os.getpid())):
            RigLock(rig, f"socketcan:{rig}").acquire()
