from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.bus import BitBus, BusState, Delivery
from hil.bus.bitbus import arbitration
from hil.bus.faults import (
    Corrupt,
    Delay,
    Drop,
    Duplicate,
    Fault,
    Flood,
    ForeignId,
    NodeOff,
    Truncate,
)
from hil.bus.load import frame_bits
from hil.bus.state import state_after
from hil.errors import BusBusy, BusError, BusOff
from hil.frames import Frame

BITRATE_BPS = 500_000
FRAME_S = 135 / BITRATE_BPS
"""Eight data bytes, at worst."""


def bus(
    *faults: Fault, nodes: Sequence[str] = ("master", "leg1", "monitor"), seed: int = 0
) -> BitBus:
    made = BitBus(BITRATE_BPS, np.random.default_rng(seed), faults)
    for node in nodes:
        made.attach(node)
    return made


def frame(can_id: int, data: bytes = bytes(8)) -> Frame:
    return Frame(can_id, data)


def heard(deliveries: list[Delivery], receiver: str) -> list[Frame]:
    return [item.frame for item in deliveries if item.receiver == receiver]


def test_a_frame_arrives_everywhere_else_when_its_last_bit_is_sent() -> None:
    line = bus()
    line.submit("master", frame(0x295), 1.0)
    assert line.next_due_s == pytest.approx(1.0 + FRAME_S)
    assert line.advance(1.0 + 0.99 * FRAME_S) == []
    assert line.advance(2.0) == [
        Delivery(pytest.approx(1.0 + FRAME_S), "leg1", frame(0x295)),
        Delivery(pytest.approx(1.0 + FRAME_S), "monitor", frame(0x295)),
    ]
    assert line.next_due_s == math.inf


def test_while_the_bus_is_busy_the_lowest_identifier_waits_least() -> None:
    line = bus(nodes=("a", "b", "c", "d"))
    line.submit("a", frame(0x700), 0.0)
    line.submit("b", frame(0x300), 0.1 * FRAME_S)
    line.submit("c", frame(0x100), 0.2 * FRAME_S)
    deliveries = line.advance(1.0)
    assert heard(deliveries, "d") == [frame(0x700), frame(0x100), frame(0x300)]
    times = [item.t_s for item in deliveries if item.receiver == "d"]
    assert times == pytest.approx([FRAME_S, 2 * FRAME_S, 3 * FRAME_S])


def test_of_frames_submitted_at_one_instant_the_order_of_calls_does_not_count() -> None:
    orders = []
    for calls in (("a", "b"), ("b", "a")):
        line = bus(nodes=("a", "b", "c"))
        for node in calls:
            line.submit(node, frame(0x200 if node == "a" else 0x100), 0.0)
            line.advance(0.0)
        orders.append(heard(line.advance(1.0), "c"))
    assert orders[0] == orders[1] == [frame(0x100), frame(0x200)]


def test_a_transmission_is_not_broken_off_for_a_more_urgent_frame() -> None:
    line = bus()
    line.submit("master", frame(0x700), 0.0)
    line.submit("leg1", frame(0x001), 0.5 * FRAME_S)
    assert heard(line.advance(1.0), "monitor") == [frame(0x700), frame(0x001)]


def test_a_node_sends_in_the_order_of_its_queue() -> None:
    line = bus()
    for can_id in (0x300, 0x100, 0x200):
        line.submit("master", frame(can_id), 0.0)
    assert heard(line.advance(1.0), "leg1") == [frame(0x300), frame(0x100), frame(0x200)]


def _wire(item: Frame) -> str:
    """The arbitration field as it stands on the wire."""
    if item.is_extended:
        bits = f"{item.can_id:029b}"
        return f"{bits[:11]}11{bits[11:]}{int(item.is_remote)}"
    return f"{item.can_id:011b}{int(item.is_remote)}0"


frames = st.builds(
    lambda extended, can_id, remote: Frame(
        can_id if extended else can_id & 0x7FF, b"", extended, remote
    ),
    st.booleans(),
    st.integers(0, 0x1FFF_FFFF),
    st.booleans(),
)


@given(frames, frames)
def test_arbitration_is_decided_by_the_first_bit_that_differs(one: Frame, other: Frame) -> None:
    for a, b in zip(_wire(one), _wire(other), strict=False):
        if a != b:
            assert (arbitration(one) < arbitration(other)) == (a == "0")
            return
    assert one == other or one.is_extended != other.is_extended


def test_a_full_queue_refuses_and_has_room_again_later() -> None:
    line = BitBus(BITRATE_BPS, np.random.default_rng(0), queue_frames=3)
    for node in ("master", "leg1"):
        line.attach(node)
    for _ in range(3):
        line.submit("master", frame(0x100), 0.0)
    assert line.room("master") == 0
    with pytest.raises(BusBusy, match="master"):
        line.submit("master", frame(0x100), 0.0)
    line.submit("leg1", frame(0x200), 0.0)
    line.advance(1.5 * FRAME_S)
    assert line.room("master") == 1
    line.submit("master", frame(0x100), 1.5 * FRAME_S)
    assert line.totals.refused == 1


