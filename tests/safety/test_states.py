"""How the rig goes from state to state, and what a person is told."""

from __future__ import annotations

import pytest

from hil.configfile import load_rig
from hil.drives.driver import DrivePhase, PowerGoal
from hil.safety import Cause, Command, Finding, MotionGoal, StateName, state_settings
from hil.safety.conditions import POWER_ON_S, RESET_S
from hil.safety.states import RESUME_S
from tests.safety.rig_bench import CLIENT, DT, SETTINGS, Bench

OFFLINE, PREPARING, PARKED, READY, ENGAGED, PARKING, FAULT, EMERGENCY = StateName
SAME_CLIENT = {"cue_client": CLIENT}


@pytest.fixture
def bench() -> Bench:
    return Bench()


# -- the normal way ------------------------------------------------------------------------------------


def test_a_whole_ride(bench: Bench) -> None:
    seen = []
    bench.step()
    seen.append(bench.state.name)
    bench.phases = [DrivePhase.LOGGED_ON, DrivePhase.ABSENT]
    seen.append(bench.step().state)
    bench.phases = [DrivePhase.READY, DrivePhase.READY]
    seen.append(bench.step().state)
    assert bench.ask(Command.CHECK) == (True, "the rig can be armed")
    assert bench.ask(Command.ARM)[0]
    seen.append(bench.state.name)
    out = bench.run(0.1)
    assert (out.power, out.motion, out.armed) == (PowerGoal.ON, MotionGoal.HOLD, True)
    bench.step(cue_age_s=0.0)
    seen.append(bench.state.name)
    moving = {"at_rest": False, "at_parked": False, "near_parked": False}
    assert bench.step(cue_age_s=0.1, **moving).motion is MotionGoal.FOLLOW
    assert bench.ask(Command.PARK, cue_age_s=0.1, **moving)[0]
    seen.append(bench.state.name)
    assert bench.step(cue_age_s=0.1, **moving).motion is MotionGoal.PARK
    out = bench.step(cue_age_s=0.1)
    seen.append(out.state)
    assert (out.power, out.motion) == (PowerGoal.ON, MotionGoal.HOLD)
    assert bench.ask(Command.DISARM)[0]
    out = bench.step()
    assert (out.state, out.power, out.motion, out.armed) == (
        PARKED, PowerGoal.OFF, MotionGoal.NONE, False,
    )  # fmt: skip
    assert seen == [OFFLINE, PREPARING, PARKED, READY, ENGAGED, PARKING, PARKED]
    assert bench.events.count("rig_state") == 6
    assert set(bench.events) == {"rig_state"}


def test_cues_do_not_engage_a_rig_whose_drives_are_not_on_yet(bench: Bench) -> None:
    bench.parked()
    bench.ask(Command.ARM, cue_age_s=0.0)
    bench.phases = [DrivePhase.ENABLED, DrivePhase.READY]
    bench.changed[1] = {"enabled": False}
    out = bench.step(cue_age_s=0.0)
    assert (out.state, out.motion) == (READY, MotionGoal.HOLD)
    bench.changed[1] = {}
    bench.phases[1] = DrivePhase.ENABLED
    assert bench.step(cue_age_s=0.0).state is ENGAGED


def test_after_a_park_command_cues_move_nothing_until_armed_again(bench: Bench) -> None:
    bench.parking()
    bench.inputs = {"cue_age_s": 0.0}
    bench.run(1.0)
    assert bench.state.name is PARKED
    assert bench.ask(Command.ARM)[0]
    assert bench.step().state is ENGAGED


# -- stale cues ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("age_s", "state"), [(0.2, ENGAGED), (0.2001, PARKING), (None, PARKING)])
def test_a_stale_cue_parks(bench: Bench, age_s: float | None, state: StateName) -> None:
    bench.engaged()
    out = bench.step(cue_age_s=age_s)
    assert out.state is state
    assert out.fault is None


def test_a_cue_that_comes_back_soon_engages_again_by_itself(bench: Bench) -> None:
    bench.engaged()
    bench.run(1.0, cue_age_s=1.0)
    assert bench.state.name is PARKING, "and not before it has parked"
    bench.step(cue_age_s=0.0)
    assert bench.state.name is PARKING
    bench.inputs = SAME_CLIENT
    assert bench.step(cue_age_s=1.0).state is PARKED
    assert bench.step(cue_age_s=0.0).state is ENGAGED


