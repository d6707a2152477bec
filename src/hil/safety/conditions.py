"""What the rig's state machine is told at each step, and the causes that follow from it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, unique
from math import inf
from typing import Final, NamedTuple

from hil.config import RigFile
from hil.drives.driver import DrivePhase, DriveStatus
from hil.safety.reactions import Cause, Finding
from hil.safety.rigstate import RigState, StateName

POWER_ON_S: Final = 3.0
"""A drive that is not enabled so long after arming will not be; power stages need some 0.5 s [M]."""
LEAVE_SPARE_S: Final = 1.0
"""What a rig that is told to leave may take beyond the sum of its parts."""
RESET_S: Final = 2.0
"""How long an error reset is asked of the drives."""

UP: Final = (DrivePhase.READY, DrivePhase.ENABLED)
"""Phases of a drive that has been prepared in full."""
PREPARED: Final = (DrivePhase.CONFIGURED, *UP)
"""Phases in which a drive says whether its hardware enable is there."""


@unique
class Command(Enum):
    """What a person asks of the rig."""

    CHECK = "check"
    ARM = "arm"
    DISARM = "disarm"
    PARK = "park"
    STOP = "stop"
    FINISH = "finish"
    """A client's motion is over: park, but only what that client moves, and nothing that a person stopped."""
    RESET = "reset"


class Request(NamedTuple):
    """A command and the number by which its reply is known."""

    request_id: int
    command: Command
    client: str = ""
    """Whose it is, as its cues call it, or its name without the session; only `FINISH` asks."""


class RigInputs(NamedTuple):
    """What is known at one step."""

    drives: tuple[DriveStatus, ...]
    cue_age_s: float | None = None
    """Age of the newest valid cue; None: there has been none."""
    cue_client: str | None = None
    """Whose cue that is, while it is not stale."""
    requests: tuple[Request, ...] = ()
    at_rest: bool = True
    """The shaped motion stands still."""
    at_parked: bool = True
    """The shaped motion stands still at the parked pose."""
    near_parked: bool = True
    """The measured pose is near the parked pose."""
    findings: tuple[Finding, ...] = ()
    """What monitor, gate and bus have found since the step before."""
    overruns: int = 0
    """Cycles missed in a row."""
    busy_cycles: int = 0
    """Cycles in a row in which the bus took a frame too few."""
    bus_off: bool = False
    gateway_alive: bool = True
    leaving_s: float = 0.0
    """Time since somebody wanted to leave; 0 where nobody has."""


@dataclass(frozen=True, slots=True)
class StateSettings:
    """What the state machine needs of the rig file."""

    names: tuple[str, ...]
    answer_timeout_s: float
    cue_stale_s: float
    overrun_cycles: int
    stop_time_s: float
    park_time_s: float
    """Parking from anywhere takes less."""
    refusal_grace_s: float
    """So long after a fault began, refused setpoints are still those of the motion before it."""
    read_only: bool = False
    """The gate lets nothing pass: arming is refused."""

    @property
    def leave_time_s(self) -> float:
        """A rig that is told to leave is off after less: drives come on, it parks, a stop on the way."""
        return POWER_ON_S + self.park_time_s + self.stop_time_s + LEAVE_SPARE_S


def state_settings(rig: RigFile, *, read_only: bool = False) -> StateSettings:
    """The state machine's settings from a rig file."""
    share, safety = rig.parking.speed_share, rig.safety
    across = (
        2.0 * limit / (share * v) + 2.0 * v / (share * a) + 2.0 * a / (share * j)
        for limit, v, a, j in zip(rig.limits, *rig.cue_limits(), strict=True)
    )
    return StateSettings(
        names=rig.actuator_names,
        answer_timeout_s=safety.answer_timeout,
        cue_stale_s=rig.cue.stale,
        overrun_cycles=safety.overrun_cycles,
        stop_time_s=safety.stop_time,
        park_time_s=1.5 * max(across) + safety.stop_time,
        refusal_grace_s=safety.overrun_cycles * rig.bus.cycle,
        read_only=read_only,
    )


