"""What a person may ask of the rig in which state, and what is said where it may not be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import assert_never

from hil.safety.conditions import (
    POWER_ON_S,
    RESET_S,
    UP,
    Command,
    Request,
    RigInputs,
    StateSettings,
)
from hil.safety.reactions import REACTIONS, Reaction
from hil.safety.rigstate import RigState, StateName


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a request: done or not, and a sentence."""

    request_id: int
    ok: bool
    message: str


_Outcome = tuple[bool, str, RigState]


def obey(
    request: Request, inputs: RigInputs, state: RigState, settings: StateSettings, now_s: float
) -> tuple[Reply, RigState]:
    """Do what is asked, if it may be done now."""
    match request.command:
        case Command.CHECK:
            against = blockers(inputs, state, settings, now_s)
            ok, text = not against, "; ".join(against) or "the rig can be armed"
        case Command.ARM:
            ok, text, state = _arm(inputs, state, settings, now_s)
        case Command.DISARM:
            ok, text, state = _disarm(inputs, state, now_s)
        case Command.PARK:
            ok, text, state = _park(inputs, state, settings, now_s)
        case Command.STOP:
            ok, text, state = _stop(state, settings, now_s)
        case Command.FINISH:
            ok, text, state = _finish(request.client, state, settings, now_s)
        case Command.RESET:
            ok, text, state = _reset(state, now_s)
        case _:
            assert_never(request.command)
    return Reply(request.request_id, ok, text), state


def blockers(
    inputs: RigInputs,
    state: RigState,
    settings: StateSettings,
    now_s: float,
    *,
    anywhere: bool = False,
) -> list[str]:
    """Sentences that say what stands against arming; `anywhere`: off the parked pose too, to park."""
    against = ["this daemon only listens"] if settings.read_only else []
    if state.name is not StateName.PARKED:
        against.append(f"the rig is {state.name.value}{_why(state)}, not parked")
    for name, drive in zip(settings.names, inputs.drives, strict=True):
        if drive.phase not in UP:
            if drive.error is None or drive.error not in _why(state):
                against.append(drive.waiting_for or drive.error or f"{name} is {drive.phase.value}")
        elif not drive.watchdog_ok:
            against.append(f"{name}: its own watchdog is not verified")
        elif not drive.referenced:
            against.append(f"{name} is not referenced")
    for cause, row in REACTIONS.items():
        if row.disarmed is Reaction.BLOCK and state.seen_lately(cause, now_s):
            against.append(f"{cause.value}: {row.why}")
    if not inputs.gateway_alive:
        against.append("the gateway process is silent")
    if not (anywhere or inputs.near_parked):
        against.append("the rig is not near its parked pose: park it first")
    return against


def _why(state: RigState) -> str:
    """The latched fault in brackets, empty without one."""
    return f" ({state.fault.cause.value}: {state.fault.text})" if state.fault else ""


def _arm(inputs: RigInputs, state: RigState, settings: StateSettings, now_s: float) -> _Outcome:
    against = blockers(inputs, state, settings, now_s)
    if against:
        return False, "; ".join(against), state
    return True, "armed: a fresh cue engages the rig", state.arm(now_s).to(StateName.READY, now_s)


def _disarm(inputs: RigInputs, state: RigState, now_s: float) -> _Outcome:
    if not state.armed:
        return True, "the drives are off already", state
    resting = state.name in (StateName.PARKED, StateName.READY) or (
        state.name is StateName.PARKING and state.held
    )
    if not (resting and inputs.at_rest):
        return False, f"the rig is {state.name.value} and may move: park or stop it first", state
    return True, "disarmed: the drives are off", state.disarm().to(StateName.PARKED, now_s)


def _park(inputs: RigInputs, state: RigState, settings: StateSettings, now_s: float) -> _Outcome:
    if state.armed and not state.latched:
        if state.name in (StateName.PARKED, StateName.READY) and inputs.at_parked:
            return True, "the rig is parked", state.arm(now_s).to(StateName.PARKED, now_s)
        return True, "the rig parks", state.park(now_s, settings.park_time_s)
    if state.name is StateName.PARKED and inputs.near_parked:
        return True, "the rig is parked", state
    against = blockers(inputs, state, settings, now_s, anywhere=True)
    if against:
        return False, "; ".join(against), state
    powered = state.arm(now_s).park(now_s, POWER_ON_S + settings.park_time_s)
    return True, "the drives come on and the rig parks", powered


def _stop(state: RigState, settings: StateSettings, now_s: float) -> _Outcome:
    if state.name in (StateName.ENGAGED, StateName.PARKING):
        stopped = state.hold(now_s, settings.stop_time_s).to(StateName.PARKING, now_s)
        return True, "the rig stops where it is: park or disarm it next", stopped
    if state.name is StateName.FAULT and state.armed:
        return True, "the rig stops where it is", state.hold(now_s, settings.stop_time_s)
    if state.name is StateName.READY:
        return True, "cues move nothing any more", state.to(StateName.PARKED, now_s)
    return True, "nothing moves", replace(state, resume_s=-float("inf"))


def _finish(client: str, state: RigState, settings: StateSettings, now_s: float) -> _Outcome:
    if state.held:
        return False, "the rig was stopped: park or disarm it", state
    if state.latched or not state.armed:
        return False, f"the rig is {state.name.value}{_why(state)}: it is left so", state
    if state.name is StateName.READY:
        return False, "the rig follows nobody: it stays ready", state
    if not _may_be(client, state.client or ""):
        return False, f"the rig follows {state.client or 'nobody'}, not {client}: it goes on", state
    if state.name is StateName.ENGAGED:
        return True, "the rig parks", state.park(now_s, settings.park_time_s)
    done = "the rig parks" if state.name is StateName.PARKING else "the rig is parked"
    return True, done, replace(state, resume_s=-float("inf"))


def _may_be(client: str, followed: str) -> bool:
    """Whether both are one client: of one name, and of one session where both tell theirs."""
    (name, _, session), (their_name, _, their_session) = (
        client.partition("@"),
        followed.partition("@"),
    )
    return name == their_name and (session == their_session or not session or not their_session)


def _reset(state: RigState, now_s: float) -> _Outcome:
    if not state.latched:
        return False, "there is no fault to reset", state
    if state.armed:
        return False, "the rig still comes to rest: reset it then", state
    fresh = replace(state, fault=None, resetting_s=now_s + RESET_S)
    return True, "the fault is reset: the drives are prepared", fresh.to(StateName.PREPARING, now_s)
