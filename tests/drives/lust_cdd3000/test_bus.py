"""What the drives of a bus share: stride, slots, garbage."""

from __future__ import annotations

import time
from itertools import pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.lust_cdd3000.bus import LustBus
from hil.drives.lust_cdd3000.codec import decode_control
from hil.drives.power import PowerCommand
from hil.frames import Frame
from tests.drives.exchange import Exchange, profile_of, rig_of

RIG = rig_of("motorcycle")
PROFILE = profile_of()


@pytest.mark.parametrize(("ours", "theirs"), [(1, 2), (2, 1)])
@pytest.mark.parametrize("name", ["axis", "motorcycle"])
def test_a_wrong_stride_refuses_and_says_nothing_on_the_bus(
    name: str, ours: int, theirs: int
) -> None:
    x = Exchange(
        rig_of(name),
        profile_of(ids={"stride": ours}),
        drives_profile=profile_of(ids={"stride": theirs}),
    )
    x.run(2.0)
    x.run(1.0, PowerGoal.ON)
    assert x.sent == []
    for driver in x.bus:
        assert driver.phase is DrivePhase.FAULT
        assert f"Set ids.stride = {theirs}" in (driver.status.error or "")
    assert x.named("stride_mismatch")


def test_a_wrong_stride_stays_refused_through_a_reset() -> None:
    x = Exchange(RIG, drives_profile=profile_of(ids={"stride": 2}))
    x.run(1.0)
    x.run(0.1, PowerGoal.RESET)
    x.run(1.0)
    assert x.sent == []
    assert x.phases() == {DrivePhase.FAULT}


def test_a_drive_with_an_unknown_address_is_told_once_and_harms_nobody() -> None:
    x = Exchange(RIG)
    for _ in range(5):
        x.inject(Frame(0x607 + 9))
    x.enable()
    (event,) = x.named("unknown_drive")
    assert "(address 9)" in event.text


def test_two_drives_of_one_address_are_never_made_ready() -> None:
    x = Exchange(RIG)
    answer, ours = x.answer, x.bus[1].frames.answer
    x.answer = lambda frames: answer(
        [f for at_s, g in frames for f in [(at_s, g)] * (1 + (g.can_id == ours))]
    )
    x.run(1.0)
    assert x.bus[1].phase is DrivePhase.FAULT
    (event,) = x.named("drive_doubled")
    assert "leg2 (address 2) answers twice" in event.text
    assert DrivePhase.FAULT not in {x.bus[0].phase, x.bus[2].phase}


def test_a_stride_mismatch_heard_while_enabled_does_not_stop_the_rig() -> None:
    x = Exchange(RIG)
    x.enable()
    x.inject(Frame(0x607 + 6))
    x.run(0.1, PowerGoal.ON)
    assert x.phases() == {DrivePhase.ENABLED}
    assert x.named("unknown_drive")


def test_every_slot_carries_a_pair_for_ten_minutes() -> None:
    x = Exchange(rig_of("axis", bus={"pattern": ["position", "force", "velocity"]}))
    x.enable()
    before, began = x.bus[0].status, time.process_time()
    x.run(600.0, PowerGoal.ON, [0.05])
    after = x.bus[0].status
    assert after.slots - before.slots == 60_000
    assert after.pairs - before.pairs == 60_000
    assert (after.repeats, after.timeouts, after.unasked, after.garbage) == (0, 0, 0, 0)
    counts = {q: sum(s.quantity == q for s in x.samples) for q in ("position", "force", "velocity")}
    assert all(abs(c - 20_000) < 20 for c in counts.values()), counts
    assert time.process_time() - began < 60.0


def test_configuration_uses_every_slot_too() -> None:
    x = Exchange(RIG)
    x.arm()
    for driver in x.bus:
        status = driver.status
        assert status.slots - status.pairs <= 1, "the last one is still under way"


def test_samples_are_stamped_with_reception_and_the_nominal_delay() -> None:
    x = Exchange(RIG)
    x.enable()
    x.run(0.5, PowerGoal.ON)
    for s in x.samples:
        assert s.received_s - s.sampled_s == pytest.approx(RIG.bus.answer_delay)
    own = [s for s in x.samples if s.source == "leg2" and s.quantity == "position"]
    gaps = {round(b.received_s - a.received_s, 3) for a, b in pairwise(own)}
    assert gaps <= {0.02, 0.021, 0.019}, "position is known every second slot"


def test_answers_that_come_a_slot_late_are_told_now_and_then() -> None:
    x = Exchange(rig_of("axis"))
    answer, ours = x.answer, x.bus[0].frames.answer
    x.answer = lambda frames: answer([(t + 0.012 * (f.can_id == ours), f) for t, f in frames])
    x.enable()
    x.run(5.0, PowerGoal.ON)
    assert x.phases() == {DrivePhase.ENABLED}
    (event,) = x.named("drive_answers_late")
    assert "axis answers late or twice" in event.text
    x.run(10.0, PowerGoal.ON)
    assert len(x.named("drive_answers_late")) == 2


