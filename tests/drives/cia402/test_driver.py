"""Our master and our simulated drive: from boot-up to force, and everything that can be wrong on the way."""

from __future__ import annotations

import dataclasses
import math

import pytest

from hil.drives.cia402 import codec
from hil.drives.cia402.aborts import CODES, SdoAbort
from hil.drives.cia402.bus import CanopenBus
from hil.drives.cia402.objects import ObjectDictionary, ObjectEntry
from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.power import PowerState
from hil.errors import ConfigError
from hil.frames import Frame
from tests.drives.cia402.exchange import Exchange, profile_of, rig_of, with_drive

NODE = 1
IDS = codec.node_ids(NODE)


def words(exchange: Exchange) -> list[int]:
    """Control words in the order in which they were sent first."""
    seen: list[int] = []
    for _, frame in exchange.sent:
        if frame.can_id == IDS.rpdo:
            word = int.from_bytes(frame.data[:2], "little")
            if not seen or seen[-1] != word:
                seen.append(word)
    return seen


# the way up


def test_from_boot_up_to_ready_everything_is_written_and_read_back():
    x = Exchange()
    x.reach(DrivePhase.READY)
    objects = x.drives[0].objects
    assert objects.value(0x1016, 1) == 127 << 16 | 100
    assert objects.value(0x6007) == 1
    assert objects.value(0x1017) == 50
    assert objects.value(0x6060) == 8
    assert (objects.value(0x60C2, 1), objects.value(0x60C2, 2)) == (1, -3)
    assert objects.value(0x607D, 1) == -2_500_000
    assert objects.value(0x6072) == 3000
    assert objects.value(0x1400, 1) == 0x200 + NODE
    assert objects.value(0x1400, 2) == 1
    assert [e.index for e in objects.mapped(0x1600)] == [0x6040, 0x607A]
    assert [e.index for e in objects.mapped(0x1A00)] == [0x6041, 0x6064, 0x6077]
    assert x.bus[0].status.watchdog_ok


def test_nothing_is_said_before_we_have_listened():
    x = Exchange()
    x.run(0.24)
    assert x.sent == []


def test_the_power_stage_goes_through_its_states_one_by_one():
    x = Exchange()
    x.enable()
    assert words(x) == [0x06, 0x07, 0x0F]
    x.run(0.05, PowerGoal.OFF)
    assert words(x)[-1] == 0x06
    assert x.drives[0].power is PowerState.READY_TO_SWITCH_ON


def test_setpoints_act_at_the_sync_after_them_and_samples_hold_for_theirs():
    x = Exchange()
    x.enable()
    x.samples.clear()
    x.run(0.1, PowerGoal.ON, lambda t: [0.01 * math.sin(20.0 * t)])
    positions = [s for s in x.samples if s.quantity == "position"]
    assert len(positions) == pytest.approx(100, abs=2)
    for s in positions:
        phase = s.sampled_s / x.rig.bus.cycle % 1.0
        assert phase * x.rig.bus.cycle == pytest.approx(47e-6, abs=2e-6)
    assert x.bus[0].status.pairs >= x.bus[0].status.slots - 1


def test_a_drive_that_runs_already_is_found_by_asking():
    x = Exchange()
    x.drives[0].on_time(1.0)  # it booted long ago and has no heartbeat
    x.reach(DrivePhase.READY)
    assert x.named("drive_rebooted") == []


@pytest.mark.parametrize(
    ("mode", "cyclic", "code", "length"),
    [
        ("drive", "position", 8, 6),
        ("drive", "velocity", 9, 6),
        ("computed_torque", "position", 10, 4),
        ("cascade", "position", 10, 4),
    ],
)
def test_each_control_mode_has_its_mode_of_operation(mode, cyclic, code, length):
    x = Exchange(with_drive(rig_of(control={"mode": mode}), cyclic=cyclic))
    x.enable()
    assert x.drives[0].objects.value(0x6060) == code
    assert {len(f.data) for _, f in x.sent if f.can_id == IDS.rpdo} == {length}