def test_the_cue_of_another_client_does_not_engage_it_again(bench: Bench) -> None:
    bench.engaged()
    bench.step(cue_age_s=0.3, cue_client=None)
    bench.inputs = {}
    out = bench.run(1.0, cue_age_s=0.0, cue_client="other")
    assert (out.state, out.motion) == (PARKED, MotionGoal.HOLD)
    assert bench.step(cue_age_s=0.0, **SAME_CLIENT).state is ENGAGED


def test_an_arm_lets_any_client_engage_it(bench: Bench) -> None:
    bench.engaged()
    bench.step(cue_age_s=0.3, cue_client=None)
    bench.inputs = {"cue_age_s": 0.0, "cue_client": "other"}
    bench.step()
    assert bench.ask(Command.ARM)[0]
    assert bench.run(0.1).state is ENGAGED


def test_another_clients_cue_in_place_of_the_one_it_follows_is_stale(bench: Bench) -> None:
    bench.engaged()
    out = bench.step(cue_age_s=0.0, cue_client="other")
    assert (out.state, out.motion) == (PARKING, MotionGoal.PARK)
    assert "other" in out.events[0].text


@pytest.mark.parametrize(("late_s", "state"), [(-2 * DT, ENGAGED), (2 * DT, PARKED)])
def test_a_cue_that_comes_back_late_does_not(bench: Bench, late_s: float, state: StateName) -> None:
    bench.engaged()
    bench.step(cue_age_s=0.3)
    since_s = bench.now_s
    bench.inputs = {"cue_age_s": 1.0, **SAME_CLIENT}
    bench.run(RESUME_S + late_s - DT)
    assert bench.now_s == pytest.approx(since_s + RESUME_S + late_s - DT)
    assert bench.step(cue_age_s=0.0).state is state


def test_nor_does_it_after_another_trouble_on_the_way(bench: Bench) -> None:
    bench.engaged()
    bench.step(cue_age_s=0.3)
    bench.step(cue_age_s=0.3, overruns=5)
    bench.inputs = SAME_CLIENT
    bench.run(0.1, cue_age_s=1.0)
    assert bench.run(0.1, cue_age_s=0.0).state is PARKED


def test_a_ready_rig_waits_for_cues_for_ever(bench: Bench) -> None:
    bench.ready()
    assert bench.run(3.0, cue_age_s=5.0).state is READY


# -- arming --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"watchdog_ok": False}, "watchdog"),
        ({"referenced": False}, "referenced"),
        ({"enpo": False}, "ENPO"),
    ],
)
def test_arming_is_refused_with_the_drive_and_the_reason(
    bench: Bench, changed: dict[str, object], word: str
) -> None:
    bench.parked()
    bench.changed[1] = changed
    ok, message = bench.ask(Command.ARM)
    assert not ok
    assert word in message or "enpo_lost" in message
    assert bench.step().power is PowerGoal.OFF
    assert not bench.ask(Command.CHECK)[0]


def test_arming_is_refused_off_the_parked_pose_and_park_leads_there(bench: Bench) -> None:
    bench.parked()
    away = {"near_parked": False, "at_parked": False}
    ok, message = bench.ask(Command.ARM, **away)
    assert (ok, "park it first" in message) == (False, True)
    assert bench.ask(Command.PARK, **away)[0]
    bench.phases = [DrivePhase.ENABLED, DrivePhase.READY]
    bench.changed[1] = {"enabled": False}
    out = bench.step(**away)
    assert (out.state, out.motion, out.power) == (PARKING, MotionGoal.HOLD, PowerGoal.ON)
    bench.changed[1] = {}
    bench.phases[1] = DrivePhase.ENABLED
    assert bench.step(**away).motion is MotionGoal.PARK
    assert bench.step().state is PARKED


def test_parking_from_disarmed_needs_all_that_arming_needs(bench: Bench) -> None:
    bench.parked()
    bench.changed[0] = {"watchdog_ok": False}
    assert not bench.ask(Command.PARK, near_parked=False, at_parked=False)[0]
    assert bench.step().power is PowerGoal.OFF


def test_arming_is_refused_while_drives_prepare_and_says_what_they_wait_for(bench: Bench) -> None:
    bench.preparing()
    bench.changed[0] = {"waiting_for": "left is being configured"}
    ok, message = bench.ask(Command.ARM)
    assert not ok
    assert "left is being configured" in message
    assert "right is configured" in message


@pytest.mark.parametrize(("ago_s", "ok"), [(1.9, False), (2.1, True)])
def test_a_second_master_blocks_arming_for_a_while(bench: Bench, ago_s: float, ok: bool) -> None:
    bench.parked()
    bench.step(Finding(Cause.SECOND_MASTER, "someone else sent 296#00"))
    bench.run(ago_s - DT)
    assert bench.ask(Command.ARM)[0] is ok


