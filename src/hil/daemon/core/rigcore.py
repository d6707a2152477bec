"""The core: one rig's whole decision making, as functions of what came in and of the time.

`on_frame`, `on_due`, `on_refused`, `cue` and `command` are called with the present time; each returns (or
leads to) frames to send at once, already passed by the gate. What is to be published and recorded
gathers in `take_records`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Final

from hil.config import RigFile
from hil.daemon.core.buses import Buses
from hil.daemon.core.enquiries import Enquiries
from hil.daemon.core.link import Link
from hil.daemon.core.motion import Motion
from hil.daemon.core.schedule import CYCLE, SYNC, Due, Schedule
from hil.daemon.core.telling import Telling
from hil.daemon.cue_parts import split_cue
from hil.daemon.records import (
    NO_FRAME,
    CommandRecord,
    InputRecord,
    Record,
    ReplyRecord,
)
from hil.drives.driver import DriveBus, DriveStatus, PowerGoal
from hil.errors import BusError, BusOff, LimitViolation
from hil.frames import Frame
from hil.rigs import build_rig
from hil.safety import (
    Command,
    MotionGoal,
    Request,
    RigInputs,
    RigState,
    RigStateMachine,
    StateName,
    state_settings,
)
from hil.signals import Cue

GATEWAY_TIMEOUT_S: Final = 1.0
"""A gateway silent for so long is gone; it beats ten times a second."""
COMMANDS: Final = {command.value: command for command in Command}
POWERING: Final = (Command.ARM, Command.PARK)
"""Commands that may power drives."""
OFF_CYCLES: Final = 10
"""Cycles in which the drives are told to be off before a core that was told to end has ended."""
OURS: Final = -1
"""Request number of requests that the core makes itself: nobody waits for the reply."""


class RigCore:
    """One rig. `start_s` is the instant of the first cycle, s; `start_at` moves it."""

    def __init__(
        self, rig: RigFile, drives: DriveBus, start_s: float, *, read_only: bool = False
    ) -> None:
        self.rig = rig
        self._link = Link(rig, drives, read_only=read_only)
        self._enquiries = Enquiries(drives, self._link.gate)
        manipulator, takes_force = build_rig(rig), drives[0].setpoint_kind == "force"
        Motion(rig, manipulator, takes_force).rehearse()
        self._motion = Motion(rig, manipulator, takes_force)
        self._machine = RigStateMachine(state_settings(rig, read_only=read_only))
        self._state = RigState()
        self._power, self._goal = PowerGoal.OFF, MotionGoal.NONE
        self._requests: list[Request] = []
        self._records = self._link.records  # one list: its order is the order of what happened
        self._heard_count = 0
        self._telling = Telling(self._records, len(drives))
        self._buses = Buses()
        self._woken_s = start_s
        self.start_at(start_s)
        self._ending_s: float | None = None
        self._off_cycles = 0
        self.is_cut = False
        """An emergency has cut the power of a rig that was told to end."""
        self.bus_load = float("nan")
        """Share of the bus in use, as whoever holds the port has measured it."""

    def start_at(self, start_s: float) -> None:
        """Begin the first cycle at `start_s`, s: building the core may have taken its time."""
        self._heard(start_s, "listen" if self._link.gate.read_only else "start")
        bus = self.rig.bus
        stagger_s = bus.stagger if bus.schedule == "parameter" else 0.0
        drives = self._link.drives
        self._schedule = Schedule(
            start_s, bus.cycle, stagger_s, len(drives), synchronous=drives.is_synchronous
        )
        self._gateway_s = inf  # not heard yet: it may take seconds to start; nothing moves before

    @property
    def state(self) -> str:
        """Name of the rig's state."""
        return self._state.name.value

    @property
    def armed(self) -> bool:
        """Whether the gate lets the drives be powered."""
        return self._state.armed

    @property
    def is_ending(self) -> bool:
        """Whether somebody wants to leave."""
        return self._ending_s is not None

    @property
    def has_ended(self) -> bool:
        """Whether it was told to end, the drives are off and have been told so often enough."""
        return self.is_ending and self._off_cycles > OFF_CYCLES

    # what comes in

    def on_frame(self, now_s: float, frame: Frame) -> Sequence[Frame]:
        """A frame was received. Nothing is ever sent in answer: what is sent waits for its slot."""
        self._heard_count += 1
        buses = self._buses
        if (buses.is_off or frame.is_error) and (said := buses.heard(frame)):
            self._telling.warn(now_s, *said)
        samples, events = self._link.receive(now_s, frame)
        for sample in samples:
            self._motion.sample(sample)
        if events:
            self._telling.note(events)
        return ()

    def cue(self, now_s: float, cue: Cue) -> None:
        """A cue has arrived."""
        self._heard(now_s, "cue", *split_cue(cue))
        verdict = self._motion.cue(now_s, cue)
        if verdict.name != "accepted":
            self._telling.warn(now_s, f"cue_{verdict.name.replace(':', '_')}", verdict.text)

    def command(self, now_s: float, command: CommandRecord) -> None:
        """A client's command; its reply is among the records, at the next cycle at the latest."""
        self._heard(now_s, "command", command)
        if command.name == "gain":
            self._records.append(self._set_gain(command))
        elif command.name == "object":
            is_arming = any(request.command in POWERING for request in self._requests)
            refused = self._enquiries.begin(now_s, command, is_arming=is_arming)
            self._records += [refused] if refused else []
        elif COMMANDS.get(command.name) in POWERING and self._enquiries.is_writing:
            text = "an object of a drive is being written: wait for its answer"
            self._records.append(ReplyRecord(command.command_id, False, text))
        elif command.name in COMMANDS:
            asked = COMMANDS[command.name]
            self._requests.append(Request(command.command_id, asked, command.argument))
        else:
            known = ", ".join((*COMMANDS, "gain", "object"))
            text = f"{command.name!r} is no command of a rig; there are {known}"
            self._records.append(ReplyRecord(command.command_id, False, text))

    def gateway_alive(self, now_s: float) -> None:
        """The gateway process has been heard."""
        self._heard(now_s, "gateway")
        self._gateway_s = now_s

    def on_refused(self, now_s: float, frame: Frame, error: BusError) -> None:
        """The bus did not take a frame that had passed the gate."""
        is_off = isinstance(error, BusOff)
        self._heard(now_s, "refused_off" if is_off else "refused", frame=frame)
        self._buses.refused(frame.bus, is_off=is_off)
        self._telling.warn(now_s, "bus_refused", f"{frame} was not sent: {error}")

    def end(self) -> None:
        """Somebody wants to leave: park if the drives are on, then switch them off. Again: nothing new."""
        if self.is_ending:
            return
        self._heard(self._last_s, "end")
        self._ending_s = self._last_s
        if self._state.name is StateName.PARKING and self._state.held:
            self._requests.append(Request(OURS, Command.PARK))

    # what is due

    @property
    def next_due_s(self) -> float:
        """When `on_due` wants to be called, s."""
        return self._schedule.next_due_s

    def on_due(self, now_s: float) -> list[Frame]:
        """Do all that is due; returns the frames to send, in order."""
        self._heard(now_s, "due")
        frames: list[Frame] = []
        for due in self._schedule.take(now_s):
            if due.slot == SYNC:
                self._woken_s = now_s
                frames += self._link.sync(now_s)
            elif due.slot == CYCLE:
                frames += self._begin_cycle(now_s, due)
            else:
                value, position = self._motion.wanted(due.slot)
                frames += self._link.slot(now_s, due.slot, self._power, value, position)
        return frames

    def take_records(self) -> list[Record]:
        """All there is to publish and record since the last call."""
        records = self._records.copy()
        self._records.clear()
        return records

    def _heard(self, now_s: float, what: str, *details: Record, frame: Frame = NO_FRAME) -> None:
        """Enter into the journal what the core is told: fed with it again, it decides the same again."""
        self._heard_count += 1
        self._last_s = now_s
        self._records += (InputRecord(self._heard_count, now_s, what, frame), *details)

    def _begin_cycle(self, now_s: float, due: Due) -> list[Frame]:
        link, motion, telling, buses = self._link, self._motion, self._telling, self._buses
        if not link.drives.is_synchronous:
            self._woken_s = now_s
        motion.observe(now_s, is_needed=telling.begins(motion))
        frames = link.begin(now_s)
        telling.note(link.drives.take_events())
        buses.begin_cycle()
        statuses = link.statuses
        inputs = self._inputs(now_s, statuses)
        was_armed = self._state.armed
        outputs, self._state = self._machine.step(inputs, self._state, now_s)
        if self.is_ending and was_armed and outputs.state is StateName.EMERGENCY:
            self.is_cut = True
        buses.seen()
        self._power, self._goal = outputs.power, outputs.motion
        link.gate.arm() if outputs.armed else link.gate.disarm()
        self._off_cycles = 0 if outputs.armed else self._off_cycles + 1
        # By the schedule, not by the wake-up: lateness must not become speed jitter.
        motion.step(due.due_s, outputs.motion)
        telling.note(outputs.events)
        self._records += [
            ReplyRecord(r.request_id, r.ok, r.message)
            for r in outputs.replies
            if r.request_id != OURS
        ]
        self._records += self._enquiries.replies(now_s)
        late_s = self._woken_s - due.due_s
        telling.report(now_s, late_s, self._state, motion, statuses, self._schedule, self.bus_load)
        return frames

    def _inputs(self, now_s: float, statuses: tuple[DriveStatus, ...]) -> RigInputs:
        motion, age_s = self._motion, self._motion.guard.age_s(now_s)
        # Our own first: what a person says at the same time holds, a stop above all.
        requests, self._requests = (*self._own_requests(), *self._requests), []
        return RigInputs(
            drives=statuses,
            cue_age_s=None if age_s == inf else age_s,
            cue_client=motion.guard.active_client(now_s),
            requests=requests,
            at_rest=motion.at_rest,
            at_parked=motion.at_parked,
            near_parked=bool(requests) and motion.near_parked,  # only who asks for power is told
            findings=self._link.findings(now_s),
            overruns=self._schedule.missed_in_a_row,
            busy_cycles=self._buses.busy_cycles,
            bus_off=self._buses.is_off,
            gateway_alive=now_s - self._gateway_s < GATEWAY_TIMEOUT_S,
            leaving_s=0.0 if self._ending_s is None else now_s - self._ending_s,
        )

    def _own_requests(self) -> tuple[Request, ...]:
        """What an ending core asks of itself. A stop that a person says meanwhile ends on the spot."""
        if not self.is_ending or not self._state.armed:
            return ()
        if self._state.name in (StateName.READY, StateName.ENGAGED):
            return (Request(OURS, Command.PARK),)
        is_stopped = self._state.name is StateName.PARKING and self._state.held
        if self._state.name is StateName.PARKED or (is_stopped and self._motion.at_rest):
            return (Request(OURS, Command.DISARM),)
        return ()

    def _set_gain(self, command: CommandRecord) -> ReplyRecord:
        try:
            self._motion.shaper.set_gain(float(command.argument))
        except (ValueError, LimitViolation) as error:
            return ReplyRecord(command.command_id, False, str(error))
        return ReplyRecord(command.command_id, True, f"master gain {float(command.argument):g}")
