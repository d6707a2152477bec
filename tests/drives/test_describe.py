"""Frames in words: what each kind says, and that nothing unknown or broken upsets whoever looks."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.configfile import load_drive, load_rig
from hil.drives import imu_node
from hil.drives.describe import Describer
from hil.drives.lust_cdd3000 import codec
from hil.drives.power import PowerCommand, PowerState
from hil.drives.profile import LustProfile
from hil.frames import Frame

RIG = load_rig("motorcycle")
PROFILE = load_drive("lust_cdd3000", LustProfile)
IDS = codec.frame_ids(PROFILE.ids, RIG.address(1))
NODE = RIG.actuators[1].drive
describe = Describer(RIG, PROFILE).describe


def test_a_control_frame_says_command_and_setpoint():
    counts = round(0.61 * NODE.counts_per_unit)
    frame = codec.encode_control(
        IDS.control, PROFILE.layout, codec.Control(PowerCommand.ENABLE, counts)
    )
    said = describe(frame)
    assert (said.source, said.name, said.text) == ("leg2", "control", "enable, +0.610000 m")
    assert said.values["setpoint"] == pytest.approx(0.61, abs=1.0 / NODE.counts_per_unit)


def test_a_status_frame_says_state_and_what_is_missing():
    status = codec.Status(PowerState.SWITCH_ON_DISABLED, enpo=False)
    said = describe(codec.encode_status(IDS.status, PROFILE.layout, status))
    assert said.text == "switch on disabled, no ENPO"


def test_parameters_go_by_the_drive_files_names_and_scales():
    dog = PROFILE.parameters.watchdog
    written = codec.Request(dog.number, codec.Mode.WRITE, 100)
    assert describe(codec.encode_request(IDS.request, written)).text == "write watchdog = 0.1"
    gain = PROFILE.parameters.gains.position
    raw = codec.to_wire(gain.type, 40.0 / gain.scale)
    answered = codec.Answer(gain.number, codec.AnswerStatus(0), raw)
    assert describe(codec.encode_answer(IDS.answer, answered)).text == "position gain = 40"


def test_a_measured_value_is_in_si():
    number = PROFILE.parameters.measurements.force.number
    answer = codec.Answer(number, codec.AnswerStatus(0), 12)
    said = describe(codec.encode_answer(IDS.answer, answer))
    assert said.values == {"force": pytest.approx(12 * NODE.force_per_count)}


def test_a_refusal_is_told_by_its_bits():
    answer = codec.Answer(574, codec.AnswerStatus.CHANGE_NOT_PERMITTED)
    said = describe(codec.encode_answer(IDS.answer, answer))
    assert said.text == "watchdog: change not permitted"


def test_errors_and_system_frames_are_named():
    error = codec.encode_error(IDS.error, PROFILE.error_frame, 3, 0, 0)
    assert "E-OC" in describe(error).text
    assert describe(codec.encode_system(PROFILE.ids, PROFILE.system.stop)).text == "stop"
    assert describe(Frame(IDS.log_on)).text == "logs on"


def test_the_imu_is_read():
    gyro, accel = imu_node.encode(RIG.can.imu_base_id, (0.1, -0.2, 0.3), (0.0, 0.0, 9.81), 7)
    assert describe(gyro).values["gyro_y"] == pytest.approx(-0.2, abs=1e-4)
    assert describe(accel).source == "imu"
    assert describe(accel).text.endswith("no. 7")


def test_what_is_not_of_the_rig_is_unknown():
    assert describe(Frame(0x123, b"\x01")).name == "unknown"
    assert describe(Frame(IDS.status, bytes(8), is_extended=True)).name == "unknown"


@given(
    can_id=st.sampled_from([*(getattr(IDS, n) for n in IDS.__slots__), RIG.can.imu_base_id, 0x0DD]),
    data=st.binary(max_size=8),
    remote=st.booleans(),
)
def test_no_frame_upsets_it(can_id, data, remote):
    said = describe(Frame(can_id, data, is_remote=remote))
    assert said.text
    assert all(isinstance(v, float) and not math.isinf(v) for v in said.values.values())
