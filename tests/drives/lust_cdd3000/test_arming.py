"""From a cold bus to force: what each step needs, and what refuses it."""

from __future__ import annotations

import pytest

from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.lust_cdd3000.codec import (
    Mode,
    decode_control,
    decode_request,
    decode_system,
    frame_ids,
    from_wire,
)
from hil.drives.power import PowerCommand
from hil.frames import Frame
from tests.drives.exchange import Exchange, profile_of, rig_of

LAYOUT = profile_of().layout
WATCHDOG = 574


def requests(exchange: Exchange, address: int = 1) -> list[tuple[int, int, int]]:
    """(number, mode, value) of every request sent to a drive."""
    can_id = frame_ids(profile_of().ids, address).request
    return [decode_request(f.data)[:3] for _, f in exchange.sent if f.can_id == can_id]


def commands(exchange: Exchange, address: int = 1) -> list[PowerCommand]:
    can_id = frame_ids(profile_of().ids, address).control
    return [decode_control(LAYOUT, f.data).command for _, f in exchange.sent if f.can_id == can_id]


def test_a_motorcycle_arms_and_holds_where_it_stands() -> None:
    x = Exchange(rig_of("motorcycle"))
    x.enable()
    assert x.now_s < 0.6, "arming takes a moment, not a wait"
    assert x.plant.modes == ["position"] * 3
    for i, actuator in enumerate(x.rig.actuators):
        assert x.plant.positions[i] == pytest.approx(actuator.home, abs=1e-4)


def test_the_phases_come_one_by_one() -> None:
    x = Exchange(rig_of())
    x.arm()
    x.run(0.2, PowerGoal.ON)
    x.run(0.1, PowerGoal.OFF)
    said = [e.text.removeprefix("axis (address 1) is ") for e in x.named("drive_phase")]
    assert said == ["logged on", "configured", "ready", "enabled", "ready"]


def test_nothing_is_sent_before_the_bus_has_been_listened_to() -> None:
    x = Exchange(rig_of("motorcycle"))
    x.run(0.5)
    assert x.sent[0][0] >= profile_of().timing.listen


def test_every_drive_was_told_to_be_off_before_system_start() -> None:
    x = Exchange(rig_of("motorcycle"))
    x.arm()
    start = next(k for k, (_, f) in enumerate(x.sent) if f.can_id == 0x0DD)
    before = {f.can_id for _, f in x.sent[:start]}
    assert {0x296, 0x297, 0x298} <= before
    assert set(commands(x)) == {PowerCommand.DISABLE, PowerCommand.PREPARE}


def test_system_start_is_sent_once_when_all_are_configured() -> None:
    x = Exchange(rig_of("motorcycle"))
    x.drives[2].repeat(20)  # the last one takes its time
    x.enable()
    x.run(1.0, PowerGoal.ON)
    starts = [(t, f) for t, f in x.sent if f.can_id == 0x0DD]
    assert len(starts) == 1
    assert decode_system(starts[0][1].data) == 1
    configured = [e.t_s for e in x.named("drive_phase") if e.text.endswith("is configured")]
    assert len(configured) == 3
    assert starts[0][0] >= max(configured)


def test_the_watchdog_is_written_and_read_back_before_anything_else() -> None:
    x = Exchange(rig_of(safety={"drive_watchdog": 0.15}))
    x.arm()
    asked = requests(x)
    assert asked[0] == (WATCHDOG, Mode.WRITE, 150)
    assert asked[1][0] != WATCHDOG, "a barrier, so that no late answer passes for the read-back"
    assert asked[2] == (WATCHDOG, Mode.READ, 0)
    assert x.drives[0].parameters.watchdog_s == pytest.approx(0.15)