def test_a_drive_without_csp_interpolates():
    x = Exchange(profile=profile_of(simulated={"modes": 0x41}))
    x.enable()
    assert x.drives[0].objects.value(0x6060) == 7
    x.run(0.02, PowerGoal.ON, lambda t: [0.001])
    assert words(x)[-1] == 0x1F
    assert x.plant.positions[0] == pytest.approx(0.001)


def test_a_drive_without_the_mode_that_is_needed_is_refused_by_name():
    x = Exchange(rig_of(control={"mode": "cascade"}), profile_of(simulated={"modes": 0x81}))
    x.reach(DrivePhase.FAULT)
    assert x.named("drive_mode")
    assert "no mode cst" in x.error()


def test_a_drive_that_takes_the_mode_and_stays_in_another_is_refused_by_name():
    x = Exchange()
    x.drives[0].objects.live[0x6061, 0] = lambda: -1
    x.reach(DrivePhase.FAULT)
    assert x.named("drive_mode")
    assert "set to mode csp (0x6060 = 8) and took it, but stays in mode -1 (0x6061)" in x.error()


def test_a_drive_that_shows_its_mode_a_little_later_is_waited_for():
    x = Exchange()
    objects, reads = x.drives[0].objects, iter(range(1000))
    objects.live[0x6061, 0] = lambda: objects.value(0x6060) if next(reads) > 20 else 0
    x.reach(DrivePhase.READY)


def test_a_drive_that_must_be_homed_waits_for_it():
    profile = profile_of(homing={"kind": "drive"})
    x = Exchange(profile=profile)
    x.run(1.0)
    assert x.phases() == {DrivePhase.CONFIGURED}
    assert "home it" in (x.bus[0].status.waiting_for or "")


# what watches whom


def test_the_drive_watches_our_heartbeat():
    x = Exchange()
    x.enable()
    assert any(f.can_id == 0x77F for _, f in x.sent)
    x.master_speaks = False
    x.run(0.07)
    assert x.drives[0].power is PowerState.OPERATION_ENABLED
    x.run(0.05)
    assert x.drives[0].power is PowerState.FAULT_REACTION
    codes = [codec.decode_emcy(f.data).code for _, f in x.heard if f.can_id == IDS.emcy]
    assert codes == [0x8130]


@pytest.mark.parametrize(
    ("reaction", "power"),
    [
        (1, PowerState.FAULT_REACTION),
        (2, PowerState.SWITCH_ON_DISABLED),
        (3, PowerState.QUICK_STOP_ACTIVE),
    ],
)
def test_the_abort_connection_reaction_is_the_one_chosen(reaction, power):
    x = Exchange(profile=profile_of(supervision={"abort_reaction": reaction}))
    x.enable()
    x.master_speaks = False
    x.run(0.15)
    assert x.drives[0].power is power


def test_we_watch_the_drives_heartbeat_and_state():
    x = Exchange()
    x.enable()
    x.drives[0].objects.put((0x1017, 0), 0)  # it goes on answering SYNC
    x.run(0.4, PowerGoal.ON)
    assert "heartbeat" in x.error()
    x = Exchange()
    x.enable()
    x.drives[0].nmt = codec.NmtState.PRE_OPERATIONAL
    x.run(0.5, PowerGoal.ON)
    assert x.phases() == {DrivePhase.FAULT}


def test_a_drive_that_vanishes_is_named_and_found_again_after_a_reset():
    x = Exchange()
    x.enable()
    x.drives[0].silence()
    x.run(0.3, PowerGoal.ON)
    assert x.named("drive_silent")
    x.drives[0].silence(silent=False)
    x.run(0.3, PowerGoal.OFF)
    assert x.phases() == {DrivePhase.FAULT}
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_a_drive_that_boots_late_comes_up_when_it_does():
    x = Exchange()
    x.drives[0].silence()
    x.run(3.0)
    assert x.phases() == {DrivePhase.ABSENT}
    assert "has not been heard" in (x.bus[0].status.waiting_for or "")
    x.drives[0].silence(silent=False)
    x.drives[0].reboot(x.now_s)
    x.reach(DrivePhase.READY)


