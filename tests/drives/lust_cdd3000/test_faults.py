"""What stops a drive, what it is called, and how it comes back."""

from __future__ import annotations

import pytest

from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.lust_cdd3000.codec import decode_control
from hil.drives.power import PowerCommand
from hil.frames import Frame
from tests.drives.exchange import Exchange, profile_of, rig_of

ON, OFF, RESET = PowerGoal.ON, PowerGoal.OFF, PowerGoal.RESET


def enabled(name: str = "axis", **changes: object) -> Exchange:
    x = Exchange(rig_of(name, **changes))
    x.enable()
    return x


def fault(x: Exchange, i: int = 0) -> str:
    status = x.bus[i].status
    assert status.phase is DrivePhase.FAULT, status
    assert not status.watchdog_ok, "after a fault nothing counts as verified"
    return status.error or ""


def enables_sent(x: Exchange, since_s: float) -> int:
    layout = profile_of().layout
    return sum(
        decode_control(layout, f.data).command is PowerCommand.ENABLE
        for t, f in x.sent
        if t >= since_s and 0x295 < f.can_id < 0x2A0
    )


def test_an_error_frame_stops_the_drive_and_says_why() -> None:
    x = enabled()
    x.drives[0].set_fault(3)
    x.run(0.3, ON)
    assert fault(x) == ("axis (address 1) reports E-OC (overcurrent, short circuit or earth fault)")
    assert x.plant.modes == ["off"]


def test_a_fault_is_latched_and_enables_nothing_until_it_is_reset() -> None:
    x = enabled()
    x.drives[0].set_fault(3)
    x.run(0.1, ON)
    since_s = x.now_s
    for goal in (ON, OFF, ON):
        x.run(0.5, goal)
        fault(x)
    assert enables_sent(x, since_s) == 0


def test_reset_is_a_rising_edge_and_leads_through_configuration_again() -> None:
    x = enabled()
    x.drives[0].set_fault(3)
    x.run(0.5, ON)
    since_s = x.now_s
    assert x.run(2.0, RESET, until=lambda: x.phases() == {DrivePhase.LOGGED_ON})
    layout = profile_of().layout
    words = [
        decode_control(layout, f.data).command
        for t, f in x.sent
        if t >= since_s and f.can_id == 0x296
    ]
    assert words[0] is PowerCommand.DISABLE, "the bit is low first, so that it has an edge"
    assert PowerCommand.RESET in words
    assert x.bus[0].status.error is None
    x.arm()
    assert x.bus[0].status.watchdog_ok
    x.run(0.1, ON)
    assert x.phases() == {DrivePhase.ENABLED}


def test_a_fault_that_stays_is_not_reset_away() -> None:
    x = enabled()
    x.drives[0].set_fault(3)
    x.run(0.5, ON)
    x.drives[0].stage.state = type(x.drives[0].power).FAULT_REACTION  # nothing leads out of here
    x.run(2.0, RESET)
    fault(x)


@pytest.mark.parametrize("data", [b"", b"\x21", bytes(8), bytes([255] * 8)])
def test_an_error_frame_counts_whatever_its_length(data: bytes) -> None:
    x = enabled()
    x.inject(Frame(0x1BA, data))
    assert "reports" in fault(x)


def test_an_error_frame_without_address_concerns_every_drive() -> None:
    """The published example has identifier 0x1B9 itself; no drive of the rig has address 0."""
    x = enabled("motorcycle")
    x.inject(Frame(0x1B9, bytes([33, 0, 0, 0, 0, 0, 0, 0])))
    for i in range(3):
        assert "E-LSW" in fault(x, i)
    assert len(x.named("course_limitation")) == 3


def test_what_is_told_during_a_fault_is_added_once() -> None:
    x = enabled()
    for _ in range(3):
        x.inject(Frame(0x1BA, bytes([33]) + bytes(7)))
        x.inject(Frame(0x1BA, bytes([3]) + bytes(7)))
    assert fault(x).count("E-LSW") == 1
    assert fault(x).count("E-OC") == 1


def test_enpo_lost_while_enabled_is_named_and_does_not_come_back_by_itself() -> None:
    x = enabled()
    x.drives[0].set_enpo(x.now_s, present=False)
    x.run(0.1, ON)
    assert fault(x) == "axis (address 1) has lost its hardware enable ENPO"
    assert x.named("enpo_lost")
    since_s = x.now_s
    x.drives[0].set_enpo(x.now_s, present=True)
    x.run(1.0, ON)
    fault(x)
    assert enables_sent(x, since_s) == 0


def test_all_control_bytes_are_cleared_when_enpo_is_lost() -> None:
    x = enabled()
    x.drives[0].set_enpo(x.now_s, present=False)
    x.run(0.2, ON)
    last = [f for _, f in x.sent if f.can_id == 0x296][-1]
    assert last.data == bytes(8)