def test_a_watchdog_that_reads_back_otherwise_refuses() -> None:
    """The drive says OK to the write and keeps 200 ms of its own."""

    class Stubborn(Exchange):
        def _take(self, now_s: float, frame: Frame) -> None:
            if frame.can_id == 0x52A and frame.data[:2] == (574).to_bytes(2, "little"):
                frame = Frame(frame.can_id, frame.data[:3] + (200).to_bytes(4, "little") + b"\0")
            super()._take(now_s, frame)

    x = Stubborn(rig_of())
    x.run(2.0, PowerGoal.OFF)
    x.run(2.0, PowerGoal.ON)
    status = x.bus[0].status
    assert status.phase is DrivePhase.FAULT
    assert not status.watchdog_ok
    assert "wrote 0.1 to parameter 574 (watchdog), but it reads 0.2" in (status.error or "")
    assert PowerCommand.ENABLE not in commands(x)


def test_a_late_answer_to_the_write_is_no_read_back() -> None:
    """Every answer comes one slot late, in order: nothing is verified by the answer to another question."""
    x = Exchange(rig_of())
    late = profile_of(timing={"answer_wait": 0.008})
    held: list[Frame] = []
    take = x._take

    def delayed(now_s: float, frame: Frame) -> None:
        if frame.can_id == frame_ids(late.ids, 1).answer:
            held.append(frame)
            if len(held) < 2:
                return
            frame = held.pop(0)
        take(now_s, frame)

    x._take = delayed
    x.run(2.0)
    assert x.bus[0].status.timeouts > 0
    if x.bus[0].status.watchdog_ok:
        assert x.drives[0].parameters.watchdog_s == pytest.approx(0.1)


def test_precontrol_is_switched_on_where_the_rig_file_asks() -> None:
    x = Exchange(rig_of(control={"precontrol": True}))
    x.arm()
    gains = x.plant.gains[0]
    assert (gains["velocity_ff"], gains["acceleration_ff"], gains["friction_ff"]) == (1.0, 1.0, 1.0)
    ahead = profile_of().parameters.precontrol
    written = {n: v for n, mode, v in requests(x) if mode == Mode.WRITE}
    assert from_wire(ahead.velocity.type, written[ahead.velocity.number]) == 1.0


def test_what_the_drive_already_holds_is_not_written() -> None:
    x = Exchange(rig_of())
    x.arm()
    assert [n for n, mode, _ in requests(x) if mode == Mode.WRITE] == [WATCHDOG]


def test_precontrol_of_an_earlier_run_is_switched_off() -> None:
    x = Exchange(rig_of())
    ahead = profile_of().parameters.precontrol.velocity
    x.drives[0].parameters.answer(ahead.number, Mode.WRITE, 65536, enabled=False)
    assert x.plant.gains[0]["velocity_ff"] == 1.0
    x.arm()
    assert x.plant.gains[0]["velocity_ff"] == 0.0


def test_a_parameter_that_cannot_be_what_the_drive_file_says_is_not_written() -> None:
    """Number 420 holds a float32 gain: read as a share it is absurd, so nothing is written to it."""
    parameters = profile_of().model_dump()["parameters"]
    parameters["precontrol"]["velocity"]["number"] = 420
    x = Exchange(
        rig_of(control={"precontrol": True}),
        profile_of(parameters=parameters),
        drives_profile=profile_of(),
    )
    x.run(2.0)
    status = x.bus[0].status
    assert status.phase is DrivePhase.FAULT
    assert "correct its number or type in the drive file" in (status.error or "")
    assert (420, Mode.WRITE) not in {(n, mode) for n, mode, _ in requests(x)}


def test_a_parameter_that_the_drive_does_not_know_is_named() -> None:
    parameters = profile_of().model_dump()["parameters"]
    parameters["operating_mode"]["number"] = 4711
    x = Exchange(rig_of(), profile_of(parameters=parameters), drives_profile=profile_of())
    x.run(2.0)
    assert "parameter 4711 (operating mode) was refused: unknown parameter" in (
        x.bus[0].status.error or ""
    )


def test_gains_that_differ_from_the_rig_file_are_told_but_do_not_refuse() -> None:
    x = Exchange(rig_of())
    gain = profile_of().parameters.gains.position
    stored = x.drives[0].parameters._stored[gain.number]
    stored.show = lambda _: 70.0
    x.arm()
    (event,) = x.named("drive_gain_differs")
    assert "position gain in the drive is 70, the rig file says 80" in event.text


