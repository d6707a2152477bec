"""A rig of two drives for the state machine: inputs at hand, and a small simulated drive."""

from __future__ import annotations

from typing import Any

from hil.drives.driver import DrivePhase, DriveStatus, PowerGoal
from hil.safety import (
    Command,
    Finding,
    MotionGoal,
    Request,
    RigInputs,
    RigOutputs,
    RigState,
    RigStateMachine,
    StateName,
    StateSettings,
)

DT = 0.01
CLIENT = "rider@1a2b3c4d"
SETTINGS = StateSettings(
    names=("left", "right"),
    answer_timeout_s=0.1,
    cue_stale_s=0.2,
    overrun_cycles=5,
    stop_time_s=1.0,
    park_time_s=8.0,
    refusal_grace_s=0.05,
)


def drive(phase: DrivePhase = DrivePhase.READY, now_s: float = 0.0, **changed: Any) -> DriveStatus:
    status = DriveStatus(
        phase=phase,
        enabled=phase is DrivePhase.ENABLED,
        referenced=True,
        enpo=True,
        error="reports overcurrent" if phase is DrivePhase.FAULT else None,
        waiting_for=None,
        last_answer_s=now_s,
        watchdog_ok=phase in (DrivePhase.READY, DrivePhase.ENABLED),
        slots=0,
        pairs=0,
        repeats=0,
        timeouts=0,
        garbage=0,
        unasked=0,
    )
    return status._replace(**changed)


class Bench:
    """The state machine with two drives that do as they are told, one step later, and a motion."""

    def __init__(self) -> None:
        self.machine = RigStateMachine(SETTINGS)
        self.state = RigState()
        self.now_s = 100.0
        self.phases = [DrivePhase.ABSENT, DrivePhase.ABSENT]
        self.changed: list[dict[str, Any]] = [{}, {}]
        self.inputs: dict[str, Any] = {}
        self.out: RigOutputs | None = None
        self.events: list[str] = []
        self._requests: tuple[Request, ...] = ()

    def step(self, *findings: Finding, **inputs: Any) -> RigOutputs:
        """One cycle."""
        self.now_s += DT
        statuses = tuple(
            drive(p, self.now_s, **c) for p, c in zip(self.phases, self.changed, strict=True)
        )
        values = {**self.inputs, **inputs}
        out, self.state = self.machine.step(
            RigInputs(statuses, requests=self._requests, findings=findings, **values),
            self.state,
            self.now_s,
        )
        self._requests = ()
        self.out = out
        self.events += [e.name for e in out.events]
        self._obey(out.power)
        return out

    def ask(self, command: Command, client: str = "", **inputs: Any) -> tuple[bool, str]:
        """A command, and its reply."""
        self._requests = (Request(7, command, client),)
        (reply,) = self.step(**inputs).replies
        assert reply.request_id == 7
        return reply.ok, reply.message

    def run(self, seconds: float, **inputs: Any) -> RigOutputs:
        out = self.step(**inputs)
        for _ in range(round(seconds / DT) - 1):
            out = self.step(**inputs)
        return out

    def _obey(self, power: PowerGoal) -> None:
        for i, phase in enumerate(self.phases):
            if power is PowerGoal.ON and phase is DrivePhase.READY:
                self.phases[i] = DrivePhase.ENABLED
            elif power is not PowerGoal.ON and phase is DrivePhase.ENABLED:
                self.phases[i] = DrivePhase.READY
            elif power is PowerGoal.RESET and phase is DrivePhase.FAULT:
                self.phases[i] = DrivePhase.LOGGED_ON

    # -- ways into each state

    def parked(self) -> Bench:
        self.phases = [DrivePhase.READY, DrivePhase.READY]
        self.run(2 * DT)
        assert self.state.name is StateName.PARKED
        return self

    def ready(self) -> Bench:
        self.parked()
        ok, message = self.ask(Command.ARM)
        assert ok, message
        self.run(2 * DT)
        assert self.state.name is StateName.READY
        assert self.state.energised
        return self

    def engaged(self) -> Bench:
        self.ready()
        cue = {"cue_age_s": 0.0, "cue_client": CLIENT}
        self.inputs = cue
        self.run(2 * DT)
        self.inputs = {**cue, "at_rest": False, "at_parked": False, "near_parked": False}
        assert self.step().motion is MotionGoal.FOLLOW
        return self

    def parking(self) -> Bench:
        self.engaged()
        ok, _ = self.ask(Command.PARK)
        assert ok
        assert self.state.name is StateName.PARKING
        return self

    def held(self) -> Bench:
        self.engaged()
        ok, _ = self.ask(Command.STOP)
        assert ok
        return self

    def faulted(self) -> Bench:
        self.parked()
        self.phases[0] = DrivePhase.FAULT
        self.step()
        assert self.state.name is StateName.FAULT
        return self

    def ramping(self) -> Bench:
        """In fault, still on the ramp to the parked pose."""
        from hil.safety import Cause

        self.engaged()
        self.step(Finding(Cause.COURSE_LIMIT, "left: course limitation"))
        assert self.state.name is StateName.FAULT
        assert self.state.armed
        return self

    def emergency(self) -> Bench:
        self.engaged()
        self.changed[0] = {"enpo": False}
        self.step()
        self.changed[0] = {}
        assert self.state.name is StateName.EMERGENCY
        return self

    def preparing(self) -> Bench:
        self.phases = [DrivePhase.LOGGED_ON, DrivePhase.CONFIGURED]
        self.step()
        return self

    def offline(self) -> Bench:
        self.step()
        return self