def test_arming_without_a_gateway_is_refused(bench: Bench) -> None:
    bench.parked()
    assert not bench.ask(Command.ARM, gateway_alive=False)[0]


def test_a_read_only_daemon_never_arms() -> None:
    settings = state_settings(load_rig("motorcycle"), read_only=True)
    bench = Bench()
    bench.machine = type(bench.machine)(
        type(SETTINGS)(
            **{
                name: getattr(settings if name == "read_only" else SETTINGS, name)
                for name in SETTINGS.__slots__
            }
        )
    )
    bench.parked()
    ok, message = bench.ask(Command.ARM)
    assert (ok, "only listens" in message) == (False, True)


@pytest.mark.parametrize(
    ("off_by_s", "state"), [(-2 * DT, READY), (2 * DT, FAULT)], ids=["in time", "too late"]
)
def test_drives_must_come_on_in_time(bench: Bench, off_by_s: float, state: StateName) -> None:
    bench.parked()
    bench.ask(Command.ARM)
    bench.phases = [DrivePhase.READY, DrivePhase.READY]
    bench.changed = [{"enabled": False}, {"enabled": False}]
    bench.run(POWER_ON_S + off_by_s)
    assert bench.state.name is state
    assert (bench.state.fault is not None) is (state is FAULT)


# -- stop, park, disarm ----------------------------------------------------------------------------------


def test_stop_holds_on_the_spot_until_park_or_disarm(bench: Bench) -> None:
    bench.engaged()
    assert bench.ask(Command.STOP)[0]
    assert bench.step().motion is MotionGoal.HOLD
    bench.inputs["at_rest"] = True
    assert bench.run(30.0).motion is MotionGoal.HOLD
    assert bench.state.name is PARKING
    assert bench.ask(Command.PARK)[0]
    assert bench.step().motion is MotionGoal.PARK


@pytest.mark.parametrize("name", [CLIENT, CLIENT.partition("@")[0]], ids=["session", "name alone"])
def test_a_client_that_is_done_parks_the_rig_that_it_moves(bench: Bench, name: str) -> None:
    bench.engaged()
    assert bench.ask(Command.FINISH, name) == (True, "the rig parks")
    assert bench.step().motion is MotionGoal.PARK
    assert bench.ask(Command.FINISH, name)[0]


def test_a_client_that_is_done_moves_nothing_that_a_person_has_stopped(bench: Bench) -> None:
    bench.engaged()
    name = CLIENT.partition("@")[0]
    assert bench.ask(Command.STOP)[0]
    ok, text = bench.ask(Command.FINISH, name)
    assert (ok, "stopped" in text) == (False, True)
    assert bench.step().motion is MotionGoal.HOLD
    bench.inputs["at_rest"] = True
    bench.run(1.0)
    assert bench.ask(Command.DISARM)[0]
    assert not bench.ask(Command.FINISH, name)[0]
    assert bench.step().power is PowerGoal.OFF


@pytest.mark.parametrize("other", ["other", CLIENT.partition("@")[0] + "@another", ""])
def test_a_client_that_is_done_leaves_the_rig_to_whom_it_follows(bench: Bench, other: str) -> None:
    bench.engaged()
    ok, text = bench.ask(Command.FINISH, other)
    assert (ok, CLIENT in text) == (False, True)
    assert bench.state.name is ENGAGED


def test_a_client_that_is_done_leaves_a_rig_ready_that_follows_nobody(bench: Bench) -> None:
    bench.ready()
    assert not bench.ask(Command.FINISH, CLIENT.partition("@")[0])[0]
    assert bench.state.name is READY


def test_a_stopped_rig_at_rest_can_be_disarmed_where_it_stands(bench: Bench) -> None:
    bench.held()
    ok, message = bench.ask(Command.DISARM)
    assert (ok, "stop it first" in message) == (False, True)
    bench.inputs["at_rest"] = True
    assert bench.ask(Command.DISARM)[0]
    assert bench.step().power is PowerGoal.OFF
    assert not bench.ask(Command.ARM)[0]


@pytest.mark.parametrize(("off_by_s", "state"), [(-2 * DT, PARKING), (2 * DT, EMERGENCY)])
def test_a_stop_that_does_not_come_to_rest_in_stop_time_is_an_emergency(
    bench: Bench, off_by_s: float, state: StateName
) -> None:
    bench.held()
    bench.run(SETTINGS.stop_time_s + off_by_s)
    assert bench.state.name is state


