"""Which call of the recorder keeps which record of control's."""

from __future__ import annotations

from hil.config import RigFile
from hil.daemon.gateway_state import state_message
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


def keep(recorder: Recorder | Between, record: Record, rig: RigFile, sources: Sources) -> None:
    """Record what is for keeping; records that only clients care for are passed over."""
    match record:
        case FrameRecord():
            stamped = StampedFrame(record.t_s, record.frame)
            recorder.frame(stamped, is_sent=record.is_sent)
            recorder.journal(encode(record))
        case InputRecord() | CueRecord() | CommandRecord():
            recorder.journal(encode(record))
        case SampleRecord():
            recorder.sample(sources.sample(record))
        case SetpointRecord():
            values = {rig.actuator_names[record.actuator]: record.value}
            recorder.setpoint(record.t_s, record.kind, values)
        case StateRecord():
            recorder.state(state_message(record, rig))
        case EventRecord():
            recorder.event(Event(record.t_s, record.severity, record.name, record.text))
