"""Each run of the tests tries the same examples; `pytest --hypothesis-profile explore` looks for new ones."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import settings

settings.register_profile("same", derandomize=True)
settings.register_profile("explore", derandomize=False, max_examples=1000)
settings.load_profile("same")

COMPILING = ("tests/sim/test_effects.py", "tests/rigs/test_bicycle_benchmarks.py")
"""What compiles longest, each something else: workers that begin with one of these find what the other made
in the cache."""
REALTIME = (
    "tests/bicycle/test_acquisition.py",
    "tests/bicycle/test_remote.py",
    "tests/bus/test_conformance.py",
    "tests/bus/test_hub.py",
    "tests/bus/test_pythoncan.py",
    "tests/bus/test_socketcan.py",
    "tests/bus/test_socketport.py",
    "tests/bus/test_timerfd.py",
    "tests/cli/test_experiment_on_rig.py",
    "tests/cli/test_sniff_command.py",
    "tests/daemon/test_canopen.py",
    "tests/daemon/test_check.py",
    "tests/daemon/test_commission.py",
    "tests/daemon/test_demo.py",
    "tests/daemon/test_gateway",
    "tests/daemon/test_latency.py",
    "tests/daemon/test_lock.py",
    "tests/daemon/test_processes",
    "tests/daemon/test_zenoh_session.py",
    "tests/runs/test_recorder.py",
    "tests/sim/test_serve.py",
    "tests/test_client.py",
    "tests/vcan/",
)
"""Processes, buses and clients by the wall clock. A machine that withholds its processor for a moment makes
a rig stop, as it should, and Zenoh drop a state, as it may; so these run after all that computes, and one
that failed has two more tries. A defect fails all three."""
TRIES_MORE = 2


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files in the order in which workers take them: those that compile, then the long ones; and marks."""
    count = Counter(_file(item) for item in items)

    def turn(item: pytest.Item) -> tuple[int, int, str]:
        file = _file(item)
        first = COMPILING.index(file) if file in COMPILING else len(COMPILING)
        return first, -count[file], file

    items.sort(key=turn)
    for item in items:
        if item.nodeid.startswith(REALTIME):
            item.add_marker(pytest.mark.realtime)
            item.add_marker(pytest.mark.flaky(reruns=TRIES_MORE))


def _file(item: pytest.Item) -> str:
    return item.nodeid.partition("::")[0]