def test_a_reboot_while_running_is_a_fault_and_after_a_reset_all_is_written_anew():
    x = Exchange()
    x.enable()
    x.drives[0].reboot(x.now_s)
    x.run(0.6, PowerGoal.ON)
    assert x.phases() == {DrivePhase.FAULT}
    assert x.drives[0].power is not PowerState.OPERATION_ENABLED
    x.reach(DrivePhase.READY, PowerGoal.RESET)
    assert x.drives[0].objects.value(0x1016, 1) == 127 << 16 | 100
    x.reach(DrivePhase.ENABLED, PowerGoal.ON)


def test_a_fault_is_reset_by_an_edge_and_never_by_itself():
    x = Exchange()
    x.enable()
    x.answer(x.drives[0].set_fault(0x2310))
    x.run(0.5, PowerGoal.ON)
    assert "continuous overcurrent" in x.error()
    x.run(0.5, PowerGoal.OFF)
    assert x.drives[0].power is PowerState.FAULT
    x.reach(DrivePhase.READY, PowerGoal.RESET)
    x.run(0.5, PowerGoal.OFF)
    x.reach(DrivePhase.ENABLED, PowerGoal.ON)


def test_a_drive_that_stays_on_when_told_to_be_off_is_named():
    x = Exchange()
    x.enable()
    x.drives[0]._power.obey = lambda *a: None  # it answers and heeds no control word
    x.run(1.2, PowerGoal.OFF)
    assert "axis (node 1) still makes force" in x.error()
    assert words(x)[-1] == 0x00
    assert len(x.named("drive_stays_on")) == 1


@pytest.mark.parametrize("lost", [(IDS.rpdo,), (codec.SYNC_ID,)], ids=["control words", "SYNC"])
def test_a_drive_that_does_not_hear_that_it_is_to_be_off_is_left_to_its_watchdog(lost):
    x = Exchange(rig_of(control={"mode": "computed_torque"}))
    x.enable()
    drive = x.drives[0]
    heeds = drive.on_frame
    drive.on_frame = lambda now_s, f: [] if f.can_id in lost else heeds(now_s, f)
    x.run(0.5, PowerGoal.OFF)
    assert drive.power in (PowerState.FAULT_REACTION, PowerState.FAULT)
    x.run(0.3, PowerGoal.OFF)
    assert x.plant.modes == ["off"]
    (event,) = x.named("heartbeat_stopped")
    assert "axis not off" in event.text
    drive.on_frame = heeds
    x.reach(DrivePhase.READY, PowerGoal.RESET)
    x.run(0.1, PowerGoal.OFF)
    x.reach(DrivePhase.ENABLED, PowerGoal.ON)


def test_a_drive_that_stays_in_its_quick_stop_is_told_to_leave_it():
    """With some options of 0x605A it holds for ever, and "ready to switch on" is no way out of that."""
    x = Exchange()
    x.enable()
    x.run(0.05, PowerGoal.OFF)
    drive = x.drives[0]
    drive._power.state = PowerState.QUICK_STOP_ACTIVE
    x.plant.set_mode(0, "position")
    x.run(0.05, PowerGoal.OFF)
    assert drive.power is PowerState.READY_TO_SWITCH_ON
    assert x.plant.modes == ["off"]
    drive._power.obey = lambda *a: None
    drive._power.state = PowerState.QUICK_STOP_ACTIVE
    x.run(0.6, PowerGoal.OFF)
    assert x.named("heartbeat_stopped")


