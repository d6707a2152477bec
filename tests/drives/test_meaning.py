"""The gate's reading of CANLust frames: the whole of what the driver says, and nothing else."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.config import RigFile
from hil.drives.driver import PowerGoal
from hil.drives.lust_cdd3000 import codec
from hil.drives.meaning import Ask, CanlustMeaning
from hil.drives.power import PowerCommand
from hil.drives.profile import LustProfile
from hil.frames import Frame
from hil.safety import Gate, gate_limits
from tests.drives.exchange import Exchange, profile_of, rig_of

POSMOD = {"kind": "posmod", "status_carries_position": True}


def reading(rig: RigFile, profile: LustProfile, frame: Frame) -> Ask:
    reader = CanlustMeaning(rig, profile, "position")
    assert reader.lengths[frame.can_id] == len(frame.data)
    return reader.meaning(frame.can_id, frame.data).ask


@pytest.mark.parametrize("layout", [{}, POSMOD], ids=["drivecom", "posmod"])
@pytest.mark.parametrize(
    ("command", "ask"),
    [
        (PowerCommand.DISABLE, Ask.POWER_OFF),
        (PowerCommand.ENABLE, Ask.POWER_ON),
        (PowerCommand.RESET, Ask.FAULT_RESET),
    ],
)
def test_control_frames_are_read_in_both_layouts(
    layout: dict[str, object], command: PowerCommand, ask: Ask
) -> None:
    profile = profile_of(layout=layout)
    frame = codec.encode_control(0x296, profile.layout, codec.Control(command, 600_123))
    assert reading(rig_of("motorcycle"), profile, frame) is ask


def test_words_that_make_no_force_are_off_and_those_on_the_way_to_it_are_on() -> None:
    profile, rig = profile_of(), rig_of("axis")
    asks = {
        word: reading(rig, profile, Frame(0x296, bytes([word, *bytes(7)])))
        for word in (0x00, 0x02, 0x06, 0x07, 0x0F, 0x80)
    }
    off = {word for word, ask in asks.items() if ask is Ask.POWER_OFF}
    assert off == {0x00, 0x02, 0x06}
    assert asks[0x07] is asks[0x0F] is Ask.POWER_ON
    assert asks[0x80] is Ask.FAULT_RESET


@given(st.binary(min_size=8, max_size=8))
def test_no_control_word_but_the_six_is_understood(data: bytes) -> None:
    word = int.from_bytes(data[:2], "little")
    known = word in (0x00, 0x02, 0x06, 0x07, 0x0F, 0x80) and not any(data[2:4])
    asked = reading(rig_of("axis"), profile_of(), Frame(0x296, data))
    assert (asked is not Ask.UNKNOWN) == known


@pytest.mark.parametrize("flags", [0x40, 0x80, 0x04])
def test_jog_and_other_flags_of_positioning_mode_are_unknown(flags: int) -> None:
    data = bytes([0x01, 0, flags, 0, 0, 0, 0, 0])
    assert reading(rig_of("axis"), profile_of(layout=POSMOD), Frame(0x296, data)) is Ask.UNKNOWN


def test_setpoints_come_back_in_si_and_in_the_right_drive() -> None:
    rig, profile = rig_of("motorcycle"), profile_of()
    slide = codec.frame_ids(profile.ids, rig.address(2)).control
    data = bytes([0x0F, 0, 0, 0]) + (-123_456).to_bytes(4, "little", signed=True)
    as_position = CanlustMeaning(rig, profile, "position").meaning(slide, data)
    as_force = CanlustMeaning(rig, profile, "force").meaning(slide, data)
    assert (as_position.actuator, as_position.kind) == (2, "position")
    assert as_position.setpoint == pytest.approx(-0.123456, abs=1e-12)
    assert (as_force.kind, as_force.setpoint) == ("force", pytest.approx(-123_456.0))


def test_parameter_requests_and_what_may_be_written() -> None:
    rig, profile = rig_of("axis"), profile_of()
    reader = CanlustMeaning(rig, profile, "position")
    write = codec.encode_request(0x44E, codec.Request(574, codec.Mode.WRITE, 100))
    assert reader.meaning(write.can_id, write.data).ask is Ask.WRITE
    assert reader.meaning(write.can_id, write.data).value == 100
    assert reading(rig, profile, Frame(0x44E, bytes([0x3E, 2, 12, 0, 0, 0, 0, 0]))) is Ask.UNKNOWN
    gains = profile.parameters.gains
    assert profile.parameters.watchdog.number in reader.writable(0)
    assert not reader.writable(0) & {
        gains.position.number,
        gains.speed.number,
        gains.integral.number,
    }


def test_system_frames() -> None:
    rig, profile = rig_of("axis"), profile_of()
    asks = [reading(rig, profile, Frame(0x0DD, bytes([b]))) for b in (1, 0, 2)]
    assert asks == [Ask.SYSTEM_START, Ask.SYSTEM_STOP, Ask.UNKNOWN]


@pytest.mark.parametrize("mode", ["drive", "cascade"])
@pytest.mark.parametrize("layout", [{}, POSMOD], ids=["drivecom", "posmod"])
def test_all_that_the_drivers_say_passes_the_gate_power_only_while_armed(
    mode: str, layout: dict[str, object]
) -> None:
    rig, profile = rig_of("motorcycle", control={"mode": mode}), profile_of(layout=layout)
    exchange = Exchange(rig, profile)
    limits = gate_limits(rig, exchange.bus[0].setpoint_kind)
    gate, never_armed = (Gate(limits, exchange.bus.meaning) for _ in range(2))
    exchange.arm()
    assert judged(gate, rig, exchange) == judged(never_armed, rig, exchange) == []
    exchange.sent, exchange.samples = [], []
    exchange.enable()
    exchange.run(0.2, PowerGoal.ON)
    gate.arm()
    assert judged(gate, rig, exchange) == []
    assert gate.powered
    refusals = judged(never_armed, rig, exchange)
    enable = b"\x0f" if not layout else b"\x01"
    asked = [f for _, f in exchange.sent if 0x296 <= f.can_id <= 0x298 and f.data[:1] == enable]
    assert len(refusals) == len(asked) > 60
    assert all("(disarmed)" in text for text in refusals)


def judged(gate: Gate, rig: RigFile, exchange: Exchange) -> list[str]:
    """The refusals of all that was sent and measured in order of time."""
    happened = [(s.received_s, 0, s) for s in exchange.samples if s.quantity == "position"]
    happened += [(t, 1, frame) for t, frame in exchange.sent]  # type: ignore[misc]
    refused = []
    for t, _, what in sorted(happened, key=lambda h: h[:2]):
        if isinstance(what, Frame):
            verdict = gate.pass_frame(t, what)
            refused += [] if verdict.ok else [verdict.text]
        else:
            gate.measured(rig.actuator_names.index(what.source), what.value, t)
    return refused