@pytest.mark.parametrize(("off_by_s", "state"), [(-2 * DT, PARKING), (2 * DT, EMERGENCY)])
def test_a_parking_that_takes_too_long_is_an_emergency(
    bench: Bench, off_by_s: float, state: StateName
) -> None:
    bench.parking()
    bench.run(SETTINGS.park_time_s + off_by_s)
    assert bench.state.name is state


@pytest.mark.parametrize("way", ["ready", "parking", "held", "ramping"])
def test_a_rig_that_is_told_to_leave_and_is_not_off_in_its_time_is_cut(
    bench: Bench, way: str
) -> None:
    getattr(bench, way)()
    name = bench.state.name
    assert bench.step(leaving_s=SETTINGS.leave_time_s).state is name
    out = bench.step(leaving_s=SETTINGS.leave_time_s + 1e-6)
    assert (out.state, out.power, out.armed) == (EMERGENCY, PowerGoal.OFF, False)
    assert bench.events[-2:] == ["leave_timeout", "rig_state"]


def test_what_may_take_its_time_on_the_way_out_has_it() -> None:
    parts_s = POWER_ON_S + SETTINGS.park_time_s + SETTINGS.stop_time_s
    assert SETTINGS.leave_time_s > parts_s


@pytest.mark.parametrize("way", ["engaged", "parking", "ramping"])
def test_disarm_is_refused_while_the_rig_may_move(bench: Bench, way: str) -> None:
    getattr(bench, way)()
    ok, _ = bench.ask(Command.DISARM)
    assert not ok
    assert bench.step().power is PowerGoal.ON


def test_stop_in_ready_keeps_cues_from_engaging(bench: Bench) -> None:
    bench.ready()
    assert bench.ask(Command.STOP)[0]
    assert bench.run(0.1, cue_age_s=0.0).state is PARKED


@pytest.mark.parametrize("way", ["offline", "preparing", "faulted", "emergency"])
@pytest.mark.parametrize("command", [Command.ARM, Command.PARK, Command.CHECK])
def test_nothing_powers_the_drives_from_here(bench: Bench, way: str, command: Command) -> None:
    getattr(bench, way)()
    ok, message = bench.ask(command)
    assert not ok
    assert bench.state.name.value in message
    assert bench.step().power is not PowerGoal.ON


# -- fault and reset ---------------------------------------------------------------------------------------


def test_a_fault_in_motion_ramps_to_the_parked_pose_then_switches_off_and_stays(
    bench: Bench,
) -> None:
    bench.ramping()
    out = bench.step()
    assert (out.motion, out.power, out.armed) == (MotionGoal.PARK, PowerGoal.ON, True)
    assert out.fault is not None
    assert out.fault.cause is Cause.COURSE_LIMIT
    ok, message = bench.ask(Command.RESET)
    assert (ok, "comes to rest" in message) == (False, True)
    bench.inputs = {"cue_age_s": 0.0}
    out = bench.run(0.1)
    assert (out.state, out.motion, out.power, out.armed) == (
        FAULT, MotionGoal.NONE, PowerGoal.OFF, False,
    )  # fmt: skip
    assert bench.run(20.0).state is FAULT


def test_stop_during_the_ramp_of_a_fault_stops_on_the_spot(bench: Bench) -> None:
    bench.ramping()
    assert bench.ask(Command.STOP)[0]
    assert bench.step().motion is MotionGoal.HOLD
    out = bench.step(at_rest=True)
    assert (out.state, out.power) == (FAULT, PowerGoal.OFF)


def test_the_ramp_of_a_fault_has_its_time_too(bench: Bench) -> None:
    bench.ramping()
    bench.run(SETTINGS.park_time_s + 2 * DT)
    assert bench.state.name is EMERGENCY
    assert bench.state.fault is not None
    assert bench.state.fault.cause is Cause.COURSE_LIMIT, "the first fault keeps its name"


def test_a_drive_that_fails_during_the_ramp_makes_it_an_emergency(bench: Bench) -> None:
    bench.ramping()
    bench.phases[1] = DrivePhase.FAULT
    assert bench.step().power is PowerGoal.OFF
    assert bench.state.name is EMERGENCY


@pytest.mark.parametrize(("after_s", "state"), [(0.04, FAULT), (0.07, EMERGENCY)])
def test_a_ramp_whose_setpoints_are_refused_is_no_ramp(
    bench: Bench, after_s: float, state: StateName
) -> None:
    bench.engaged()
    refused = Finding(Cause.GATE_REFUSED, "296#.. refused (speed)")
    assert bench.step(refused).state is FAULT
    bench.run(after_s - DT)
    bench.step(refused)
    assert bench.state.name is state


