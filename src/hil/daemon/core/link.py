"""Between the core and the wire: drivers, gate, monitor and IMU receiver of one rig.

Every frame that leaves is made by a driver and judged by the gate; every frame that comes in is turned into
samples, events and findings. What passed either way is recorded.
"""

from __future__ import annotations

from collections.abc import Iterable

from hil.config import RigFile
from hil.daemon.records import FrameRecord, Record, SampleRecord, SetpointRecord
from hil.drives.driver import DriveBus, DriveStatus, PowerGoal
from hil.drives.imu_node import ImuReceiver
from hil.drives.meaning import Ask, Meaning
from hil.frames import Frame
from hil.safety import Finding, Gate, Monitor, finding_of, gate_limits
from hil.signals import Event, Sample


class Link:
    """What one rig says and hears on its bus."""

    def __init__(self, rig: RigFile, drives: DriveBus, *, read_only: bool = False) -> None:
        self.drives = drives
        self.gate = Gate(
            gate_limits(rig, *(d.wire_kind for d in drives)), drives.meaning, read_only=read_only
        )
        self.monitor = Monitor(rig, drives.meaning)
        self.imu = ImuReceiver(rig.can.imu_base_id, rig.imu.group_delay_s) if rig.imu else None
        self._index = {name: i for i, name in enumerate((*rig.actuator_names, "imu"))}
        self._findings: list[Finding] = []
        self.records: list[Record] = []
        """Frames, samples and setpoints, in their order; who takes them empties it."""

    @property
    def statuses(self) -> tuple[DriveStatus, ...]:
        """The drives as known now."""
        return tuple(driver.status for driver in self.drives)

    def receive(self, now_s: float, frame: Frame) -> tuple[list[Sample], list[Event]]:
        """What a received frame says; what is wrong with it becomes a finding or a count."""
        records, monitor = self.records, self.monitor
        records.append(FrameRecord(now_s, False, frame))
        self._findings += monitor.on_frame(frame)
        said: list[Sample | Event] = self.drives.on_frame(now_s, frame)
        if self.imu is not None and frame.bus == 0:
            said = [*said, *self.imu.on_frame(now_s, frame)]
        samples: list[Sample] = []
        events: list[Event] = []
        for item in said:
            if isinstance(item, Event):
                events.append(item)
                continue
            samples.append(item)
            source, quantity, value, sampled_s, _ = item
            i = self._index[source]
            if quantity == "position":
                self.gate.measured(i, value, now_s)
            self._findings += monitor.on_sample(i, item)
            records.append(SampleRecord(i, quantity, value, sampled_s, now_s))
        if events:
            self.take_in(events)
        return samples, events

    def take_in(self, events: Iterable[Event]) -> None:
        """Turn drivers' fault events into findings for the state machine."""
        found = (finding_of(event) for event in events)
        self._findings += [finding for finding in found if finding is not None]

    def sync(self, now_s: float) -> list[Frame]:
        """Frames that mark the beginning of a cycle for the drives: before anything is reckoned."""
        return self._passed(now_s, self.drives.on_sync(now_s))

    def begin(self, now_s: float) -> list[Frame]:
        """Frames that concern the whole bus; once a cycle."""
        return self._passed(now_s, self.drives.on_cycle(now_s))

    def slot(
        self,
        now_s: float,
        i: int,
        goal: PowerGoal,
        setpoint: float | None,
        position: float | None,
    ) -> list[Frame]:
        """Frames of drive i's slot, as far as the gate lets them pass.

        `position` is the actuator's position, m or rad, that the setpoint is meant to bring about.
        """
        frames = self.drives[i].on_slot(now_s, goal, setpoint)
        return self._passed(now_s, frames, position)

    def findings(self, now_s: float) -> tuple[Finding, ...]:
        """What monitor, drivers and gate have found since the last call, once a cycle."""
        self._findings += self.monitor.findings(now_s)
        found, self._findings = (*self._findings, *self.gate.findings()), []
        return found

    def _passed(
        self, now_s: float, frames: Iterable[Frame], position: float | None = None
    ) -> list[Frame]:
        passed: list[Frame] = []
        for frame in frames:
            verdict = self.gate.pass_frame(now_s, frame)
            if not verdict.ok:
                continue
            passed.append(frame)
            self.records.append(FrameRecord(now_s, True, frame))
            meaning = verdict.meaning
            if meaning is not None and meaning.ask is Ask.POWER_ON:
                self._commanded(now_s, meaning, position)
        return passed

    def _commanded(self, now_s: float, meaning: Meaning, position: float | None) -> None:
        """Note the setpoint that went out, as the gate read it back from the frame."""
        i, kind, value = meaning.actuator, meaning.kind, meaning.setpoint
        if i is None or kind is None or value is None:
            return
        self.records.append(SetpointRecord(now_s, i, kind, value))
        if position is not None:
            self.monitor.commanded(i, position, now_s)