def test_a_loop_that_stood_still_has_not_told_the_drive_to_be_off():
    x = Exchange(rig_of(safety={"drive_watchdog": 0.5}))
    x.enable()
    x.master_speaks = False
    x.run(0.4)
    x.inject(Frame(IDS.heartbeat, b"\x05"))
    x.master_speaks = True
    x.run(0.1, PowerGoal.ON)
    assert x.named("drive_silent")
    assert x.named("heartbeat_stopped") == x.named("drive_stays_on") == []
    assert x.plant.modes == ["off"]


def test_a_drive_that_is_gone_altogether_does_not_stop_the_others():
    x = Exchange(rig_of("stewart_canopen"))
    x.enable()
    x.drives[0].silence()
    x.run(1.0, PowerGoal.OFF)
    assert x.named("heartbeat_stopped") == []
    assert {d.power for d in x.drives[1:]} == {PowerState.READY_TO_SWITCH_ON}


def test_quick_stop_and_its_end():
    x = Exchange()
    x.enable()
    drive = x.drives[0]
    drive.objects.put((0x6007, 0), 0)
    data = (0x0002).to_bytes(2, "little") + bytes(4)
    drive.on_frame(x.now_s, Frame(IDS.rpdo, data))
    drive.on_frame(x.now_s, Frame(codec.SYNC_ID))
    assert drive.power is PowerState.QUICK_STOP_ACTIVE
    drive.on_time(x.now_s + 0.3)
    assert drive.power is PowerState.SWITCH_ON_DISABLED


def test_disable_ends_a_quick_stop_at_once_and_it_comes_back_to_nobody():
    x = Exchange()
    x.enable()
    drive, now_s = x.drives[0], x.now_s
    for word in (0x02, 0x00):
        now_s += 1e-3
        drive.on_frame(now_s, Frame(IDS.rpdo, bytes((word, 0)) + bytes(4)))
        drive.on_frame(now_s, Frame(codec.SYNC_ID))
    assert drive.power is PowerState.SWITCH_ON_DISABLED
    assert x.plant.modes == ["off"]
    assert drive._power.off_s == math.inf


def test_loss_of_the_motors_supply_is_told():
    x = Exchange()
    x.enable()
    x.drives[0].set_voltage(x.now_s, present=False)
    x.run(0.1, PowerGoal.ON)
    assert x.named("enpo_lost")


# bad input


def test_another_drive_in_its_place_is_refused_by_name_and_taken_when_the_right_one_is_back():
    x = Exchange()
    x.drives[0].objects.put((0x1018, 2), 0x999)
    x.reach(DrivePhase.FAULT)
    assert x.named("drive_identity")
    assert "0x999" in x.error()
    x.drives[0].objects.put((0x1018, 2), 0x402)
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_a_drive_whose_setting_would_turn_the_rig_round_is_refused_by_name():
    x = Exchange()
    x.drives[0].objects.put((0x607E, 0), 0xC0)
    x.reach(DrivePhase.FAULT)
    assert x.named("drive_setting")
    assert (
        "has 0xc0 in 0x607e:00 (Polarity), the drive file expects 0x0: positions would" in x.error()
    )
    x.drives[0].objects.put((0x607E, 0), 0)
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_two_drives_of_one_number_are_never_made_ready():
    """Both would heed our process data, and two actuators move where one is led."""
    x = Exchange()
    answer = x.answer
    x.answer = lambda frames: answer(
        [f for at_s, g in frames for f in ((at_s, g), (at_s + 2e-3, g))]
    )
    x.reach(DrivePhase.FAULT)
    assert x.named("drive_doubled")
    assert "axis (node 1) answers twice" in x.error()
    x.answer = answer
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_a_device_that_is_no_servo_drive():
    x = Exchange()
    x.drives[0].objects.put((0x1000, 0), 401)
    x.reach(DrivePhase.FAULT)
    assert "401" in x.error()


