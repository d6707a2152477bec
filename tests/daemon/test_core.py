"""Rig and daemon together in simulated time: from log-on to parked again, and every way it can go wrong."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.bus.faults import Corrupt, Drop, Flood, NodeOff
from hil.daemon.core.motion import Motion
from hil.daemon.core.rigcore import OFF_CYCLES
from hil.daemon.records import (
    CommandRecord,
    EventRecord,
    InputRecord,
    ReplyRecord,
    SetpointRecord,
    StateRecord,
)
from hil.errors import CommandRefused
from hil.frames import Frame
from hil.safety import MotionGoal, state_settings
from hil.signals import Cue, TimedPose
from tests.daemon.simulated_rig import PROFILES, Session, rig_file


def test_it_comes_up_disarmed_and_silent_towards_the_power_stages():
    session = Session()
    session.run_until(5.0)
    assert session.core.state == "parked"
    assert not session.powered()
    words = {r.frame.data[0] for r in session.sent() if 0x295 < r.frame.can_id < 0x299}
    assert words == {0x00, 0x06}  # off, and ready to be switched on


@pytest.mark.parametrize("name", ["motorcycle", "axis"])
@pytest.mark.parametrize("mode", ["drive", "cascade", "computed_torque"])
def test_a_ride_in_every_mode_ends_parked_and_off(name, mode):
    session = Session(rig_file(name, control={"mode": mode})).engaged(4.0)
    errors = [s.tracking_error for s in session.of(StateRecord) if s.state == "engaged"]
    assert np.nanmax(errors) < 0.03
    session.leave()
    assert session.core.state == "parked"
    assert not session.powered()
    assert session.state().slots == session.state().pairs > 300
    kinds = {r.kind for r in session.of(SetpointRecord)}
    assert kinds == {"position" if mode == "drive" else "force"}


def test_six_coupled_legs_ride_under_the_slow_loops_of_the_cascade():
    session = Session(rig_file("stewart", control={"mode": "cascade"})).engaged(3.0)
    assert session.core.state == "engaged"


def test_computed_torque_tracks_better_than_the_drives_own_cascade():
    def error(mode):
        session = Session(rig_file(control={"mode": mode})).engaged(6.0)
        states = [s for s in session.of(StateRecord) if s.state == "engaged"][250:]
        return float(np.sqrt(np.mean([s.tracking_error**2 for s in states])))

    assert error("computed_torque") < 0.2 * error("drive")


def test_without_torque_references_computed_torque_leads_the_setpoints():
    profile = PROFILES["lust_cdd3000"]
    layout = profile.layout.model_copy(update={"torque_reference": False})
    profiles = {"lust_cdd3000": profile.model_copy(update={"layout": layout})}
    session = Session(rig_file(control={"mode": "computed_torque"}), profiles=profiles)
    session.engaged(6.0)
    assert {r.kind for r in session.of(SetpointRecord)} == {"position"}
    errors = [s.tracking_error for s in session.of(StateRecord) if s.state == "engaged"][250:]
    plain = Session().engaged(6.0)
    lagging = [s.tracking_error for s in plain.of(StateRecord) if s.state == "engaged"][250:]
    assert np.sqrt(np.mean(np.square(errors))) < 0.3 * np.sqrt(np.mean(np.square(lagging)))


def test_the_same_session_comes_out_the_same_to_the_bit():
    def frames():
        return [r for r in Session(seed=3).engaged(1.0).records if not isinstance(r, StateRecord)]

    assert frames() == frames()


def test_every_slot_carries_a_pair_whatever_the_host_does():
    session = Session(wake_jitter_s=0.001).engaged(10.0)
    assert session.state().slots == session.state().pairs


# cues


def test_a_stale_cue_parks_and_a_fresh_one_resumes():
    session = Session().engaged()
    session.run_until(session.now_s + 3.0)
    assert "cue_stale" in session.events()
    assert session.core.state == "parked"
    session.ride(2.0)
    assert session.core.state == "engaged"


def test_another_clients_cue_does_not_engage_a_rig_whose_own_has_gone():
    session = Session().engaged()
    session.run_until(session.now_s + 3.0)
    assert session.core.state == "parked"
    session.ride(2.0, client="other")
    assert session.core.state == "parked"
    session.run_until(session.now_s + 0.5)
    session.ride(2.0)
    assert session.core.state == "engaged", "it is back, and that is who may"


def test_another_clients_cue_does_not_take_over_between_two_cycles():
    session = Session().engaged()
    session.run_until(session.now_s + session.rig.cue.stale - 0.02)
    while session.core._motion.guard.active_client(session.now_s) is not None:
        session.run_until(session.now_s + 0.0005)
    assert session.core.state == "engaged", "no cycle has seen yet that the cue is stale"
    session.ride(0.1, client="other")
    assert session.core.state == "parking"
    assert "other" in session.text_of("cue_stale")


def test_a_rig_left_alone_for_longer_waits_for_a_person():
    session = Session().engaged()
    session.run_until(session.now_s + 15.0)
    session.ride(2.0)
    assert session.core.state == "parked"


BAD_CUES = {
    "cue_refused_not_finite": lambda s, t: Cue(
        "rider", 10**6, t, t, (TimedPose(0.0, (math.nan,) * 3),)
    ),
    "cue_refused_coordinates": lambda s, t: Cue("rider", 10**6, t, t, (TimedPose(0.0, (0.0,)),)),
    "cue_refused_order": lambda s, t: Cue("rider", 1, t, t, (TimedPose(0.0, (0.0,) * 3),)),
    "cue_refused_client": lambda s, t: Cue("other", 10**6, t, t, (TimedPose(0.0, (0.0,) * 3),)),
    "cue_refused_malformed": lambda s, t: Cue("rider", 10**6, t, t, ()),
    "cue_limited_workspace": lambda s, t: Cue(
        "rider", 10**6, t, t, (TimedPose(0.0, (9.0, 0.0, 0.0)),)
    ),
}


@pytest.mark.parametrize("name", BAD_CUES)
def test_a_bad_cue_is_named_and_the_ride_goes_on(name):
    session = Session().engaged(1.0)
    session.cue(BAD_CUES[name](session, session.now_s + 0.001))
    session.ride(0.3)
    assert name in session.events()
    assert session.core.state in ("engaged", "ready")


@pytest.mark.parametrize(("clock_s", "is_ridden"), [(9e10, True), (1e308, False)])
def test_a_clients_clock_may_jump_from_one_end_to_the_other(clock_s, is_ridden):
    session = Session()
    session.arm()
    for k in range(100):
        t_s = session.now_s + 0.02
        pose = (TimedPose(0.0, session.sway(k / 50)),)
        session.cue(Cue("rider", k, math.copysign(clock_s, k - 50) + t_s, t_s, pose))
    assert (session.core.state == "engaged") == is_ridden
    setpoints = [s.setpoint for s in session.of(StateRecord)]
    assert np.isfinite(setpoints[-1]).all()


@settings(max_examples=8, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
        min_size=5,
        max_size=25,
    )
)
def test_no_cue_whatever_brings_the_rig_to_a_limit(poses):
    session = Session()
    session.arm()
    for k, pose in enumerate(poses):
        at_s = session.now_s + 0.05
        session.cue(Cue("wild", k, at_s, at_s, (TimedPose(0.0, pose),)))
        for value, actuator in zip(session.positions(), session.rig.actuators, strict=True):
            assert actuator.stroke[0] < value < actuator.stroke[1]
    assert session.core.state in ("engaged", "ready")
    session.leave()
    assert session.core.state == "parked"


def test_the_master_gain_lowers_motion():
    def reach(gain):
        session = Session()
        session.arm()
        assert session.command("gain", str(gain)).ok
        session.ride(6.0)
        return max(abs(s.pose[1]) for s in session.of(StateRecord) if s.state == "engaged")

    assert reach(0.5) == pytest.approx(0.5 * reach(1.0), rel=0.05)


@pytest.mark.parametrize("value", ["1.5", "-1", "nan", "loud"])
def test_a_gain_outside_its_bounds_is_refused(value):
    session = Session()
    session.run_until(0.5)
    assert not session.command("gain", value).ok


# commands


def test_arming_is_refused_before_the_drives_are_there_and_says_why():
    session = Session()
    reply = session.command("arm")
    assert not reply.ok
    assert "leg1" in reply.text


def test_an_unknown_command_lists_those_there_are():
    session = Session()
    assert "park" in session.command("dance").text


def test_stop_comes_to_rest_on_the_spot_and_disarm_switches_off():
    session = Session().engaged()
    assert session.command("stop").ok
    session.run_until(session.now_s + 1.5)
    pose = session.state().pose
    session.run_until(session.now_s + 1.0)
    assert session.state().pose == pytest.approx(pose, abs=1e-3)
    assert session.command("disarm").ok
    session.run_until(session.now_s + 0.1)
    assert not session.powered()


# the end


def test_a_rig_that_a_stop_holds_parks_before_it_leaves():
    session = Session().engaged()
    assert session.command("stop").ok
    session.run_until(session.now_s + 2.0)
    assert session.core.state == "parking"
    session.leave()
    assert session.core.state == "parked"
    assert not session.powered()
    assert np.abs(session.state().pose - np.asarray(session.rig.parked_pose)).max() < 0.01


def test_a_stop_while_the_daemon_ends_holds_and_the_drives_go_off_on_the_spot():
    session = Session().engaged()
    session.core.end()
    session.run_until(session.now_s + 0.3)
    assert session.core.state == "parking"
    assert session.command("stop").ok
    session.run_until(session.now_s + 2.0)
    assert not session.core.armed
    assert session.core.state == "parked"
    assert not session.powered()
    assert not [e for e in session.of(EventRecord) if e.severity == "fault"]


def test_a_stop_in_the_cycle_of_the_end_holds():
    session = Session().engaged()
    session.core.end()
    session.core.command(session.now_s, CommandRecord(77, "stop"))
    session.run_until(session.now_s + session.rig.bus.cycle)
    assert session.core._goal is MotionGoal.HOLD
    session.run_until(session.now_s + 2.0)
    assert not session.core.armed


def test_it_has_ended_once_the_drives_were_told_to_be_off_often_enough():
    session = Session().engaged()
    session.core.end()
    while session.core.armed:
        assert not session.core.has_ended
        session.run_until(session.now_s + session.rig.bus.cycle)
    told = len(session.sent())
    while not session.core.has_ended:
        session.run_until(session.now_s + session.rig.bus.cycle)
    words = [r.frame for r in session.sent()[told:] if 0x295 < r.frame.can_id < 0x299]
    assert len(words) >= OFF_CYCLES * len(session.rig.actuators)
    assert not session.powered()


def test_a_rig_that_is_off_has_ended_with_the_word():
    session = Session()
    session.run_until(1.0)
    assert not session.core.has_ended
    session.core.end()
    assert session.core.has_ended


@pytest.mark.parametrize("cause", ["ramp_timeout", "leave_timeout"])
def test_a_rig_that_does_not_get_parked_on_the_way_out_is_cut_and_that_is_said(cause, monkeypatch):
    session = Session(rig_file("axis")).engaged(1.0)
    settings = state_settings(session.rig)
    monkeypatch.setattr(Motion, "at_parked", property(lambda motion: False))
    session.core.end()
    end_s = session.now_s + settings.leave_time_s
    while session.core.armed and session.now_s < end_s + 1.0:
        session.run_until(session.now_s + 0.5)
        if cause == "leave_timeout":  # somebody asks for it again and again
            session.command("park")
    assert cause in session.events()
    assert (session.now_s > end_s) is (cause == "leave_timeout")
    assert session.core.state == "emergency"
    assert session.core.is_cut
    session.run_until(session.now_s + 0.5)
    assert session.core.has_ended
    assert not session.powered()


def test_a_slow_rig_has_the_time_to_park_that_it_needs():
    session = Session(rig_file("axis", parking={"speed_share": 0.02}))
    session.arm()
    session.ride(6.0, lambda t_s: (0.9 * session.rig.limits[0] * min(t_s / 3.0, 1.0),))
    start_s = session.now_s
    session.leave()
    assert session.now_s - start_s > 20.0
    assert session.core.state == "parked"
    assert not session.core.is_cut


def test_to_be_told_to_end_twice_is_to_be_told_once():
    session = Session().engaged()
    session.core.end()
    session.run_until(session.now_s + 0.3)
    session.core.end()
    session.run_until(session.now_s + 0.1)
    assert session.core.state == "parking", "it parks on"
    assert [r.what for r in session.of(InputRecord)].count("end") == 1


# what breaks


def test_a_drive_that_falls_silent_is_named_and_all_go_off():
    session = Session().engaged()
    session.simulated.drives[1].silence()
    session.ride(0.5)
    assert session.core.state == "emergency"
    assert "leg2" in session.state().fault
    session.run_until(session.now_s + 0.5)
    assert not session.powered()


def test_a_drive_error_ramps_the_rig_to_rest_or_cuts_it_and_a_person_resets():
    session = Session().engaged()
    session.simulated.drives[0].set_fault(7)
    session.ride(0.5)
    assert session.core.state in ("fault", "emergency")
    assert "leg1" in session.state().fault
    session.run_until(session.now_s + 4.0)
    assert not session.powered()
    with pytest.raises(CommandRefused):
        session.wait_for("parked")
    assert session.command("reset").ok
    session.wait_for("parked")


def test_a_lost_hardware_enable_cuts_at_once():
    session = Session().engaged()
    session.simulated.drives[2].set_enpo(session.now_s, present=False)
    session.ride(0.2)
    assert session.core.state == "emergency"
    assert "slide" in session.state().fault
    assert not session.powered()


def test_a_rebooted_drive_is_an_emergency():
    session = Session().engaged()
    session.simulated.drives[0].reboot(session.now_s)
    session.ride(0.5)
    assert session.core.state == "emergency"


def test_a_silent_gateway_parks():
    session = Session().engaged()
    session.core.gateway_alive = lambda now_s: None
    session.ride(1.5)
    assert "gateway_gone" in session.events()
    assert session.core.state in ("parking", "parked")


def test_lost_cycles_park_and_the_drives_stop_themselves_if_it_lasts():
    session = Session().engaged()
    stop = session.now_s + 0.3
    due = type(session.core).next_due_s
    late = type("Late", (type(session.core),), {})
    late.next_due_s = property(lambda core: max(due.fget(core), stop))
    session.core.__class__ = late
    session.run_until(stop - 0.01)
    assert not any(d.power.name == "OPERATION_ENABLED" for d in session.simulated.drives)
    session.run_until(stop + 0.5)
    assert "overrun" in session.events()
    assert session.core.state in ("fault", "emergency")


def test_bus_off_is_an_emergency_and_the_drives_stop_themselves():
    session = Session(faults=[NodeOff(node="control", at_s=5.0, for_s=2.0)])
    session.engaged(3.0)
    session.ride(3.0)
    assert session.core.state == "emergency"
    assert "bus_off" in session.events()
    assert not session.powered()


def test_a_flood_of_a_higher_priority_leaves_the_rig_safe():
    session = Session(faults=[Flood(can_id=0x001, at_s=5.0, until_s=6.0)])
    session.engaged(3.0)
    session.ride(3.0)
    assert session.core.state in ("parked", "fault", "emergency")
    session.run_until(session.now_s + 5.0)
    assert not session.powered() or session.core.state == "parked"


def test_single_lost_frames_are_ridden_through():
    session = Session(faults=[Drop(probability=0.005, after_s=1.0)]).engaged(6.0)
    assert session.core.state == "engaged"


def test_corrupted_answers_never_move_the_rig_out_of_its_limits():
    session = Session(faults=[Corrupt(bits=3, probability=0.02, after_s=2.0, sender="rig")])
    session.arm()
    session.ride(5.0)
    for value, actuator in zip(session.positions(), session.rig.actuators, strict=True):
        assert actuator.stroke[0] < value < actuator.stroke[1]


@dataclasses.dataclass
class Intruder:
    """Sends its frames one by one from an instant on."""

    at_s: float
    frames: list[Frame]
    period_s: float = 0.002

    @property
    def next_due_s(self) -> float:
        return self.at_s if self.frames else math.inf

    def on_due(self, now_s):
        self.at_s = now_s + self.period_s
        return [self.frames.pop(0)]

    def on_frame(self, now_s, frame):
        return []

    def on_refused(self, now_s, frame, error):
        raise error


def test_a_second_master_is_noticed_and_the_rig_comes_to_rest():
    frames = [Frame(0x296, bytes(8)) for _ in range(5)]
    session = Session(others={"intruder": Intruder(4.0, frames)})
    session.engaged(3.0)
    session.ride(2.0)
    assert "second_master" in session.events()
    assert session.core.state in ("fault", "emergency")


def test_garbage_on_the_bus_is_counted_and_never_followed():
    rng = np.random.default_rng(1)
    ours = {0x0DD, *range(0x296, 0x299), *range(0x44E, 0x451)}
    frames = [
        Frame(int(i), rng.bytes(int(n)), is_remote=bool(r))
        for i, n, r in zip(
            rng.integers(0, 0x7FF, 800), rng.integers(0, 9, 800), rng.random(800) < 0.1, strict=True
        )
        if int(i) not in ours
        and not 0x1B9 < int(i) < 0x1BD
        and not 0x607 < int(i) < 0x6E3
        and not 0x371 < int(i) < 0x375
        and not 0x529 < int(i) < 0x52D
        and int(i) not in (0xA0, 0xA1)
    ]
    session = Session(others={"noise": Intruder(2.0, frames)})
    session.engaged(4.0)
    assert session.core.state == "engaged"


def test_replies_come_once_for_each_command():
    session = Session()
    session.run_until(1.0)
    for _ in range(3):
        session.command("check")
    ids = [r.command_id for r in session.of(ReplyRecord)]
    assert ids == [1, 2, 3]
