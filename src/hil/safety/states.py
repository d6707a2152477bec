"""The rig's states as one pure step: what power and motion are to do, and what people are told.

Power never comes on by itself: from fault and emergency a person's reset leads to preparing, and a
person's arm (or park) from parked to powered drives. The one motion in a fault is the ramp to rest of
drives that were on before it. Reactions come from `REACTIONS`.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Final, Literal, NamedTuple

from hil.drives.driver import DrivePhase, PowerGoal
from hil.safety.commands import Reply, obey
from hil.safety.conditions import UP, RigInputs, StateSettings, is_back, is_fresh, present
from hil.safety.reactions import Cause, Finding, Reaction, reaction
from hil.safety.rigstate import MotionGoal, RigState, StateName
from hil.signals import Event

RESUME_S: Final = 10.0
"""A rig that parked because its cue went stale engages again by itself if the same client's cue is back
within this time; after it a person may have come near, so that it takes an arm."""


class RigOutputs(NamedTuple):
    """What one step decides."""

    state: StateName
    power: PowerGoal
    motion: MotionGoal
    armed: bool
    """The gate's latch."""
    fault: Finding | None
    events: tuple[Event, ...] = ()
    replies: tuple[Reply, ...] = ()


class RigStateMachine:
    """Holds the settings only; the state goes in and comes out."""

    def __init__(self, settings: StateSettings) -> None:
        self.settings = settings

    def step(self, inputs: RigInputs, state: RigState, now_s: float) -> tuple[RigOutputs, RigState]:
        """One step: reactions first, then what time and drives bring, then what people ask."""
        before = state
        events: list[Event] = []
        state = self._energise(inputs, state)
        state = self._react(inputs, state, now_s, events)
        state = self._advance(inputs, state, now_s)
        replies: list[Reply] = []
        for request in inputs.requests:
            reply, state = obey(request, inputs, state, self.settings, now_s)
            replies.append(reply)
        if state.name is not before.name:
            text = f"{before.name.value} → {state.name.value}"
            events.append(Event(now_s, "info", "rig_state", text))
        outputs = RigOutputs(
            state.name,
            state.power,
            state.motion,
            state.armed,
            state.fault,
            tuple(events),
            tuple(replies),
        )
        return outputs, state

    def _energise(self, inputs: RigInputs, state: RigState) -> RigState:
        if not state.armed or state.energised or not all(d.enabled for d in inputs.drives):
            return state
        return replace(state, energised=True)

    def _react(
        self, inputs: RigInputs, state: RigState, now_s: float, events: list[Event]
    ) -> RigState:
        armed, resetting = state.armed, state.resetting_s > -inf
        found = [
            (reaction(finding.cause, armed=armed), finding)
            for finding in present(inputs, self.settings, state, now_s)
        ]
        for what, finding in sorted(found, key=lambda f: f[0].severity, reverse=True):
            if what is Reaction.NONE or (resetting and what is Reaction.FAULT):
                continue
            if not state.seen_lately(finding.cause, now_s):
                hard = what in (Reaction.FAULT, Reaction.EMERGENCY)
                level: Literal["fault", "warning"] = "fault" if hard else "warning"
                events.append(Event(now_s, level, finding.cause.value, finding.text))
            state = state.saw(finding.cause, now_s)
            if what is Reaction.PARK:
                state = self._park(state, finding.cause, now_s)
            elif what is Reaction.FAULT:
                state = self._fault(inputs, state, finding, now_s)
            elif what is Reaction.EMERGENCY:
                state = _emergency(state, finding, now_s)
        return state

    def _park(self, state: RigState, cause: Cause, now_s: float) -> RigState:
        if state.name is StateName.ENGAGED:
            resume_s = now_s + RESUME_S if cause is Cause.CUE_STALE else -inf
            return state.park(now_s, self.settings.park_time_s, resume_s)
        if state.name is StateName.READY:
            return state.at_rest(now_s)
        return replace(state, resume_s=-inf) if cause is not Cause.CUE_STALE else state

    def _fault(
        self, inputs: RigInputs, state: RigState, finding: Finding, now_s: float
    ) -> RigState:
        if state.name is StateName.EMERGENCY:
            return state
        if not state.energised:
            # Nothing moves: disarmed, or drives still coming on.
            return replace(state.disarm(), fault=state.fault or finding).to(StateName.FAULT, now_s)
        if not all(d.phase is DrivePhase.ENABLED for d in inputs.drives):
            return _emergency(state, finding, now_s)
        if state.name is StateName.FAULT:
            late = now_s - state.since_s > self.settings.refusal_grace_s
            refused = finding.cause is Cause.GATE_REFUSED and late
            return _emergency(state, finding, now_s) if refused else state
        deadline_s = min(state.deadline_s, now_s + self.settings.park_time_s)
        ramping = replace(state, fault=finding, deadline_s=deadline_s, resume_s=-inf)
        return ramping.to(StateName.FAULT, now_s)

    def _advance(self, inputs: RigInputs, state: RigState, now_s: float) -> RigState:
        phases = [d.phase for d in inputs.drives]
        match state.name:
            case StateName.OFFLINE | StateName.PREPARING:
                return self._prepare(phases, state, now_s)
            case StateName.PARKED if not all(p in UP for p in phases):
                return state.disarm().to(StateName.PREPARING, now_s)
            case StateName.PARKED if state.resume_s >= now_s and is_back(
                inputs, self.settings, state
            ):
                return state.engage(inputs.cue_client, now_s)
            case StateName.READY if state.energised and is_fresh(inputs, self.settings):
                return state.engage(inputs.cue_client, now_s)
            case StateName.PARKING if state.held:
                return replace(state, deadline_s=inf) if inputs.at_rest else state
            case StateName.PARKING if state.energised and inputs.at_parked:
                return state.at_rest(now_s)
            case StateName.FAULT if state.armed:
                resting = inputs.at_rest if state.held else inputs.at_parked
                return state.disarm() if resting else state
            case _:
                return state

    def _prepare(self, phases: list[DrivePhase], state: RigState, now_s: float) -> RigState:
        if state.resetting_s < now_s or DrivePhase.FAULT not in phases:
            state = replace(state, resetting_s=-inf)
        if all(p is DrivePhase.ABSENT for p in phases):
            return state.to(StateName.OFFLINE, now_s)
        if all(p is DrivePhase.READY for p in phases):
            return state.to(StateName.PARKED, now_s)
        return state.to(StateName.PREPARING, now_s)


def _emergency(state: RigState, finding: Finding, now_s: float) -> RigState:
    """Drives off at once. The first fault keeps its name."""
    off = replace(state.disarm(), fault=state.fault or finding, resetting_s=-inf)
    return off.to(StateName.EMERGENCY, now_s)