def test_a_mapping_that_the_drive_refuses():
    x = Exchange()
    x.drives[0].objects.refused[0x1A00, 3] = "not_mappable"
    x.reach(DrivePhase.FAULT)
    assert x.named("mapping_refused")
    assert "not_mappable" in x.error()
    assert x.drives[0].power is PowerState.SWITCH_ON_DISABLED
    x.drives[0].objects.refused.clear()
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_an_eds_that_promises_more_than_the_drive_has():
    shipped = profile_of()
    poor = ObjectDictionary(
        {k: e for k, e in shipped.objects.entries.items() if k != (0x607F, 0)},
        shipped.objects.vendor,
        shipped.objects.product,
    )
    x = Exchange(theirs=shipped.model_copy(update={"objects": poor}))
    x.reach(DrivePhase.FAULT)
    assert x.named("wrong_eds")
    assert "0x607f" in x.error()


def without(*gone):
    """The shipped drive file, objects of its EDS left out."""
    shipped = profile_of()
    entries = {k: e for k, e in shipped.objects.entries.items() if k not in gone}
    objects = dataclasses.replace(shipped.objects, entries=entries)
    return shipped.model_copy(update={"objects": objects})


def test_a_drive_that_has_no_revision_by_its_eds_is_not_asked_for_it():
    x = Exchange(profile=without((0x1018, 3), (0x1018, 4)))
    x.reach(DrivePhase.READY)


def test_a_drive_without_remote_frames_keeps_the_bit_that_says_so():
    x = Exchange()
    objects = x.drives[0].objects
    objects.put((0x1800, 1), 0x4000_0180 + NODE)
    written = objects.before_write

    def refuse(key, value):
        if key == (0x1800, 1) and not value & 0x4000_0000:
            raise SdoAbort(CODES["value_range"])
        written(key, value)

    objects.before_write = refuse
    x.enable()
    assert objects.value(0x1800, 1) == 0x4000_0180 + NODE


def test_pdos_beyond_the_fourth_are_switched_off_too():
    shipped = profile_of()
    more = {
        (index, 1): dataclasses.replace(shipped.objects[base, 1], index=index, default=default)
        for base, index, default in ((0x1401, 0x1404, 0x321), (0x1801, 0x1804, 0x221))
    }
    objects = dataclasses.replace(shipped.objects, entries={**shipped.objects.entries, **more})
    x = Exchange(profile=shipped.model_copy(update={"objects": objects}))
    x.reach(DrivePhase.READY)
    for index in (0x1401, 0x1403, 0x1404, 0x1801, 0x1803, 0x1804):
        assert x.drives[0].objects.value(index, 1) & 0x8000_0000, f"{index:#x}"


def test_an_eds_of_something_else_is_refused_when_it_is_read():
    shipped = profile_of()
    few = {k: e for k, e in shipped.objects.entries.items() if k[0] < 0x6000}
    with pytest.raises(ConfigError, match="no EDS of a drive"):
        shipped.with_objects(ObjectDictionary(few, source="x.eds"))
    wrong = dict(shipped.objects.entries)
    wrong[0x6064, 0] = ObjectEntry(0x6064, 0, "Position actual value", 0x03, "ro")
    with pytest.raises(ConfigError, match="2 bytes"):
        shipped.with_objects(ObjectDictionary(wrong, source="x.eds"))


def test_a_storm_of_emergencies_is_one_fault_and_one_warning_a_second():
    x = Exchange()
    x.enable()
    x.drives[0].storm(x.now_s)
    x.run(2.0, PowerGoal.ON)
    assert len(x.named("drive_error")) == 1
    assert 1 <= len(x.named("emcy_storm")) <= 3
    assert len(x.error()) < 600
    x.drives[0].storm(x.now_s, on=False)
    x.run(0.5, PowerGoal.OFF)
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_pdos_of_a_wrong_length_are_counted_and_three_in_a_row_are_a_fault():
    x = Exchange()
    x.enable()
    x.drives[0].wrong_pdos(2)
    x.run(0.1, PowerGoal.ON)
    assert x.phases() == {DrivePhase.ENABLED}
    assert x.bus[0].status.garbage == 2
    x.drives[0].wrong_pdos(3)
    x.run(0.1, PowerGoal.ON)
    assert x.named("wrong_pdo")
    x.run(0.2, PowerGoal.OFF)
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_garbage_on_its_identifiers_never_raises():
    x = Exchange()
    x.enable()
    for can_id in x.bus[0].ids() - {IDS.emcy}:
        for length in range(9):
            x.inject(Frame(can_id, b"\xa5" * length))
            x.inject(Frame(can_id, b"\xa5" * length, is_remote=True))
    x.run(0.05)
    assert x.bus[0].status.garbage > 10