def test_load_is_the_share_of_time_that_bits_were_sent() -> None:
    line = bus()
    for cycle in range(100):
        for _ in range(10):
            line.submit("master", frame(0x100), cycle * 0.01)
        line.advance((cycle + 1) * 0.01)
    assert line.totals.frames == 1000
    assert line.totals.busy_s / 1.0 == pytest.approx(0.27)


def test_a_node_that_leaves_still_sends_its_queue_but_hears_nothing() -> None:
    line = bus()
    line.submit("master", frame(0x100), 0.0)
    line.submit("leg1", frame(0x200), 0.0)
    line.detach("master")
    deliveries = line.advance(1.0)
    assert heard(deliveries, "monitor") == [frame(0x100), frame(0x200)]
    assert heard(deliveries, "master") == []
    with pytest.raises(KeyError):
        line.submit("master", frame(0x100), 1.0)


def test_a_node_may_come_back_before_its_queue_is_sent() -> None:
    line = bus()
    line.submit("master", frame(0x100), 0.0)
    line.detach("master")
    line.attach("master")
    with pytest.raises(BusError, match="master"):
        line.attach("master")
    line.submit("leg1", frame(0x200), 0.0)
    deliveries = line.advance(1.0)
    assert heard(deliveries, "monitor") == [frame(0x100), frame(0x200)]
    assert heard(deliveries, "master") == [frame(0x200)]


def test_what_is_dropped_takes_its_time_but_arrives_nowhere() -> None:
    line = bus(Drop(ids=(0x371,), skip=1, count=2))
    for _ in range(4):
        line.submit("leg1", frame(0x371), 0.0)
    line.submit("leg1", frame(0x372), 0.0)
    deliveries = line.advance(1.0)
    assert heard(deliveries, "master") == [frame(0x371), frame(0x371), frame(0x372)]
    assert line.totals.frames == 5
    assert line.totals.struck == (2,)


def test_a_frame_can_be_lost_to_one_receiver_alone() -> None:
    line = bus(Drop(receiver="leg1"))
    line.submit("master", frame(0x295), 0.0)
    deliveries = line.advance(1.0)
    assert heard(deliveries, "leg1") == []
    assert heard(deliveries, "monitor") == [frame(0x295)]


def test_a_delayed_frame_is_overtaken() -> None:
    line = bus(Delay(ids=(0x100,), by_s=0.01))
    line.submit("master", frame(0x100), 0.0)
    line.submit("master", frame(0x200), 0.0)
    assert heard(line.advance(0.005), "leg1") == [frame(0x200)]
    assert line.next_due_s == pytest.approx(0.01 + FRAME_S)
    assert heard(line.advance(0.02), "leg1") == [frame(0x100)]


def test_a_duplicate_costs_the_bus_another_transmission() -> None:
    line = bus(Duplicate(count=1))
    line.submit("master", frame(0x100), 0.0)
    line.submit("master", frame(0x200), 0.0)
    deliveries = line.advance(1.0)
    assert heard(deliveries, "leg1") == [frame(0x100), frame(0x100), frame(0x200)]
    assert line.totals.frames == 3


@pytest.mark.parametrize("bits", [1, 3, 64])
def test_a_corrupted_frame_differs_in_so_many_bits_and_equally_for_all(bits: int) -> None:
    line = bus(Corrupt(bits=bits))
    sent = frame(0x371, bytes(range(8)))
    line.submit("leg1", sent, 0.0)
    deliveries = line.advance(1.0)
    (at_master,), (at_monitor,) = heard(deliveries, "master"), heard(deliveries, "monitor")
    difference = int.from_bytes(at_master.data, "big") ^ int.from_bytes(sent.data, "big")
    assert difference.bit_count() == bits
    assert at_master == at_monitor


def test_a_frame_can_come_short_or_under_a_foreign_identifier() -> None:
    line = bus(Truncate(ids=(0x371,), length=3), ForeignId(ids=(0x372,), can_id=0x1B9))
    line.submit("leg1", frame(0x371), 0.0)
    line.submit("leg1", frame(0x372), 0.0)
    assert heard(line.advance(1.0), "master") == [frame(0x371, bytes(3)), frame(0x1B9)]


def test_rules_strike_only_their_sender_and_their_time() -> None:
    line = bus(Drop(sender="leg1", after_s=1.0, until_s=2.0))
    for t_s in (0.5, 1.5, 2.5):
        line.submit("leg1", frame(0x371), t_s)
        line.submit("monitor", frame(0x372), t_s)
    arrived = heard(line.advance(9.0), "master")
    assert [item.can_id for item in arrived] == [0x371, 0x372, 0x372, 0x371, 0x372]