def present(
    inputs: RigInputs, settings: StateSettings, state: RigState, now_s: float
) -> list[Finding]:
    """The causes present now: those handed in first, then those that inputs and time show."""
    found = list(inputs.findings)
    for name, drive in zip(settings.names, inputs.drives, strict=True):
        found += _of_drive(name, drive, settings, state, now_s)
    if state.name is StateName.ENGAGED and not is_back(inputs, settings, state):
        found.append(Finding(Cause.CUE_STALE, _stale(inputs, settings, state)))
    if inputs.overruns >= settings.overrun_cycles:
        found.append(Finding(Cause.OVERRUN, f"{inputs.overruns} cycles missed in a row"))
    if inputs.busy_cycles >= settings.overrun_cycles:
        found.append(
            Finding(Cause.BUS_BUSY, f"the transmit queue was full for {inputs.busy_cycles} cycles")
        )
    if inputs.bus_off:
        found.append(Finding(Cause.BUS_OFF, "the CAN controller has left the bus"))
    if not inputs.gateway_alive:
        found.append(Finding(Cause.GATEWAY_GONE, "the gateway process is silent"))
    if state.armed and not state.energised and now_s - state.armed_s > POWER_ON_S:
        found.append(
            Finding(Cause.POWER_ON_TIMEOUT, f"not every drive came on within {POWER_ON_S:g} s")
        )
    if now_s > state.deadline_s:
        found.append(Finding(Cause.RAMP_TIMEOUT, "the ramp to rest took longer than it may"))
    if state.armed and inputs.leaving_s > settings.leave_time_s:
        found.append(
            Finding(
                Cause.LEAVE_TIMEOUT,
                f"told to end, the rig is not parked and off within {settings.leave_time_s:.1f} s: "
                "its power is cut",
            )
        )
    return found


def is_fresh(inputs: RigInputs, settings: StateSettings) -> bool:
    """Whether there is a valid cue that is not stale."""
    return inputs.cue_age_s is not None and inputs.cue_age_s <= settings.cue_stale_s


def is_back(inputs: RigInputs, settings: StateSettings, state: RigState) -> bool:
    """Whether there is a fresh cue of the client whose cues engaged the rig."""
    return is_fresh(inputs, settings) and inputs.cue_client == state.client


def _stale(inputs: RigInputs, settings: StateSettings, state: RigState) -> str:
    if inputs.cue_age_s is None:
        return "the newest cue never came"
    if is_fresh(inputs, settings):
        return f"{state.client} sends no cues any more, {inputs.cue_client} does"
    return f"the newest cue is {inputs.cue_age_s:.3f} s old"


def _of_drive(
    name: str,
    drive: DriveStatus,
    settings: StateSettings,
    state: RigState,
    now_s: float,
) -> list[Finding]:
    found: list[Finding] = []
    silent_s = inf if drive.last_answer_s is None else now_s - drive.last_answer_s
    if drive.phase is DrivePhase.FAULT:
        found.append(Finding(Cause.DRIVE_ERROR, drive.error or f"{name} is in fault"))
    elif not drive.enpo and drive.phase in (PREPARED if state.armed else UP):
        found.append(Finding(Cause.ENPO_LOST, f"{name}: no hardware enable (ENPO)"))
    elif state.armed and drive.phase is DrivePhase.LOGGED_ON:
        found.append(Finding(Cause.DRIVE_REBOOTED, f"{name} has logged on anew"))
    elif state.energised and not drive.enabled:
        found.append(Finding(Cause.DRIVE_NOT_ENABLED, f"{name} is {drive.phase.value}"))
    watched = state.armed and drive.phase is not DrivePhase.ABSENT
    if (watched or drive.phase in UP) and silent_s > settings.answer_timeout_s:
        found.append(
            Finding(Cause.ANSWERS_LOST, f"{name} has answered nothing for {silent_s:.3f} s")
        )
    elif state.armed and drive.phase is DrivePhase.ABSENT:
        found.append(Finding(Cause.ANSWERS_LOST, f"{name} is gone from the bus"))
    if drive.phase in UP and not drive.watchdog_ok:
        found.append(
            Finding(Cause.WATCHDOG_UNVERIFIED, f"{name}: its own watchdog is not verified")
        )
    return found