def test_enpo_lost_while_ready_drops_back_and_never_enables_by_itself() -> None:
    x = Exchange(rig_of())
    x.arm()
    x.drives[0].set_enpo(x.now_s, present=False)
    x.run(0.1)
    assert x.phases() == {DrivePhase.CONFIGURED}
    assert "ENPO is not there" in x.named("drive_not_ready")[0].text
    x.run(0.1, ON)
    x.drives[0].set_enpo(x.now_s, present=True)
    x.run(1.0, ON)
    assert x.phases() == {DrivePhase.READY}
    assert x.plant.modes == ["off"]


@pytest.mark.parametrize("i", [0, 2])
def test_a_silent_drive_is_named_with_how_long(i: int) -> None:
    x = enabled("motorcycle")
    cut_s = x.now_s
    x.drives[i].silence()
    assert x.run(1.0, ON, until=lambda: x.bus[i].phase is DrivePhase.FAULT)
    name = x.rig.actuators[i].name
    assert f"{name} (address {i + 1}) has answered nothing for 0.1" in fault(x, i)
    assert x.now_s - cut_s < x.rig.safety.answer_timeout + 2.5 * x.rig.bus.cycle
    others = [d.phase for k, d in enumerate(x.bus) if k != i]
    assert others == [DrivePhase.ENABLED] * 2


def test_a_drive_that_is_not_there_is_named() -> None:
    x = Exchange(rig_of("motorcycle"))
    x.drives[1].silence()
    x.run(2.0)
    assert x.bus[1].phase is DrivePhase.ABSENT
    assert "leg2 (address 2) has not logged on: is it powered" in (
        x.bus[1].status.waiting_for or ""
    )
    assert "waits for the other drives" in (x.bus[0].status.waiting_for or "")
    assert not any(f.can_id == 0x298 - 1 for _, f in x.sent), "nothing is sent to it"


def test_a_drive_that_comes_late_joins() -> None:
    x = Exchange(rig_of("motorcycle"))
    x.drives[1].silence()
    x.run(2.0)
    x.drives[1].silence(silent=False)
    x.arm()


def test_a_drive_that_answers_parameters_but_no_status_is_dead() -> None:
    x = enabled()
    take = x._take
    x._take = lambda now_s, f: None if f.can_id == 0x372 else take(now_s, f)
    x.run(1.0, ON)
    assert "has sent no status for 0.5" in fault(x)


def test_a_reboot_while_enabled_is_a_fault_and_needs_a_new_start() -> None:
    x = enabled()
    x.drives[0].reboot(x.now_s)
    x.run(1.0, ON)
    assert "has answered nothing for 0.1" in fault(x)
    assert "has restarted since" in fault(x)
    x.run(1.0, RESET)
    x.arm()
    assert x.drives[0].started
    assert x.drives[0].parameters.watchdog_s == pytest.approx(0.1)
    x.run(0.1, ON)
    assert x.phases() == {DrivePhase.ENABLED}


def test_a_log_on_while_enabled_is_a_fault_by_itself() -> None:
    x = enabled()
    x.inject(Frame(0x608))
    assert fault(x) == "axis (address 1) logged on while running: it has restarted"
    assert not x.bus[0].started


def test_a_reboot_while_configured_configures_again() -> None:
    x = Exchange(rig_of())
    x.drives[0].set_enpo(0.0, present=False)
    x.run(1.0)
    assert x.phases() == {DrivePhase.CONFIGURED}
    x.inject(Frame(0x608))
    assert x.phases() == {DrivePhase.LOGGED_ON}
    assert not x.bus[0].status.watchdog_ok
    x.drives[0].set_enpo(x.now_s, present=True)
    x.arm()


def test_a_daemon_that_dies_leaves_drives_that_stop_and_are_heard_again() -> None:
    x = enabled("motorcycle")
    x.master_speaks = False
    x.run(0.5)
    assert x.plant.modes == ["off"] * 3, "the drives' own watchdogs stopped them"
    y = Exchange(x.rig)
    y.drives = y.nodes = x.drives
    y.plant = x.plant
    y.now_s, y.cycle = x.now_s, x.cycle
    y.run(1.0)
    assert y.named("system_stop"), "they had been addressed: nothing logs on by itself"
    for i in range(3):
        assert "fault" in fault(y, i)
    y.run(1.0, RESET)
    y.arm()


def test_a_drive_that_is_powered_although_nobody_asked_is_stopped() -> None:
    x = Exchange(rig_of())
    x.arm()
    x.run(0.6)
    x.inject(Frame(0x372, bytes.fromhex("3702000000000000")))
    assert "makes force although nobody asked" in fault(x)


