"""The simulated CDD3000 behind its frames, with the real plant: what it says, when it stops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.bus.load import RECKONED_BITS
from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.lust_cdd3000.codec import (
    Control,
    Mode,
    Request,
    decode_answer,
    decode_error,
    decode_status,
    encode_control,
    encode_request,
)
from hil.drives.power import PowerCommand, PowerState
from hil.frames import Frame
from hil.sim.lust.drive import BOOT_S, SimulatedCdd3000
from hil.sim.plant import Plant
from tests.drives.exchange import Exchange, profile_of, rig_of

PROFILE = profile_of()
START = Frame(0x0DD, b"\x01")
STOP = Frame(0x0DD, b"\x00")
ON = PowerGoal.ON


class Desk:
    """One drive on a desk, and a hand that sends it frames."""

    def __init__(self, profile=PROFILE, seed: int = 3, **rig: object) -> None:
        self.rig = rig_of(**rig)
        self.plant = Plant(self.rig)
        self.profile = profile
        self.drive = SimulatedCdd3000(self.rig, 0, self.plant, profile, np.random.default_rng(seed))
        self.now_s = 0.0
        self.heard: list[tuple[float, Frame]] = []

    def wait(self, seconds: float) -> list[tuple[float, Frame]]:
        """Let time pass; the frames that the drive sends by itself."""
        end_s, out = self.now_s + seconds, []
        while self.drive.next_due_s <= end_s:
            self.now_s = max(self.now_s, self.drive.next_due_s)
            out += self.drive.on_time(self.now_s)
        self.now_s = end_s
        self.heard += out
        return out

    def say(self, frame: Frame) -> list[tuple[float, Frame]]:
        out = self.drive.on_frame(self.now_s, frame)
        self.heard += out
        return out

    def control(self, command: PowerCommand, counts: int = 0) -> None:
        self.say(encode_control(0x296, self.profile.layout, Control(command, counts)))

    def ask(self, number: int, mode: Mode = Mode.READ, value: int = 0):
        ((_, frame),) = self.say(encode_request(0x44E, Request(number, mode, value)))
        self.wait(0.003)
        return decode_answer(frame.data)

    def enable(self, watchdog_ms: int = 100) -> None:
        self.ask(574, Mode.WRITE, watchdog_ms)
        self.say(START)
        for command in (PowerCommand.DISABLE, PowerCommand.PREPARE, PowerCommand.ENABLE):
            self.control(command)
        assert self.drive.power is PowerState.OPERATION_ENABLED

    def hold(self, seconds: float, counts: int = 0) -> None:
        """Control frames each cycle."""
        for _ in range(round(seconds / 0.01)):
            self.control(PowerCommand.ENABLE, counts)
            self.wait(0.01)

    @property
    def errors(self) -> list[int | None]:
        return [
            decode_error(self.profile.error_frame, f.data).code
            for _, f in self.heard
            if f.can_id == 0x1BA
        ]


def test_it_logs_on_every_100_ms_until_it_is_addressed() -> None:
    d = Desk()
    logged = d.wait(0.95)
    assert [f for _, f in logged] == [Frame(0x608)] * 10
    assert [t for t, _ in logged] == pytest.approx([0.1 * k for k in range(10)])
    d.ask(574)
    assert d.wait(1.0) == []


def test_system_stop_makes_it_log_on_again_and_forget_its_control_word() -> None:
    d = Desk()
    d.enable()
    d.say(STOP)
    assert d.drive.power is PowerState.SWITCH_ON_DISABLED
    assert d.plant.mode(0) == "off"
    assert [f.can_id for _, f in d.wait(0.25)] == [0x608] * 3
    d.say(START)
    assert d.drive.power is PowerState.SWITCH_ON_DISABLED


def test_control_words_are_stored_until_system_start() -> None:
    d = Desk()
    for command in (PowerCommand.PREPARE, PowerCommand.ENABLE, PowerCommand.PREPARE):
        d.control(command)
    assert d.drive.power is PowerState.SWITCH_ON_DISABLED
    d.say(START)
    assert d.drive.power is PowerState.READY_TO_SWITCH_ON


def test_each_control_frame_is_answered_by_a_status() -> None:
    d = Desk()
    d.say(START)
    words = []
    for command in (PowerCommand.DISABLE, PowerCommand.PREPARE, PowerCommand.ENABLE):
        ((_, frame),) = d.say(encode_control(0x296, PROFILE.layout, Control(command)))
        words.append(int.from_bytes(frame.data[:2], "little"))
    assert words == [0x0240, 0x0231, 0x0237], "user manual CM-CAN1, page 7-4"


def test_status_comes_cyclically_where_the_drive_file_says_so() -> None:
    d = Desk(profile_of(timing={"status_period": 0.05}))
    d.say(START)
    d.control(PowerCommand.DISABLE)
    out = d.wait(1.02)
    assert len(out) == 20
    assert {f.can_id for _, f in out} == {0x372}


def test_an_answer_is_received_the_nominal_delay_after_its_sample() -> None:
    d = Desk(bus={"answer_jitter": 0.0})
    ((at_s, _),) = d.say(encode_request(0x44E, Request(400, Mode.READ)))
    frame_s = RECKONED_BITS / d.rig.can.bitrate
    assert at_s + frame_s == pytest.approx(d.now_s + d.rig.bus.answer_delay)


def test_answer_jitter_is_the_rig_files() -> None:
    d = Desk(bus={"answer_jitter": 5e-5})
    delays = []
    for _ in range(400):
        ((at_s, _),) = d.say(encode_request(0x44E, Request(400, Mode.READ)))
        delays.append(at_s - d.now_s)
        d.wait(0.01)
    assert np.std(delays) == pytest.approx(5e-5, rel=0.15)


def test_answers_have_the_rig_files_noise_and_steps() -> None:
    d = Desk(noise={"position": 2e-5, "position_step": 5e-6})
    counts = np.array([d.ask(400).value for _ in range(500)])
    assert np.std(counts * 1e-6) == pytest.approx(2e-5, rel=0.15)
    assert set(np.unique(counts % 5)) == {0}


def test_a_request_before_the_last_answer_left_is_to_be_repeated() -> None:
    d = Desk()
    d.say(encode_request(0x44E, Request(400, Mode.READ)))
    ((_, frame),) = d.say(encode_request(0x44E, Request(402, Mode.READ)))
    assert str(decode_answer(frame.data).status) == "repeat action"
    d.wait(0.003)
    assert d.ask(402).status == 0


@pytest.mark.parametrize("watchdog_ms", [20, 100, 500])
def test_without_control_frames_it_stops_by_itself(watchdog_ms: int) -> None:
    d = Desk()
    d.enable(watchdog_ms)
    d.hold(0.2, 20_000)
    silent_s = d.now_s - 0.01
    d.wait(watchdog_ms * 1e-3 + 0.5)
    assert d.errors == [18]
    (at_s,) = [t for t, f in d.heard if f.can_id == 0x1BA]
    assert at_s - silent_s == pytest.approx(watchdog_ms * 1e-3, abs=1e-9)
    assert d.drive.power is PowerState.FAULT
    assert d.plant.mode(0) == "off"


def test_a_watchdog_of_zero_watches_nothing() -> None:
    d = Desk()
    d.enable(0)
    d.wait(5.0)
    assert d.errors == []
    assert d.drive.power is PowerState.OPERATION_ENABLED


def test_a_moving_drive_that_loses_its_master_comes_to_rest_within_millimetres() -> None:
    x = Exchange(rig_of("axis"), plant=Plant(rig_of("axis")))
    x.enable()
    for k in range(40):
        x.run(0.01, ON, [0.003 * k])  # 0.3 m/s
    speed = x.plant.velocity(0)
    start = x.plant.position(0)
    assert speed == pytest.approx(0.3, rel=0.1)
    x.master_speaks = False
    x.run(0.6)
    x.plant.advance(x.now_s)
    assert abs(x.plant.velocity(0)) < 1e-4
    assert x.plant.mode(0) == "off"
    assert x.plant.position(0) - start < 0.3 * 0.02 + 0.006, "to the last setpoint, not further"


def test_course_limitation_sends_the_error_frame_and_stops() -> None:
    """As in figure 3 of "Parameters Identification for Motorcycle Simulator's Platform Characterization"."""
    rig = rig_of("axis", control={"mode": "computed_torque"})
    x = Exchange(rig, plant=Plant(rig))
    x.enable()
    x.run(3.0, ON, [400.0], until=lambda: x.phases() == {DrivePhase.FAULT})
    assert "E-LSW" in (x.bus[0].status.error or "")
    x.run(0.5)
    x.plant.advance(x.now_s)
    assert abs(x.plant.velocity(0)) < 1e-3
    assert x.plant.position(0) < 0.25 + 0.05


def test_a_drive_beyond_its_course_can_be_reset_and_driven_back() -> None:
    rig = rig_of("axis", control={"mode": "computed_torque"})
    x = Exchange(rig, plant=Plant(rig))
    x.enable()
    x.run(3.0, ON, [400.0], until=lambda: x.phases() == {DrivePhase.FAULT})
    x.run(0.5)
    assert x.plant.position(0) > 0.25
    x.run(1.0, PowerGoal.RESET)
    x.arm()
    x.run(0.3, ON, [-200.0])
    assert x.phases() == {DrivePhase.ENABLED}
    x.plant.advance(x.now_s)
    assert x.plant.position(0) < 0.25


def test_a_setpoint_far_from_the_drive_is_a_following_error() -> None:
    d = Desk()
    d.enable()
    d.hold(0.05, 0)
    d.control(PowerCommand.ENABLE, 120_000)
    assert d.errors == [31]
    assert d.drive.power is PowerState.FAULT_REACTION
    d.wait(0.3)
    assert d.drive.power is PowerState.FAULT


def test_a_setpoint_moves_the_axis_there() -> None:
    d = Desk()
    d.enable()
    d.hold(1.0, 50_000)
    assert d.plant.position(0) == pytest.approx(0.05, abs=1e-4)


def test_fault_reset_needs_an_edge() -> None:
    d = Desk()
    d.enable()
    d.control(PowerCommand.RESET)  # high before the fault: no edge after it
    d.drive.set_fault(3)
    d.wait(0.5)
    d.control(PowerCommand.RESET)
    assert d.drive.power is PowerState.FAULT
    d.control(PowerCommand.DISABLE)
    d.control(PowerCommand.RESET)
    assert d.drive.power is PowerState.SWITCH_ON_DISABLED


def test_enpo_gone_takes_the_power_at_once_and_forgets_the_start() -> None:
    d = Desk()
    d.enable()
    d.drive.set_enpo(d.now_s, present=False)
    assert d.plant.mode(0) == "off"
    d.control(PowerCommand.PREPARE)
    status = decode_status(PROFILE.layout, d.heard[-1][1].data)
    assert (status.power, status.enpo) == (PowerState.SWITCH_ON_DISABLED, False)
    d.drive.set_enpo(d.now_s, present=True)
    d.control(PowerCommand.ENABLE)
    assert d.drive.power is PowerState.SWITCH_ON_DISABLED


def test_a_silent_drive_neither_hears_nor_says() -> None:
    d = Desk()
    d.drive.silence()
    assert d.wait(1.0) == []
    assert d.say(encode_request(0x44E, Request(400, Mode.READ))) == []
    d.drive.silence(silent=False)
    assert d.wait(0.2)


def test_a_reboot_forgets_what_was_written() -> None:
    d = Desk()
    d.enable()
    d.drive.reboot(d.now_s)
    assert d.plant.mode(0) == "off"
    assert d.say(encode_request(0x44E, Request(574, Mode.READ))) == []
    assert d.wait(0.9 * BOOT_S) == []
    assert [f.can_id for _, f in d.wait(0.1)] == [0x608]
    assert d.ask(574).value == 0


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x296, bytes(7)),
        Frame(0x44E, bytes(3)),
        Frame(0x0DD, b""),
        Frame(0x297, b"\x0f" + bytes(7)),
        Frame(0x296, b"", is_remote=True),
        Frame(0x296, bytes(8), is_extended=True),
    ],
)
def test_garbage_and_frames_to_others_do_nothing(frame: Frame) -> None:
    d = Desk()
    assert d.say(frame) == []
    assert d.drive.power is PowerState.SWITCH_ON_DISABLED


def test_the_same_seed_gives_the_same_frames() -> None:
    def record(seed: int) -> list[tuple[float, Frame]]:
        d = Desk(seed=seed)
        d.enable()
        for k in range(50):
            d.hold(0.01, 100 * k)
            d.ask(400)
        return d.heard

    assert record(5) == record(5)
    assert record(5) != record(6)


def test_lost_answers_of_the_gap_catalogue_are_asked_again() -> None:
    lost = {"effect": "lost_frames", "location": "bus", "parameters": {"answers": 0.1}}
    rig = rig_of("axis", effects=[lost])
    x = Exchange(rig, plant=Plant(rig))
    x.enable()
    x.run(3.0, ON)
    status = x.bus[0].status
    assert status.phase is DrivePhase.ENABLED
    assert status.timeouts / status.slots == pytest.approx(0.1, abs=0.04)


def test_three_drives_move_a_motorcycle() -> None:
    rig = rig_of("motorcycle")
    x = Exchange(rig, plant=Plant(rig))
    x.enable()
    homes = [a.home for a in rig.actuators]
    for k in range(100):
        lift = 0.02 * (1.0 - math.cos(math.pi * k / 100))
        x.run(0.01, ON, [homes[0] + lift, homes[1] + lift, 0.0])
    x.run(0.5, ON)
    for i in (0, 1):
        last = next(
            s.value
            for s in reversed(x.samples)
            if s.source == rig.actuators[i].name and s.quantity == "position"
        )
        assert last == pytest.approx(homes[i] + 0.04, abs=5e-4)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.builds(
            Frame,
            st.sampled_from([0x0DD, 0x296, 0x297, 0x44E, 0x608]),
            st.binary(max_size=8),
            st.booleans(),
        ),
        max_size=40,
    )
)
def test_no_frame_ever_breaks_it(frames: list[Frame]) -> None:
    d = Desk()
    for frame in frames:
        d.say(frame)
        d.wait(0.005)
    assert all(len(f.data) in (0, 8) for _, f in d.heard)
