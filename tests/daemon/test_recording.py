"""What control tells in batches is recorded in few messages, and nothing of it is lost."""

from __future__ import annotations

import json
from pathlib import Path

from hil.configfile import rig_toml
from hil.daemon.ipc import Sources
from hil.daemon.recording import keep
from hil.daemon.records import FrameRecord, SampleRecord, SetpointRecord
from hil.daemon.wire import datagram, decode_with_bytes, encode
from hil.frames import Frame
from hil.runs import Recorder, load_run
from hil.runs.folder import RECORDING
from hil.runs.journal import JournalSource
from hil.runs.mcapfile import McapSource
from tests.daemon.simulated_rig import rig_file


def test_what_one_frame_said_and_what_was_asked_at_once_is_one_message_each(tmp_path: Path) -> None:
    rig = rig_file("stewart_canopen")
    recorder = Recorder(tmp_path, rig_toml(rig), rig, 0.0)
    records = [
        SampleRecord(0, "position", 1.01, 0.999, 1.0),
        SampleRecord(0, "force", 250.0, 0.999, 1.0),
        SampleRecord(1, "position", 1.02, 0.999, 1.0001),
        SampleRecord(0, "position", 1.03, 1.001, 1.002),
        SampleRecord(6, "gyro_x", 0.1, 1.0, 1.005),
        *(SetpointRecord(1.003, i, "position", 1.0 + 0.01 * i) for i in range(6)),
        FrameRecord(1.003, True, Frame(0x201, bytes(6), bus=1)),
    ]
    sent = decode_with_bytes(datagram(map(encode, records)))
    assert [record for record, _ in sent] == records
    keep(recorder, sent, rig, Sources(rig.actuator_names))
    recorder.close()
    messages = [(m.topic, json.loads(m.data)) for m in McapSource(recorder.path / RECORDING)]
    told = [body for topic, body in messages if topic == "/drive/leg1"]
    assert told == [
        {"t": 1.0, "sampled": 0.999, "position": 1.01, "force": 250.0},
        {"t": 1.002, "sampled": 1.001, "position": 1.03},
    ]
    (asked,) = [body for topic, body in messages if topic == "/setpoint"]
    assert len(asked["values"]) == 6
    assert b"".join(JournalSource(recorder.path)) == encode(records[-1])
    table = load_run(recorder.path).table
    assert {"leg1.position", "leg1.force", "leg6.setpoint", "imu.gyro_x"} <= set(table.columns)