def test_probability_is_the_share_that_is_struck_and_the_seed_repeats_it() -> None:
    def survivors(seed: int) -> list[bytes]:
        line = bus(Drop(probability=0.25), seed=seed)
        deliveries: list[Delivery] = []
        for n in range(2000):
            line.submit("leg1", frame(0x371, n.to_bytes(8, "big")), n * 0.001)
            deliveries += line.advance((n + 1) * 0.001)
        assert len(heard(deliveries, "master")) + line.totals.struck[0] == 2000
        return [item.data for item in heard(deliveries, "master")]

    first, again, other = survivors(1), survivors(1), survivors(2)
    assert first == again
    assert first != other
    # Binomial with mean 1500 and standard deviation 19: five of them.
    assert abs(len(first) - 1500) < 97
    assert abs(len(other) - 1500) < 97


def test_a_node_off_the_bus_neither_sends_nor_hears_until_it_is_restarted() -> None:
    line = bus(NodeOff(node="leg1", at_s=1.0, for_s=0.5))
    line.submit("leg1", frame(0x371), 1.0 - 0.5 * FRAME_S)
    line.submit("monitor", frame(0x500), 1.1)
    deliveries = line.advance(1.2)
    assert heard(deliveries, "master") == [frame(0x500)]
    (notice,) = heard(deliveries, "leg1")
    assert state_after(notice, BusState.ERROR_ACTIVE) is BusState.BUS_OFF
    with pytest.raises(BusOff, match="leg1"):
        line.submit("leg1", frame(0x371), 1.3)
    (notice,) = heard(line.advance(1.6), "leg1")
    assert state_after(notice, BusState.BUS_OFF) is BusState.ERROR_ACTIVE
    line.submit("leg1", frame(0x371), 1.7)
    assert heard(line.advance(2.0), "master") == [frame(0x371)]


def test_a_babbling_node_takes_the_bus_from_all_less_urgent_frames() -> None:
    line = bus(Flood(can_id=0x000, data="00" * 8, at_s=0.1, until_s=0.2))
    line.submit("master", frame(0x295), 0.15)
    deliveries = line.advance(1.0)
    (t_s,) = [item.t_s for item in deliveries if item.receiver == "leg1" and item.frame.can_id]
    assert t_s == pytest.approx(0.2 + FRAME_S, abs=2 * FRAME_S)
    assert line.totals.busy_s == pytest.approx(0.1 + FRAME_S, abs=2 * FRAME_S)


def test_a_flood_with_pauses_comes_at_its_period() -> None:
    line = bus(Flood(can_id=0x010, at_s=0.0, until_s=0.095, period_s=0.01))
    times = [item.t_s for item in line.advance(1.0) if item.receiver == "leg1"]
    assert np.diff(times) == pytest.approx(np.full(9, 0.01))


submissions = st.lists(
    st.tuples(
        st.floats(0.0, 0.01, allow_nan=False),
        st.sampled_from(["a", "b", "c", "d"]),
        st.integers(0, 0x7FF),
        st.integers(0, 8),
    ),
    max_size=60,
)


@given(submissions, st.lists(st.floats(0.0, 0.02, allow_nan=False), max_size=10))
def test_any_traffic_is_carried_once_without_overlap_and_by_priority(
    traffic: list[tuple[float, str, int, int]], steps: list[float]
) -> None:
    """Against an independent reckoning of non-preemptive priority queues, however often it is asked."""
    traffic = sorted(traffic, key=lambda item: item[0])
    line = BitBus(BITRATE_BPS, np.random.default_rng(0), queue_frames=1000)
    for node in ("a", "b", "c", "d", "ear"):
        line.attach(node)
    instants = sorted(steps)
    got: list[Delivery] = []
    for order, (t_s, node, can_id, length) in enumerate(traffic):
        while instants and instants[0] < t_s:
            got += line.advance(instants.pop(0))
        line.submit(node, Frame(can_id, bytes([order] * length)), t_s)
    got += line.advance(10.0)

    queues: dict[str, list[tuple[float, int, int, Frame]]] = {}
    for order, (t_s, node, can_id, length) in enumerate(traffic):
        item = (t_s, can_id, order, Frame(can_id, bytes([order] * length)))
        queues.setdefault(node, []).append(item)
    expected, free_s = [], 0.0
    while waiting := [queue for queue in queues.values() if queue]:
        start_s = max(free_s, min(queue[0][0] for queue in waiting))
        ready = [
            (queue[0][1], queue[0][2], id(queue), queue)
            for queue in waiting
            if queue[0][0] <= start_s
        ]
        heapq.heapify(ready)
        sent = ready[0][3].pop(0)[3]
        free_s = start_s + frame_bits(sent) / BITRATE_BPS
        expected.append((free_s, sent))
    assert [(t, f) for t, name, f in got if name == "ear"] == expected
