"""The core: one rig's whole decision making, as functions of what came in and of the time.

`on_frame`, `on_due`, `on_refused`, `cue` and `command` are called with the present time; each returns (or
leads to) frames to send at once, already passed by the gate. What is to be published and recorded
gathers in `take_records`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Final

from hil.bus.state import ERR_BUS_OFF, ERR_RESTARTED
from hil.config import RigFile
from hil.daemon.core.enquiries import Enquiries
from hil.daemon.core.link import Link
from hil.daemon.core.motion import Motion, actuator_states, tracking_error
from hil.daemon.core.schedule import CYCLE, SYNC, Due, Schedule
from hil.daemon.cue_parts import split_cue
from hil.daemon.records import (
    NO_FRAME,
    CommandRecord,
    DriveRecord,
    EventRecord,
    InputRecord,
    Record,
    ReplyRecord,
    StateRecord,
)
from hil.drives.driver import DriveBus, DrivePhase, DriveStatus, PowerGoal
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
from hil.signals import Cue, Event

GATEWAY_TIMEOUT_S: Final = 1.0
"""A gateway silent for so long is gone; it beats ten times a second."""
COMMANDS: Final = {command.value: command for command in Command}
POWERING: Final = (Command.ARM.value, Command.PARK.value)
"""Commands that may power drives."""
OURS: Final = -1
"""Request number of requests that the core makes itself: nobody waits for the reply."""
EVENT_REPEAT_S: Final = 1.0
"""The same trouble is told once in so long, with the number of times it was held back."""
NAN: Final = float("nan")


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
        self._phases: list[DrivePhase | None] = [None] * len(drives)
        self._told: dict[str, tuple[float, int]] = {}
        self._cycle_s = NAN
        self._unreported = 0
        self._lateness_s = 0.0
        self._woken_s = start_s
        self._reported = ""
        self.start_at(start_s)
        self._refused_now = False
        self._busy_cycles = 0
        self._bus_off = self._bus_again = False
        self._ending = False
        self.bus_load = NAN
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

    # what comes in

    def on_frame(self, now_s: float, frame: Frame) -> Sequence[Frame]:
        """A frame was received. Nothing is ever sent in answer: what is sent waits for its slot."""
        self._heard_count += 1
        if frame.is_error:
            self._on_error_frame(now_s, frame)
        elif self._bus_off:  # a controller that is off hears nothing: it was restarted by hand
            self._on_bus_again(now_s)
        samples, events = self._link.receive(now_s, frame)
        for sample in samples:
            self._motion.sample(sample)
        self._note(events)
        return ()

    def cue(self, now_s: float, cue: Cue) -> None:
        """A cue has arrived."""
        self._heard(now_s, "cue", *split_cue(cue))
        verdict = self._motion.cue(now_s, cue)
        if verdict.name != "accepted":
            self._tell(now_s, f"cue_{verdict.name.replace(':', '_')}", verdict.text)

    def command(self, now_s: float, command: CommandRecord) -> None:
        """A client's command; its reply is among the records, at the next cycle at the latest."""
        self._heard(now_s, "command", command)
        if command.name == "gain":
            self._records.append(self._set_gain(command))
        elif command.name == "object":
            refused = self._enquiries.begin(now_s, command)
            self._records += [refused] if refused else []
        elif command.name in POWERING and self._enquiries.is_writing:
            text = "an object of a drive is being written: wait for its answer"
            self._records.append(ReplyRecord(command.command_id, False, text))
        elif command.name in COMMANDS:
            self._requests.append(Request(command.command_id, COMMANDS[command.name]))
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
        self._refused_now = True
        if is_off:
            self._bus_off, self._bus_again = True, False
        self._tell(now_s, "bus_refused", f"{frame} was not sent: {error}")

    def end(self) -> None:
        """Somebody wants to leave: park if the drives are on, then switch them off."""
        self._heard(self._last_s, "end")
        self._ending = True

    def cut_power(self) -> None:
        """Drives off at the next slot, whatever the rig does: parking took too long."""
        self._heard(self._last_s, "cut_power")
        self._state = self._state.disarm()

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
        self._unreported += 1
        is_turn = self._unreported >= self._motion.shaping_cycles
        if not self._link.drives.is_synchronous:
            self._woken_s = now_s
        self._motion.observe(now_s, is_needed=is_turn)
        frames = self._link.begin(now_s)
        self._note(self._link.drives.take_events())
        self._busy_cycles = self._busy_cycles + 1 if self._refused_now else 0
        self._refused_now = False
        statuses = self._link.statuses
        inputs = self._inputs(now_s, statuses)
        outputs, self._state = self._machine.step(inputs, self._state, now_s)
        self._requests = []
        if self._bus_again:  # only now: the cycle must see that it was off
            self._bus_off = self._bus_again = False
        self._power, self._goal = outputs.power, outputs.motion
        self._link.gate.arm() if outputs.armed else self._link.gate.disarm()
        # By the schedule, not by the wake-up: lateness must not become speed jitter.
        self._motion.step(due.due_s, outputs.motion)
        self._note(outputs.events)
        self._records += [
            ReplyRecord(r.request_id, r.ok, r.message)
            for r in outputs.replies
            if r.request_id != OURS
        ]
        self._records += self._enquiries.replies(now_s)
        self._report(now_s, due, statuses)
        return frames

    def _inputs(self, now_s: float, statuses: tuple[DriveStatus, ...]) -> RigInputs:
        age_s = self._motion.guard.age_s(now_s)
        return RigInputs(
            drives=statuses,
            cue_age_s=None if age_s == float("inf") else age_s,
            requests=(*self._requests, *self._own_requests()),
            at_rest=self._motion.at_rest,
            at_parked=self._motion.at_parked,
            near_parked=self._motion.near_parked,
            findings=self._link.findings(now_s),
            overruns=self._schedule.missed_in_a_row,
            busy_cycles=self._busy_cycles,
            bus_off=self._bus_off,
            gateway_alive=now_s - self._gateway_s < GATEWAY_TIMEOUT_S,
        )

    def _own_requests(self) -> tuple[Request, ...]:
        if not self._ending or not self._state.armed:
            return ()
        if self._state.name in (StateName.READY, StateName.ENGAGED):
            return (Request(OURS, Command.PARK),)
        if self._state.name is StateName.PARKED:
            return (Request(OURS, Command.DISARM),)
        return ()

    def _on_error_frame(self, now_s: float, frame: Frame) -> None:
        error_class = frame.can_id
        if error_class & ERR_BUS_OFF:
            self._bus_off, self._bus_again = True, False
            self._tell(now_s, "bus_off", "the CAN controller has left the bus")
        elif error_class & ERR_RESTARTED:
            self._on_bus_again(now_s)

    def _on_bus_again(self, now_s: float) -> None:
        if not self._bus_again:
            self._bus_again = True
            self._tell(now_s, "bus_on", "the CAN controller is on the bus again")

    def _set_gain(self, command: CommandRecord) -> ReplyRecord:
        try:
            self._motion.shaper.set_gain(float(command.argument))
        except (ValueError, LimitViolation) as error:
            return ReplyRecord(command.command_id, False, str(error))
        return ReplyRecord(command.command_id, True, f"master gain {float(command.argument):g}")

    # what is told

    def _report(self, now_s: float, due: Due, statuses: tuple[DriveStatus, ...]) -> None:
        """Phases that changed; the rig's state whenever it is another, else once a plan of the motion."""
        for i, status in enumerate(statuses):
            if status.phase is not self._phases[i]:
                self._phases[i] = status.phase
                self._records.append(
                    DriveRecord(now_s, i, status.phase.value, status.enabled, status.error or "")
                )
        period_s, self._cycle_s = now_s - self._cycle_s, now_s
        self._lateness_s = max(self._lateness_s, self._woken_s - due.due_s)
        if self._unreported < self._motion.shaping_cycles and self.state == self._reported:
            return
        self._unreported, self._reported = 0, self.state
        lateness_s, self._lateness_s = self._lateness_s, 0.0
        motion, observed, reference = self._motion, self._motion.observed, self._motion.reference
        fault = self._state.fault
        self._records.append(
            StateRecord(
                now_s,
                self.state,
                tuple(observed.pose.tolist()) if observed.is_known else (NAN,) * len(statuses),
                tuple(reference.pose.tolist()) if reference else (NAN,) * len(statuses),
                actuator_states(motion),
                tracking_error(motion),
                lateness_s,
                period_s,
                self._schedule.cycles,
                self._schedule.overruns,
                sum(s.slots for s in statuses),
                sum(s.pairs for s in statuses),
                self.bus_load,
                f"{fault.cause.value}: {fault.text}" if fault else "",
            )
        )

    def _note(self, events: Sequence[Event]) -> None:
        self._records += [EventRecord(e.t_s, e.severity, e.name, e.text) for e in events]

    def _tell(self, now_s: float, name: str, text: str) -> None:
        """A warning, but of its kind only one a second."""
        told_s, held_back = self._told.get(name, (-EVENT_REPEAT_S, 0))
        if now_s - told_s < EVENT_REPEAT_S:
            self._told[name] = (told_s, held_back + 1)
            return
        more = f" ({held_back} more like it)" if held_back else ""
        self._told[name] = (now_s, 0)
        self._records.append(EventRecord(now_s, "warning", name, text + more))