def test_the_force_modes_choose_torque_references() -> None:
    x = Exchange(rig_of(control={"mode": "computed_torque"}))
    assert x.bus[0].setpoint_kind == "force"
    x.enable()
    x.run(0.1, PowerGoal.ON, [123.0])
    assert x.plant.modes == ["force"]
    assert x.plant.forces == [123.0]


def test_setpoints_reach_the_drive_in_its_increments() -> None:
    x = Exchange(rig_of())
    x.enable()
    x.run(0.1, PowerGoal.ON, [0.0123456])
    assert x.plant.positions[0] == pytest.approx(0.012346, abs=1e-9)


def test_no_setpoint_holds_the_last_one_and_no_number_is_none() -> None:
    x = Exchange(rig_of())
    x.enable()
    for setpoint in (0.01, None, float("nan"), float("inf")):
        x.run(0.05, PowerGoal.ON, [setpoint])
        assert x.plant.positions[0] == pytest.approx(0.01, abs=1e-6)


def test_a_drive_without_enpo_is_named_and_comes_when_it_is_there() -> None:
    x = Exchange(rig_of())
    x.drives[0].set_enpo(0.0, present=False)
    x.run(1.0)
    status = x.bus[0].status
    assert status.phase is DrivePhase.CONFIGURED
    assert status.waiting_for == "axis (address 1): its hardware enable ENPO is not there"
    x.drives[0].set_enpo(x.now_s, present=True)
    x.arm()


def test_a_drive_that_homes_itself_is_waited_for() -> None:
    profile = profile_of(homing="drive")
    x = Exchange(rig_of(), profile)
    x.run(1.0)
    assert "not referenced: home it" in (x.bus[0].status.waiting_for or "")
    assert not x.bus[0].status.referenced
    x.drives[0].home()
    x.arm()


def test_on_must_be_given_anew_when_the_drive_is_ready() -> None:
    x = Exchange(rig_of())
    x.run(1.0, PowerGoal.ON)
    status = x.bus[0].status
    assert status.phase is DrivePhase.READY
    assert "ask for off, then for on" in (status.waiting_for or "")
    assert PowerCommand.ENABLE not in commands(x)
    x.run(0.05, PowerGoal.OFF)
    x.run(0.1, PowerGoal.ON)
    assert x.phases() == {DrivePhase.ENABLED}


def test_off_takes_the_power_and_on_brings_it_back() -> None:
    x = Exchange(rig_of())
    x.enable()
    x.run(0.1, PowerGoal.OFF)
    assert x.phases() == {DrivePhase.READY}
    assert x.plant.modes == ["off"]
    x.run(0.1, PowerGoal.ON)
    assert x.phases() == {DrivePhase.ENABLED}


def test_positioning_mode_arms_as_well() -> None:
    x = Exchange(rig_of(), profile_of(layout={"kind": "posmod", "status_carries_position": True}))
    x.enable()
    x.run(0.1, PowerGoal.ON, [0.02])
    assert x.plant.positions[0] == pytest.approx(0.02, abs=1e-6)
    positions = [s for s in x.samples if s.quantity == "position"]
    assert positions[-1].value == pytest.approx(0.02, abs=1e-4)


def test_the_layout_of_the_cda3000_arms_as_well() -> None:
    x = Exchange(rig_of(), profile_of(layout={"value_byte": 2, "flags_byte": 6}))
    x.enable()
    x.run(0.1, PowerGoal.ON, [-0.05])
    assert x.plant.positions[0] == pytest.approx(-0.05, abs=1e-6)


def test_stride_two_arms_where_the_drives_have_it_too() -> None:
    x = Exchange(rig_of("motorcycle"), profile_of(ids={"stride": 2}))
    x.enable()
    assert {f.can_id for _, f in x.sent} == {0x0DD, 663, 665, 667, 1103, 1105, 1107}
