"""Whatever bytes are thrown at the gate of a real rig: nothing that must not pass passes."""

from __future__ import annotations

import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from hil.configfile import load_drive, load_rig
from hil.drives.lust_cdd3000.codec import frame_ids
from hil.drives.meaning import CanlustMeaning
from hil.drives.profile import LustProfile
from hil.frames import Frame
from hil.safety import Gate, gate_limits

RIG = load_rig("motorcycle")
PROFILE = load_drive("lust_cdd3000", LustProfile)
IDS = [frame_ids(PROFILE.ids, RIG.address(i)) for i in range(3)]
ALLOWED = {
    PROFILE.ids.system: 1,
    **{i.control: 8 for i in IDS},
    **{i.request: 8 for i in IDS},
}
CONTROLS = {ids.control: i for i, ids in enumerate(IDS)}


def gate(*, read_only: bool = False) -> Gate:
    """An armed gate of the motorcycle platform, at rest in its home position, measured now and always."""
    made = Gate(
        gate_limits(RIG, "position"),
        CanlustMeaning(RIG, PROFILE, "position"),
        read_only=read_only,
    )
    made.arm()
    measure(made, 0.0)
    return made


def measure(made: Gate, t: float) -> None:
    for i, actuator in enumerate(RIG.actuators):
        made.measured(i, actuator.home, t)


frames = st.builds(
    Frame,
    st.one_of(st.sampled_from(sorted(ALLOWED)), st.integers(0, 0x7FF)),
    st.binary(max_size=8),
    st.sampled_from([False, False, False, True]),
    st.sampled_from([False, False, False, True]),
    st.sampled_from([False, False, False, True]),
)
near = st.builds(
    # Setpoints around where the rig is: these get through the outer rules.
    lambda i, word, off: Frame(
        IDS[i].control,
        struct.pack("<HHi", word, 0, round((RIG.actuators[i].home + off) * 1e6)),
    ),
    st.integers(0, 2),
    st.sampled_from([0x00, 0x06, 0x07, 0x0F, 0x80, 0x1F]),
    st.floats(-0.05, 0.05),
)
streams = st.lists(st.tuples(st.floats(0.0, 0.03), st.one_of(frames, near)), max_size=40)


@given(streams)
def test_nothing_passes_a_read_only_gate(stream: list[tuple[float, Frame]]) -> None:
    made, t = gate(read_only=True), 0.0
    for dt, frame in stream:
        t += dt
        assert not made.pass_frame(t, frame).ok
    assert made.passed == 0


@given(streams)
@settings(max_examples=300)
def test_nothing_outside_the_allow_list_passes_and_no_leap_does(
    stream: list[tuple[float, Frame]],
) -> None:
    made, t = gate(), 0.0
    last: dict[int, tuple[float, float]] = {}
    for dt, frame in stream:
        t += dt
        measure(made, t)
        if not made.pass_frame(t, frame).ok:
            continue
        assert not any((frame.is_remote, frame.is_extended, frame.is_error))
        assert ALLOWED.get(frame.can_id) == len(frame.data)
        if frame.can_id not in CONTROLS:
            continue
        i = CONTROLS[frame.can_id]
        word, unused, counts = struct.unpack("<HHi", frame.data)
        assert word in (0x00, 0x02, 0x06, 0x07, 0x0F)
        assert unused == 0
        if word not in (0x07, 0x0F):
            last.pop(i, None)
            continue
        actuator, value = RIG.actuators[i], counts / 1e6
        assert actuator.stroke[0] + 0.004 <= value <= actuator.stroke[1] - 0.004
        assert abs(value - actuator.home) <= RIG.safety.following_error
        before, at_s = last.get(i, (actuator.home, t - 0.01))
        # An oracle apart from the gate's own reckoning of cycles: half a cycle of jitter and 5 % of slack.
        reach = 1.05 * actuator.velocity_max * max(0.01, t - at_s + 0.0051)
        assert abs(value - before) <= reach + 2e-6 or t - at_s > RIG.safety.answer_timeout
        last[i] = (value, t)


@given(streams)
def test_disarmed_nothing_that_makes_force_passes(stream: list[tuple[float, Frame]]) -> None:
    made, t = gate(), 0.0
    made.disarm()
    for dt, frame in stream:
        t += dt
        measure(made, t)
        if made.pass_frame(t, frame).ok and frame.can_id in CONTROLS:
            assert frame.data[0] in (0x00, 0x02, 0x06, 0x80)
    assert not made.powered


@given(st.lists(st.floats(0.0, 0.02), min_size=30, max_size=120))
def test_however_frames_are_timed_no_more_than_21_pass_in_20_cycles(steps: list[float]) -> None:
    made, t, passed = gate(), 0.0, []
    for number, dt in enumerate(steps):
        t += dt
        request = Frame(IDS[0].request, struct.pack("<HBiB", number, 5, 0, 0))
        if made.pass_frame(t, request).ok:
            passed.append(t)
    for first, later in zip(passed, passed[21:], strict=False):
        assert later - first >= 0.2