def test_a_stranger_is_told_once():
    x = Exchange()
    x.run(0.1)
    for _ in range(5):
        x.inject(Frame(0x700 + 44, b"\x05"))
    x.run(0.1)
    assert [e.text for e in x.named("unknown_drive")] == [
        "node 44 is on the bus, which no actuator of the rig file has"
    ]


# what the drive does by itself


@pytest.mark.parametrize(
    ("reactions", "moved"),
    [
        (("extrapolate", "extrapolate", "extrapolate"), (1.0, 2.0, 3.0)),
        (("extrapolate", "hold", "hold"), (1.0, 1.0, 1.0)),
        (("hold", "hold", "hold"), (0.0, 0.0, 0.0)),
    ],
)
def test_one_two_and_three_missed_setpoints_do_what_the_file_says(reactions, moved):
    x = Exchange(profile=profile_of(simulated={"missed_setpoints": reactions}))
    x.enable()
    step = 1e-5
    x.run(0.05, PowerGoal.ON, lambda t: [step * t / x.rig.bus.cycle])
    drive, ids = x.drives[0], Frame(codec.SYNC_ID)
    x.master_speaks = False
    x.drain(x.now_s + 0.3e-3)
    drive.on_frame(x.now_s, ids)  # takes the last one that was sent
    start = x.plant.positions[0]
    for k, expected in enumerate(moved):
        drive.on_frame(x.now_s + (k + 1) * 1e-3, ids)
        assert (x.plant.positions[0] - start) / step == pytest.approx(expected, abs=0.02)
    assert drive.missed == 3


def test_missed_setpoints_may_be_a_fault():
    x = Exchange(profile=profile_of(simulated={"missed_setpoints": ("hold", "hold", "fault")}))
    x.enable()
    x.master_speaks = False
    x.run(0.02)
    assert x.drives[0].power is PowerState.FAULT_REACTION
    assert "setpoints missed" in x.error()


def test_a_following_error_trips_after_its_time():
    x = Exchange()
    x.enable()
    x.drives[0].objects.put((0x6065, 0), 10)
    x.plant.set_setpoint = lambda *_: None  # it is held
    x.run(0.015, PowerGoal.ON, lambda t: [0.001])
    assert x.phases() == {DrivePhase.ENABLED}
    x.run(0.02, PowerGoal.ON, lambda t: [0.001])
    assert "following error" in x.error()


def test_the_end_of_the_stroke_trips_and_a_reset_drive_may_move_back():
    x = Exchange()
    x.enable()
    x.plant.set_setpoint = lambda *_: None
    x.plant.positions[0] = 0.251
    x.run(0.05, PowerGoal.ON)
    assert x.named("course_limitation")
    x.run(0.3, PowerGoal.OFF)
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_a_limit_that_the_drive_cannot_hold_is_refused_when_the_drivers_are_built():
    with pytest.raises(
        ConfigError, match=r"axis: its lower position limit does not fit.*0x607d:01"
    ):
        Exchange(with_drive(rig_of(), counts_per_unit=1e10))


def test_a_node_number_that_there_is_not_is_refused():
    with pytest.raises(ConfigError, match=r"axis has actuators\.drive\.address 0"):
        CanopenBus(with_drive(rig_of(), address=0), {"cia402": profile_of()})


def test_a_node_number_of_our_own_is_refused():
    with pytest.raises(ConfigError, match="own heartbeat"):
        Exchange(with_drive(rig_of(), address=127))
