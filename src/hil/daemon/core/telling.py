"""What the core tells of itself: the rig's state once a plan of the motion, phases that changed, events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hil.daemon.core.motion import Motion, actuator_states, tracking_error
from hil.daemon.core.schedule import Schedule
from hil.daemon.records import DriveRecord, EventRecord, Record, StateRecord
from hil.drives.driver import DrivePhase, DriveStatus
from hil.safety import RigState
from hil.signals import Event

EVENT_REPEAT_S: Final = 1.0
"""The same trouble is told once in so long, with the number of times it was held back."""
NAN: Final = float("nan")


class Telling:
    """Writes into `records`, whose order is the order of what happened."""

    def __init__(self, records: list[Record], drives: int) -> None:
        self.records = records
        self._phases: list[DrivePhase | None] = [None] * drives
        self._told: dict[str, tuple[float, int]] = {}
        self._cycle_s = NAN
        self._unreported = 0
        self._lateness_s = 0.0
        self._reported = ""

    def begins(self, motion: Motion) -> bool:
        """A cycle begins; whether the rig's state is told in it in any case."""
        self._unreported += 1
        return self._unreported >= motion.shaping_cycles

    def report(
        self,
        now_s: float,
        lateness_s: float,
        state: RigState,
        motion: Motion,
        statuses: tuple[DriveStatus, ...],
        schedule: Schedule,
        bus_load: float,
    ) -> None:
        """Phases that changed; the rig's state whenever it is another, else once a plan of the motion."""
        for i, status in enumerate(statuses):
            if status.phase is not self._phases[i]:
                self._phases[i] = status.phase
                self.records.append(
                    DriveRecord(now_s, i, status.phase.value, status.enabled, status.error or "")
                )
        period_s, self._cycle_s = now_s - self._cycle_s, now_s
        self._lateness_s = max(self._lateness_s, lateness_s)
        name = state.name.value
        if self._unreported < motion.shaping_cycles and name == self._reported:
            return
        self._unreported, self._reported = 0, name
        worst_s, self._lateness_s = self._lateness_s, 0.0
        observed, reference, fault = motion.observed, motion.reference, state.fault
        self.records.append(
            StateRecord(
                now_s,
                name,
                tuple(observed.pose.tolist()) if observed.is_known else (NAN,) * len(statuses),
                tuple(reference.pose.tolist()) if reference else (NAN,) * len(statuses),
                actuator_states(motion),
                tracking_error(motion),
                worst_s,
                period_s,
                schedule.cycles,
                schedule.overruns,
                sum(s.slots for s in statuses),
                sum(s.pairs for s in statuses),
                bus_load,
                f"{fault.cause.value}: {fault.text}" if fault else "",
            )
        )

    def note(self, events: Sequence[Event]) -> None:
        """Events, each as it is."""
        for e in events:
            self.records.append(EventRecord(e.t_s, e.severity, e.name, e.text))

    def warn(self, now_s: float, name: str, text: str) -> None:
        """A warning, but of its kind only one a second."""
        told_s, held_back = self._told.get(name, (-EVENT_REPEAT_S, 0))
        if now_s - told_s < EVENT_REPEAT_S:
            self._told[name] = (told_s, held_back + 1)
            return
        more = f" ({held_back} more like it)" if held_back else ""
        self._told[name] = (now_s, 0)
        self.records.append(EventRecord(now_s, "warning", name, text + more))
