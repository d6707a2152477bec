"""What passed on a bus, against counts and bit times done by hand."""

import pytest

from hil.bus.statistics import BusStatistics
from hil.frames import Frame

# 8 bytes, worst case: 34 + 64 + 13 + floor(97 / 4) = 135 bits
BITS = 135


def test_rates_gaps_and_load_of_a_steady_frame():
    statistics = BusStatistics(500_000)
    for k in range(101):
        statistics.add(10.0 + 0.01 * k, Frame(0x371, bytes(8)))
    (only,) = statistics.ids()
    assert only.count == statistics.frames == 101
    assert only.rate_hz == pytest.approx(100.0)
    assert only.longest_gap_s == pytest.approx(0.01)
    assert statistics.duration_s == pytest.approx(1.0)
    assert statistics.load == pytest.approx(101 * BITS / 500_000)


def test_a_pause_shows_as_the_longest_gap():
    statistics = BusStatistics(500_000)
    for t_s in (0.0, 0.01, 0.5, 0.51):
        statistics.add(t_s, Frame(0x371, bytes(8)))
    assert statistics.ids()[0].longest_gap_s == pytest.approx(0.49)


def test_identifiers_come_by_priority_and_lengths_apart():
    statistics = BusStatistics(500_000)
    for frame in (Frame(0x7FF), Frame(0x001), Frame(0x001, is_extended=True)):
        statistics.add(0.0, frame)
    assert [(i.can_id, i.is_extended) for i in statistics.ids()] == [
        (0x001, False),
        (0x001, True),
        (0x7FF, False),
    ]


def test_error_frames_are_counted_apart():
    statistics = BusStatistics(500_000)
    statistics.add(0.0, Frame(0x40, bytes(8), is_error=True))
    assert (statistics.frames, statistics.errors, statistics.load) == (0, 1, 0.0)