def test_lost_answers_are_asked_for_again() -> None:
    x = Exchange(RIG)
    x.enable()
    take, count = x._take, iter(range(10**9))
    x._take = lambda now_s, f: (
        None if 0x529 < f.can_id < 0x530 and next(count) % 5 == 0 else take(now_s, f)
    )
    x.run(2.0, PowerGoal.ON)
    assert x.phases() == {DrivePhase.ENABLED}
    assert all(d.status.timeouts > 20 for d in x.bus)


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x372, b"\x37\x02"),
        Frame(0x372, bytes.fromhex("0500000000000000")),  # bits that are no state
        Frame(0x372, b"", is_remote=True),
        Frame(0x52A, bytes(7)),
        Frame(0x608, b"", is_remote=True),
        Frame(0x1BA, b"", is_remote=True),
    ],
)
def test_garbage_is_counted_and_never_followed(frame: Frame) -> None:
    x = Exchange(rig_of())
    x.enable()
    before = x.bus[0].status
    x.inject(frame)
    after = x.bus[0].status
    assert after.garbage == before.garbage + 1
    assert after.phase is DrivePhase.ENABLED
    assert after.last_answer_s == before.last_answer_s


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x372, bytes(8), is_extended=True),
        Frame(0x372, bytes(8), is_error=True),
        Frame(0x608, is_extended=True),
        Frame(0x123, bytes(8)),
    ],
)
def test_frames_of_others_leave_no_trace(frame: Frame) -> None:
    x = Exchange(rig_of())
    x.enable()
    before = x.bus[0].status
    x.inject(frame)
    assert x.bus[0].on_frame(x.now_s, frame) == []
    assert x.bus[0].status == before


def test_no_system_frame_goes_out_while_a_drive_is_enabled() -> None:
    """One drive vanishes and is reset; System Stop would take the power from the two that carry on."""
    x = Exchange(RIG)
    x.enable()
    x.drives[0].silence()
    x.run(0.5, PowerGoal.ON)
    bus, count = x.bus, len(x.sent)
    for k in range(100):
        now_s = x.now_s + 0.01 * k
        assert bus.on_cycle(now_s) == []
        bus[0].on_slot(now_s, PowerGoal.RESET, None)
        for i in (1, 2):
            bus[i].on_slot(now_s, PowerGoal.ON, None)
            bus.on_frame(now_s, Frame(0x372 + i, bytes.fromhex("3702010000000000")))
    assert [d.phase for d in bus] == [DrivePhase.ABSENT, DrivePhase.ENABLED, DrivePhase.ENABLED]
    assert len(x.sent) == count


def test_an_answer_to_a_question_not_asked_makes_no_sample() -> None:
    x = Exchange(rig_of())
    x.enable()
    x.run(0.009)
    count = len(x.samples)
    x.inject(Frame(0x52A, (403).to_bytes(2, "little") + b"\0\1\2\3\4\0"))
    assert len(x.samples) == count
    assert x.bus[0].status.unasked == 1


IDS = st.one_of(
    st.sampled_from([0x1B9, 0x1BA, 0x1BB, 0x372, 0x373, 0x52A, 0x52B, 0x607, 0x608, 0x609, 0x0DD]),
    st.integers(0, 0x7FF),
)
FRAMES = st.builds(
    Frame,
    IDS,
    st.one_of(st.binary(max_size=8), st.sampled_from([bytes.fromhex("3702010000000000")])),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(FRAMES, st.floats(0.0, 0.3)), max_size=60), st.sampled_from(PowerGoal))
def test_no_frames_of_a_stranger_ever_raise_or_enable(script, goal: PowerGoal) -> None:
    """Whatever arrives without a drive behind it, no ENABLE goes out: no watchdog was ever read back."""
    bus = LustBus(RIG, PROFILE)
    now_s = 0.0
    for frame, pause_s in script:
        now_s += pause_s
        sent = list(bus.on_cycle(now_s))
        for driver in bus:
            sent += driver.on_slot(now_s, goal, 0.6)
        bus.on_frame(now_s + 1e-3, frame)
        for out in sent:
            if 0x295 <= out.can_id < 0x295 + 220:
                command = decode_control(PROFILE.layout, out.data).command
                assert command is not PowerCommand.ENABLE
        for driver in bus:
            assert driver.phase is not DrivePhase.ENABLED
            assert not driver.status.enabled


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(FRAMES, max_size=25))
def test_garbage_on_a_running_bus_never_raises_and_never_lets_a_drive_go_unwatched(frames) -> None:
    x = Exchange(RIG)
    x.arm()
    for frame in frames:
        x.inject(frame)
        x.run(0.02, PowerGoal.ON)
        for driver in x.bus:
            assert driver.status.watchdog_ok or not driver.status.enabled
            if driver.status.enabled:
                assert driver.started