def test_reset_leads_through_preparing_to_parked(bench: Bench) -> None:
    bench.faulted()
    assert bench.ask(Command.RESET)[0]
    assert bench.state.name is PREPARING
    assert bench.out is not None
    assert bench.out.power is PowerGoal.RESET
    bench.phases = [DrivePhase.LOGGED_ON, DrivePhase.READY]
    out = bench.step()
    assert (out.power, out.fault) == (PowerGoal.OFF, None)
    bench.phases = [DrivePhase.READY, DrivePhase.READY]
    assert bench.step().state is PARKED


def test_a_drive_that_cannot_be_reset_is_a_fault_again(bench: Bench) -> None:
    bench.faulted()
    bench.ask(Command.RESET)
    for _ in range(round(RESET_S / DT) + 3):
        bench.phases[0] = DrivePhase.FAULT
        bench.step()
    assert bench.state.name is FAULT
    assert bench.out is not None
    assert bench.out.power is PowerGoal.OFF


def test_who_asks_to_arm_a_rig_in_fault_is_told_what_the_fault_is_once(bench: Bench) -> None:
    bench.faulted()
    bench.phases[0] = DrivePhase.FAULT
    ok, text = bench.ask(Command.ARM)
    assert not ok
    assert bench.state.fault is not None
    assert f"the rig is fault ({bench.state.fault.cause.value}: {bench.state.fault.text})" in text
    assert text.count("overcurrent") == 1


def test_reset_without_a_fault_is_refused(bench: Bench) -> None:
    bench.ready()
    assert not bench.ask(Command.RESET)[0]
    assert bench.state.name is READY


def test_an_emergency_switches_off_at_once_and_waits_for_a_person(bench: Bench) -> None:
    bench.engaged()
    bench.changed[0] = {"enpo": False}
    out = bench.step()
    assert (out.state, out.power, out.motion, out.armed) == (
        EMERGENCY, PowerGoal.OFF, MotionGoal.NONE, False,
    )  # fmt: skip
    assert out.fault is not None
    assert "left" in out.fault.text
    bench.changed[0] = {}
    assert bench.run(30.0).state is EMERGENCY
    assert bench.ask(Command.RESET)[0]
    assert bench.run(0.1).state is PARKED


def test_a_drive_that_drops_out_unprovoked_is_an_emergency(bench: Bench) -> None:
    bench.engaged()
    bench.changed[1] = {"enabled": False}
    bench.phases[1] = DrivePhase.READY
    out = bench.step()
    assert out.state is EMERGENCY
    assert out.fault is not None
    assert out.fault.cause is Cause.DRIVE_NOT_ENABLED


def test_a_disarmed_drive_that_is_not_ready_any_more_leads_back_to_preparing(bench: Bench) -> None:
    bench.parked()
    bench.phases[0] = DrivePhase.CONFIGURED
    assert bench.step().state is PREPARING
    bench.phases = [DrivePhase.ABSENT, DrivePhase.ABSENT]
    assert bench.step().state is OFFLINE


def test_the_same_trouble_is_told_once(bench: Bench) -> None:
    bench.ready()
    for _ in range(100):
        bench.step(Finding(Cause.IMU_LOST, "the IMU has said nothing for 0.6 s"))
    assert bench.events.count("imu_lost") == 1
    assert bench.state.name is READY


@pytest.mark.parametrize(
    ("inputs", "state"),
    [
        ({"overruns": 4}, ENGAGED),
        ({"overruns": 5}, PARKING),
        ({"busy_cycles": 4}, ENGAGED),
        ({"busy_cycles": 5}, PARKING),
        ({"gateway_alive": False}, PARKING),
        ({"bus_off": True}, EMERGENCY),
    ],
)
def test_counts_at_their_bounds(bench: Bench, inputs: dict[str, object], state: StateName) -> None:
    bench.engaged()
    assert bench.step(**inputs).state is state


@pytest.mark.parametrize(("silent_s", "state"), [(0.1, ENGAGED), (0.1001, EMERGENCY)])
def test_silence_of_one_drive_at_its_bound(bench: Bench, silent_s: float, state: StateName) -> None:
    bench.now_s = 99.99  # 100.0 at the step that counts: the difference is exact enough
    bench.engaged()
    bench.changed[0] = {"last_answer_s": bench.now_s + DT - silent_s + 1e-9}
    assert bench.step().state is state


def test_parking_time_of_a_rig_covers_its_whole_range() -> None:
    rig = load_rig("motorcycle")
    settings = state_settings(rig)
    slowest_s = 2 * 0.26 / (0.3 * 0.25)  # pitch from end to end at its parking speed
    assert slowest_s < settings.park_time_s < 4 * slowest_s
