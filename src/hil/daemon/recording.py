"""Which calls of the recorder keep which records of control's."""

from __future__ import annotations

from collections.abc import Iterable

from hil.config import RigFile
from hil.daemon.gateway.state import state_message
from hil.daemon.ipc import Sources
from hil.daemon.records import (
    CommandRecord,
    CueRecord,
    EventRecord,
    FrameRecord,
    InputRecord,
    Record,
    SampleRecord,
    SetpointRecord,
    StateRecord,
)
from hil.daemon.wire import encode
from hil.frames import StampedFrame
from hil.runs import Recorder
from hil.runs.between import Between
from hil.signals import Event


def keep(
    recorder: Recorder | Between,
    records: Iterable[tuple[Record, bytes | None]],
    rig: RigFile,
    sources: Sources,
) -> None:
    """Record what is for keeping; records that only clients care for are passed over.

    Beside each record its bytes, where they are at hand. What one frame said becomes one message, and what
    was asked of all drives at one instant another: a fast rig says thousands a second.
    """
    imu = len(rig.actuators)
    said: dict[tuple[int, float, float], dict[str, float]] = {}
    asked: dict[tuple[float, str], dict[str, float]] = {}
    for record, raw in records:
        match record:
            case FrameRecord():
                stamped = StampedFrame(record.t_s, record.frame)
                recorder.frame(stamped, is_sent=record.is_sent)
                recorder.journal(raw or encode(record))
            case InputRecord() | CueRecord() | CommandRecord():
                recorder.journal(raw or encode(record))
            case SampleRecord(source, quantity, value, sampled_s, received_s) if source != imu:
                values = said.setdefault((source, received_s, sampled_s), {})
                values[quantity] = value
            case SampleRecord():
                recorder.sample(sources.sample(record))
            case SetpointRecord(t_s, actuator, kind, value):
                asked.setdefault((t_s, kind), {})[rig.actuator_names[actuator]] = value
            case StateRecord():
                recorder.state(state_message(record, rig))
            case EventRecord():
                recorder.event(Event(record.t_s, record.severity, record.name, record.text))
    for (source, received_s, sampled_s), values in said.items():
        recorder.answer(sources.names[source], received_s, sampled_s, values)
    for (t_s, kind), values in asked.items():
        recorder.setpoint(t_s, kind, values)
