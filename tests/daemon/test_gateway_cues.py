"""Cues get in at a rate that control can take, and complaints at one that people can read."""

import json

import pytest

from hil.daemon.gateway.cues import BURST, FORGET_S, MOST_CLIENTS, RATE_HZ, CueInlet
from hil.daemon.gateway.events import MOST_KINDS, RepeatLimiter
from hil.daemon.zenoh_session import Arrival
from hil.errors import ProtocolError

PAYLOAD = json.dumps({"seq": 1, "t": 0.0, "poses": [{"dt": 0.0, "position": 0.1}]}).encode()


def arrival(client: str, t_s: float) -> Arrival:
    return Arrival(PAYLOAD, len(PAYLOAD), client, t_s)


def accepted(inlet: CueInlet, client: str, times: list[float]) -> int:
    count = 0
    for t_s in times:
        try:
            inlet.accept(arrival(client, t_s))
        except ProtocolError:
            continue
        count += 1
    return count


def test_a_client_gets_its_rate_and_a_burst():
    inlet = CueInlet(("position",))
    times = [k / 5000 for k in range(10_000)]
    assert accepted(inlet, "fast", times) == pytest.approx(BURST + 2.0 * RATE_HZ, abs=2)


def test_one_clients_flood_costs_another_nothing():
    inlet = CueInlet(("position",))
    accepted(inlet, "flood", [0.0] * 5000)
    assert accepted(inlet, "good", [0.01 * k for k in range(100)]) == 100


def test_so_many_senders_and_no_more_until_some_fall_silent():
    inlet = CueInlet(("position",))
    for k in range(MOST_CLIENTS):
        inlet.accept(arrival(f"client{k}", 0.0))
    with pytest.raises(ProtocolError, match="16 other clients"):
        inlet.accept(arrival("late", 1.0))
    inlet.accept(arrival("client3", 1.0))
    assert inlet.accept(arrival("late", FORGET_S + 0.5)).client == "late"


def test_a_payload_too_long_to_be_looked_at_is_refused_by_its_size():
    with pytest.raises(ProtocolError, match="2000000 bytes"):
        CueInlet(("position",)).accept(Arrival(None, 2_000_000, "big", 0.0))


def test_repeats_within_a_second_are_counted_and_told_with_the_next():
    limiter = RepeatLimiter()
    assert limiter.lets("cue_refused a", 0.0) == 0
    assert [limiter.lets("cue_refused a", t) for t in (0.1, 0.5, 0.9)] == [None] * 3
    assert limiter.lets("cue_refused b", 0.9) == 0
    assert limiter.lets("cue_refused a", 1.1) == 3
    assert limiter.lets("cue_refused a", 2.2) == 0


def test_ever_new_kinds_do_not_fill_the_memory():
    limiter = RepeatLimiter()
    for k in range(5000):
        limiter.lets(f"kind {k}", float(k))
    assert len(limiter._seen) <= MOST_KINDS + 1


def test_ever_new_kinds_within_a_second_are_told_as_one():
    limiter = RepeatLimiter()
    told = [limiter.lets(f"kind {k}", 0.0002 * k) for k in range(5000)]
    assert [k for k, held_back in enumerate(told) if held_back is not None] == list(
        range(MOST_KINDS + 1)
    )
    told = [limiter.lets(f"new kind {k}", 1.1 + 0.0002 * k) for k in range(5000)]
    assert sum(held_back is not None for held_back in told) <= MOST_KINDS + 1
    assert max(held_back or 0 for held_back in told) == 5000 - MOST_KINDS - 1
