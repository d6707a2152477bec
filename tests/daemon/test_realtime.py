"""Real-time rights are asked for and what came of it is said; the kernel is the witness."""

import gc
import os
import subprocess
import sys

import pytest

from hil.daemon.realtime import CalmGarbage

ASK = """
import os, resource, sys
from hil.daemon.realtime import lock_memory, request_fifo
limit = int(sys.argv[1])
if limit >= 0:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (limit, limit))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (4096 * limit, 4096 * limit))
    if os.getuid() == 0:
        os.setgid(65534); os.setuid(65534)
for right in (request_fifo(), lock_memory()):
    print(right.is_granted, right.text)
print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO)
locked = [l for l in open("/proc/self/status") if l.startswith("VmLck")][0]
print(int(locked.split()[1]) > 0)
"""


def ask(limit: int) -> list[str]:
    """Asked in a process of its own, with rights up to `limit`; -1: with those of the test."""
    answer = subprocess.run(
        [sys.executable, "-c", ASK, str(limit)], capture_output=True, text=True, check=True
    )
    return answer.stdout.splitlines()


@pytest.mark.skipif(os.getuid() != 0, reason="only root may give its rights away")
def test_without_rights_each_refusal_says_how_to_allow_it():
    fifo, memory, is_fifo, is_locked = ask(0)
    assert fifo.startswith("False no real-time scheduling")
    assert "LimitRTPRIO" in fifo
    assert memory.startswith("False memory is not locked")
    assert "LimitMEMLOCK" in memory
    assert (is_fifo, is_locked) == ("False", "False")


def test_what_is_said_to_be_granted_is_what_the_kernel_did():
    fifo, memory, is_fifo, is_locked = ask(-1)
    assert fifo.startswith(is_fifo)
    assert memory.startswith(is_locked)


def test_garbage_is_left_alone_while_armed_and_collected_again_after():
    garbage = CalmGarbage()
    try:
        garbage.settle()
        assert gc.get_freeze_count() > 0
        garbage.arm()
        assert not gc.isenabled()
        garbage.arm()
    finally:
        garbage.disarm()
        gc.unfreeze()
    assert gc.isenabled()
    garbage.disarm()
    assert gc.isenabled()


def test_arming_costs_the_loop_no_collection():
    collected = []
    gc.callbacks.append(lambda phase, _: collected.append(phase))
    garbage = CalmGarbage()
    try:
        garbage.arm()
        garbage.disarm()
    finally:
        gc.callbacks.pop()
    assert collected == []