def test_a_drive_that_leaves_operation_by_itself_is_named() -> None:
    x = enabled()
    x.inject(Frame(0x372, bytes.fromhex("3102000000000000")))
    assert "left operation by itself: it is now ready to switch on" in fault(x)


def test_a_drive_that_stays_on_when_told_to_be_off_is_named() -> None:
    x = enabled()
    x.drives[0].stage.obey = lambda *a, **k: None
    x.run(0.9, OFF)
    assert x.named("drive_stays_on") == []
    x.run(0.3, OFF)
    assert "still makes force 1 s after it was told to be off" in fault(x)
    (event,) = x.named("drive_stays_on")
    assert "axis (address 1)" in event.text


def test_a_latched_fault_does_not_hide_that_the_drive_stays_on() -> None:
    x = enabled()
    stage = x.drives[0].stage
    stage.obey, stage.trip = lambda *a, **k: None, lambda *a, **k: True
    x.drives[0].set_fault(3)
    x.run(3.0, ON)
    assert "overcurrent" in fault(x)
    assert "still makes force" in fault(x)
    assert len(x.named("drive_stays_on")) == 1


def test_a_drive_that_loses_its_reference_while_enabled_is_stopped() -> None:
    x = Exchange(rig_of("axis"), profile_of(homing="drive"))
    x.drives[0].home()
    x.enable()
    x.drives[0].referenced = False
    x.run(0.1, ON)
    assert "not referenced any more" in fault(x)
    assert x.plant.modes == ["off"]


def test_a_drive_whose_reference_comes_back_never_enables_by_itself() -> None:
    x = Exchange(rig_of("axis"), profile_of(homing="drive"))
    x.drives[0].home()
    x.arm()
    obey, x.drives[0].stage.obey = x.drives[0].stage.obey, lambda *a, **k: None
    x.run(0.05, ON)
    x.drives[0].referenced = False
    x.run(0.05, ON)
    assert x.phases() == {DrivePhase.CONFIGURED}
    x.drives[0].referenced, x.drives[0].stage.obey = True, obey
    since_s = x.now_s
    x.run(0.3, ON)
    assert enables_sent(x, since_s) == 0
    assert "ask for off, then for on" in (x.bus[0].status.waiting_for or "")


def test_an_error_frame_is_no_reason_to_speak_before_having_listened() -> None:
    x = Exchange(rig_of("motorcycle"))
    x.run(0.02)
    x.inject(Frame(x.bus[0].frames.error, bytes((3,)) + bytes(7)))
    x.run(0.2)
    assert x.sent == []
    fault(x)


def test_a_drive_that_does_not_enable_is_named() -> None:
    x = Exchange(rig_of())
    x.arm()
    for drive in x.drives:
        drive.started = False  # it forgot System Start: control words do nothing
    x.run(1.5, ON)
    assert "did not enable within 1 s" in fault(x)


def test_repeat_for_ever_is_a_fault() -> None:
    x = enabled()
    x.drives[0].repeat(10_000)
    x.run(1.5, ON)
    assert "asked 100 times in a row to repeat parameter" in fault(x)


def test_repeats_are_asked_again_and_counted() -> None:
    x = enabled()
    before = len(x.samples)
    x.drives[0].repeat(5)
    x.run(0.2, ON)
    status = x.bus[0].status
    assert status.repeats == 5
    assert status.phase is DrivePhase.ENABLED
    assert len(x.samples) - before == 15
    kinds = [s.quantity for s in x.samples[-10:]]
    assert kinds in (["position", "force"] * 5, ["force", "position"] * 5)


def test_a_quantity_that_the_drive_does_not_know_refuses_to_become_ready() -> None:
    parameters = profile_of().model_dump()["parameters"]
    parameters["measurements"]["force"]["number"] = 999
    x = Exchange(rig_of(), profile_of(parameters=parameters), drives_profile=profile_of())
    x.run(1.0)
    assert "does not answer its force (parameter 999): unknown parameter" in fault(x)


def test_a_measurement_that_is_no_number_is_a_fault_and_no_sample() -> None:
    parameters = profile_of().model_dump()["parameters"]
    parameters["measurements"]["position"]["type"] = "float32"
    profile = profile_of(parameters=parameters)
    x = Exchange(rig_of(), profile)
    x.enable()
    nan = (0x7FC0_0000).to_bytes(4, "little")
    take = x._take

    def poisoned(now_s: float, frame: Frame) -> None:
        if frame.can_id == 0x52A and frame.data[0] == 400 & 0xFF:
            frame = Frame(frame.can_id, frame.data[:3] + nan + b"\0")
        take(now_s, frame)

    x._take = poisoned
    x.run(0.1, ON)
    assert "with no number" in fault(x)
    assert all(s.value == s.value for s in x.samples)
