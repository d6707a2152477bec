"""Whatever drives, cues, people and trouble do: what must never happen does not, and rest is reached."""

from __future__ import annotations

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from hil.drives.driver import DrivePhase, PowerGoal
from hil.safety import Cause, Command, Finding, MotionGoal, RigOutputs, StateName
from tests.safety.rig_bench import CLIENT, SETTINGS, Bench

AT_REST = {"at_rest": True, "at_parked": True, "near_parked": True}
WAYS = ("offline", "parked", "ready", "engaged", "parking", "held", "ramping", "emergency")
MOVING = {"at_rest": False, "at_parked": False, "near_parked": False}


class AnyDay(RuleBasedStateMachine):
    """A rig that is told and struck at random."""

    @initialize(way=st.sampled_from(WAYS))
    def start(self, way: str) -> None:
        self.bench = Bench()
        getattr(self.bench, way)()
        assert self.bench.out is not None
        self.outputs: list[RigOutputs] = [self.bench.out]
        self.asked: Command | None = None
        self.client: str | None = self.bench.state.client
        self.verified = self.enabled = True

    def step(self, *findings: Finding, command: Command | None = None) -> None:
        bench = self.bench
        # What the drives are at the step that is about to decide.
        self.verified = all(
            p in (DrivePhase.READY, DrivePhase.ENABLED) and c.get("watchdog_ok", True)
            for p, c in zip(bench.phases, bench.changed, strict=True)
        )
        self.enabled = all(
            p is DrivePhase.ENABLED and c.get("enpo", True)
            for p, c in zip(bench.phases, bench.changed, strict=True)
        )
        self.asked = command
        if command is None:
            bench.step(*findings)
        else:
            bench.ask(command)
        assert bench.out is not None
        self.outputs.append(bench.out)
        if command is Command.ARM and bench.out.replies[0].ok:
            self.client = None

    @rule(i=st.integers(0, 1), phase=st.sampled_from(DrivePhase))
    def a_drive_changes(self, i: int, phase: DrivePhase) -> None:
        self.bench.phases[i] = phase
        self.step()

    @rule()
    def drives_are_mended(self) -> None:
        self.bench.changed = [{}, {}]
        self.step(command=Command.RESET)
        self.bench.phases = [DrivePhase.READY, DrivePhase.READY]
        self.step()
        self.step()

    @precondition(lambda self: self.outputs[-1].state is StateName.PARKED)
    @rule()
    def a_ride_begins(self) -> None:
        self.bench.inputs = {"cue_age_s": 0.0, "cue_client": CLIENT, **AT_REST}
        self.step(command=Command.ARM)
        self.step()
        self.step()
        self.bench.inputs.update(MOVING)

    @rule(i=st.integers(0, 1), ok=st.booleans())
    def watchdog(self, i: int, ok: bool) -> None:
        self.bench.changed[i] = {} if ok else {"watchdog_ok": False}
        self.step()

    @rule(i=st.integers(0, 1), there=st.booleans())
    def enpo(self, i: int, there: bool) -> None:
        self.bench.changed[i] = {} if there else {"enpo": False}
        self.step()

    @rule(i=st.integers(0, 1))
    def silence(self, i: int) -> None:
        self.bench.changed[i] = {"last_answer_s": self.bench.now_s - 1.0}
        self.step()

    @rule(age=st.sampled_from([None, 0.0, 0.19, 0.21, 5.0]))
    def cue(self, age: float | None) -> None:
        self.bench.inputs["cue_age_s"] = age
        self.step()

    @rule(client=st.sampled_from([CLIENT, "other"]))
    def another_client_sends(self, client: str) -> None:
        self.bench.inputs["cue_client"] = client
        self.step()

    @rule(moving=st.booleans())
    def motion(self, moving: bool) -> None:
        self.bench.inputs.update(MOVING if moving else AT_REST)
        self.step()

    @precondition(lambda self: self.outputs[-1].armed)
    @rule(cause=st.sampled_from(Cause))
    def trouble(self, cause: Cause) -> None:
        self.step(Finding(cause, "struck"))

    @rule(command=st.sampled_from(Command))
    def person(self, command: Command) -> None:
        self.step(command=command)

    @rule(seconds=st.sampled_from([0.05, 0.25, 1.1]))
    def time_goes_by(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.bench.now_s += 0.04
            self.step()

    @precondition(lambda self: self.outputs[-1].state is StateName.ENGAGED)
    @rule()
    def every_path_from_engaged_leads_to_rest(self) -> None:
        """No cue any more, nobody says anything, the motion never says that it is at rest."""
        self.bench.inputs = {"cue_age_s": 1.0, **MOVING}
        for _ in range(round((SETTINGS.park_time_s + 1.0) / 0.1)):
            self.bench.now_s += 0.09
            self.step()
        assert self.outputs[-1].power is not PowerGoal.ON
        assert self.outputs[-1].motion is MotionGoal.NONE

    @invariant()
    def power_follows_the_latch(self) -> None:
        if not hasattr(self, "bench"):
            return
        out = self.outputs[-1]
        assert (out.power is PowerGoal.ON) is out.armed
        assert (out.motion is not MotionGoal.NONE) is out.armed
        if out.state in (StateName.OFFLINE, StateName.PREPARING, StateName.EMERGENCY):
            assert not out.armed
        if out.state in (StateName.READY, StateName.ENGAGED, StateName.PARKING):
            assert out.armed

    @invariant()
    def power_comes_on_by_a_persons_word_alone_with_verified_watchdogs(self) -> None:
        if not hasattr(self, "bench") or len(self.outputs) < 2:
            return
        before, now = self.outputs[-2:]
        if now.armed and not before.armed:
            # The word may come in the very cycle in which the last drive is ready: it is heard after that.
            at_rest = (StateName.OFFLINE, StateName.PREPARING, StateName.PARKED)
            assert before.state in at_rest
            assert before.fault is None
            assert self.asked in (Command.ARM, Command.PARK)
            assert self.verified
            assert now.state in (StateName.READY, StateName.PARKING)

    @invariant()
    def between_two_arms_one_client_alone_is_followed(self) -> None:
        if not hasattr(self, "bench") or self.outputs[-1].state is not StateName.ENGAGED:
            return
        self.client = self.client or self.bench.state.client
        assert self.bench.state.client == self.client
        assert self.outputs[-1].motion is MotionGoal.FOLLOW

    @invariant()
    def a_latched_fault_goes_by_a_reset_alone(self) -> None:
        if not hasattr(self, "bench") or len(self.outputs) < 2:
            return
        before, now = self.outputs[-2:]
        latched = (StateName.FAULT, StateName.EMERGENCY)
        assert (now.fault is not None) is (now.state in latched)
        if before.state in latched and now.state not in latched:
            assert self.asked is Command.RESET
            assert now.state is StateName.PREPARING
            assert not before.armed
        if before.state is StateName.EMERGENCY and now.state in latched:
            assert now.state is StateName.EMERGENCY

    @invariant()
    def only_an_engaged_rig_follows_and_only_with_drives_on(self) -> None:
        if not hasattr(self, "bench"):
            return
        out = self.outputs[-1]
        if out.motion is MotionGoal.FOLLOW:
            assert out.state is StateName.ENGAGED
            assert self.bench.state.energised
        if out.state is StateName.FAULT and out.armed:
            assert out.motion in (MotionGoal.PARK, MotionGoal.HOLD)
            assert self.enabled, "no ramp with a drive that is off"


AnyDay.TestCase.settings = settings(
    max_examples=300,
    stateful_step_count=25,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
TestAnyDay = AnyDay.TestCase
