"""A rig of real processes: a simulated one, its daemon, a client that rides it."""

from __future__ import annotations

import contextlib
import re

import pytest

from tests.daemon.bench import Bench, ride


@pytest.fixture
def bench(tmp_path):
    made = Bench(tmp_path)
    yield made
    made.end()


@pytest.fixture
def slow(bench):
    """The bench's rig takes its time to park."""
    text, n = re.subn(r"(?m)^speed_share = .*$", "speed_share = 0.002", bench.file.read_text())
    assert n == 1
    bench.file.write_text(text)


@pytest.fixture
def riding(bench):
    """The bench with an armed rig that follows cues."""
    bench.simulated = bench.simulate()
    bench.control = bench.daemon()
    with contextlib.closing(bench.client()) as client:
        ride(client)
        bench.rig = client
        yield bench
