"""Objects of single drives, read and written through the daemon that runs the rig."""

from __future__ import annotations

import dataclasses

import pytest

from hil.daemon.core import RigCore
from hil.daemon.records import CommandRecord, ReplyRecord
from hil.drivefiles import load_profile
from hil.drives import build_drivers
from hil.drives.cia402 import codec
from hil.drives.cia402.sdo import Transfer
from hil.drives.lust_cdd3000.codec import AnswerStatus
from hil.frames import Frame
from hil.safety import Rule
from tests.daemon.simulated_rig import Session, rig_file
from tests.daemon.test_canopen_rigs import mixed

PROFILES = {"cia402": load_profile("cia402"), "lust_cdd3000": load_profile("lust_cdd3000")}
STOPPING = "608500"


@pytest.fixture
def parked() -> Session:
    session = Session(rig_file("axis_canopen"), PROFILES)
    session.wait_for("parked")
    return session


def test_an_object_is_read_while_the_rig_rides(parked: Session):
    parked.engaged(0.5)
    answer = parked.command("object", "axis read 101801")
    assert (answer.ok, answer.text) == (True, (0xABC).to_bytes(4, "little").hex())
    assert parked.command("object", "axis read 100800").text == b"Servo drive after CiA 402".hex()
    assert parked.core.state == "engaged"
    assert not parked.core._link.gate.refused


def test_an_object_is_written_while_the_drives_are_off(parked: Session):
    assert parked.command("object", f"axis write {STOPPING} 10270000").ok
    assert parked.command("object", f"axis read {STOPPING}").text == "10270000"


def test_nothing_is_written_while_the_rig_is_armed(parked: Session):
    parked.engaged(0.3)
    answer = parked.command("object", f"axis write {STOPPING} 10270000")
    assert not answer.ok
    assert "disarm it first" in answer.text
    assert parked.core.state == "engaged", "asking costs nothing"


@pytest.mark.parametrize(
    ("number", "why"),
    [
        ("606500", "hil itself writes"),  # following error window: the rig file's
        ("101601", "hil itself writes"),  # the drive's dead-man
        ("160001", "hil itself writes"),  # mapping
        ("607c00", "hil itself writes"),  # home offset: where zero is
        ("604000", "lets nobody write"),  # control word
        ("607a00", "lets nobody write"),  # target position
        ("604100", "lets nobody write"),  # status word
    ],
)
def test_what_keeps_people_safe_is_never_written(parked: Session, number: str, why: str):
    answer = parked.command("object", f"axis write {number} 00000000")
    assert not answer.ok
    assert why in answer.text
    assert parked.core.state == "parked"


@pytest.mark.parametrize("name", ["axis", "axis_canopen"])
@pytest.mark.parametrize("number", ["-1", "1000000", "f" * 40])
def test_a_number_that_no_object_can_have_is_refused(name: str, number: str):
    session = Session(rig_file(name), PROFILES)
    session.wait_for("parked")
    for request in (f"axis read {number}", f"axis write {number} 00000000"):
        answer = session.command("object", request)
        assert not answer.ok
        assert "has numbers up to" in answer.text
    session.run_until(session.now_s + 0.2)
    assert session.core.state == "parked"


def test_what_one_drive_lets_be_written_is_not_written_to_another():
    """Two legs of the platform are LUST's, the slide speaks CiA 402."""
    session = Session(mixed(), PROFILES)
    session.wait_for("parked")
    slide, leg = session.rig.actuator_names[2], session.rig.actuator_names[0]
    assert session.command("object", f"{slide} write {STOPPING} 10270000").ok
    watchdog = PROFILES["lust_cdd3000"].parameters.watchdog.number
    refused = session.command("object", f"{slide} write {watchdog:x} 00000000")
    assert "lets nobody write" in refused.text
    refused = session.command("object", f"{leg} write {STOPPING} 10270000")
    assert "has numbers up to ffff" in refused.text


def test_what_one_eds_lets_be_written_is_not_written_to_a_drive_with_another():
    rig, ours = rig_file("stewart_canopen"), PROFILES["cia402"]
    entries = {k: e for k, e in ours.objects.entries.items() if k != (0x6085, 0)}
    other = ours.model_copy(update={"objects": dataclasses.replace(ours.objects, entries=entries)})
    second = rig.actuators[1]
    drive = second.drive.model_copy(update={"profile": "other"})
    actuators = list(rig.actuators)
    actuators[1] = second.model_copy(update={"drive": drive})
    rig = rig.model_copy(update={"actuators": tuple(actuators)})
    gate = RigCore(rig, build_drivers(rig, {"cia402": ours, "other": other}), 0.0)._link.gate
    number = int(STOPPING, 16)
    assert gate.refuses_write(0, number) is None
    assert "lets nobody write" in gate.refuses_write(1, number)
    request = codec.node_ids(rig.address(1)).sdo_request
    frame = Frame(request, Transfer(0x6085, 0, bytes(4)).request, bus=second.drive.bus)
    assert gate.pass_frame(0.0, frame).rule is Rule.WRITE_PARAMETER


def test_the_rig_is_not_armed_while_an_object_is_being_written(parked: Session):
    parked.core.command(parked.now_s, CommandRecord(77, "object", f"axis write {STOPPING} 00"))
    parked.core.command(parked.now_s, CommandRecord(78, "arm"))
    parked.run_until(parked.now_s + 0.2)
    replies = {r.command_id: r for r in parked.of(ReplyRecord)}
    assert not replies[78].ok
    assert "being written" in replies[78].text
    assert not replies[77].ok, "one byte is no deceleration"
    assert "data_length" in replies[77].text
    parked.arm()


@pytest.mark.parametrize("command", ["arm", "park"])
def test_no_object_is_written_while_the_rig_is_about_to_be_armed(parked: Session, command: str):
    parked.run_until(parked.now_s + 0.2)
    parked.core.command(parked.now_s, CommandRecord(77, command))
    parked.core.command(
        parked.now_s, CommandRecord(78, "object", f"axis write {STOPPING} 10270000")
    )
    parked.core.command(parked.now_s, CommandRecord(79, "object", "axis read 101801"))
    parked.run_until(parked.now_s + 1.0)
    replies = {r.command_id: r for r in parked.of(ReplyRecord)}
    assert [replies[k].ok for k in (77, 78, 79)] == [True, False, True]
    assert "being armed" in replies[78].text
    assert parked.core.state == ("ready" if command == "arm" else "parked")
    assert not parked.core._link.gate.refused


def test_a_drive_that_is_gone_answers_nothing_and_that_is_said(parked: Session):
    parked.simulated.drives[0].silence()
    parked.core.command(parked.now_s, CommandRecord(77, "object", "axis read 101801"))
    parked.run_until(parked.now_s + 4.0)
    (reply,) = [r for r in parked.of(ReplyRecord) if r.command_id == 77]
    assert not reply.ok
    assert "axis" in reply.text


def test_a_write_that_was_given_up_is_not_done_later_all_the_same(parked: Session):
    """It waits behind a long object; told that it failed, a person arms: nothing may be written then."""
    drive = parked.simulated.drives[0]
    before = drive.objects.value(0x6085)
    drive.objects._values[0x1008, 0] = bytes(60_000)
    parked.core.command(parked.now_s, CommandRecord(77, "object", "axis read 100800"))
    parked.core.command(
        parked.now_s, CommandRecord(78, "object", f"axis write {STOPPING} 10270000")
    )
    parked.run_until(parked.now_s + 3.2)
    replies = {r.command_id: r for r in parked.of(ReplyRecord)}
    assert [replies[k].ok for k in (77, 78)] == [False, False]
    assert "withdrawn" in replies[78].text
    parked.engaged(12.0)
    assert drive.objects.value(0x6085) == before
    assert not parked.core._link.gate.refused
    assert parked.command("object", "axis read 101801").ok, "the channel is free again"


@pytest.mark.parametrize("answer", [None, (AnswerStatus.REPEAT_ACTION, 0)])
def test_a_parameter_that_is_never_answered_takes_no_slot_from_the_ride(answer: object):
    """A person's question is no reason to lose a drive's position, or to call it faulty, in mid-ride."""
    session = Session(rig_file("axis"), PROFILES).engaged(0.5)
    served = session.simulated.drives[0].parameters
    given = served.answer
    served.answer = lambda number, *a, **k: answer if number == 0xFFF else given(number, *a, **k)
    session.core.command(session.now_s, CommandRecord(77, "object", "axis read fff"))
    session.ride(4.0)
    assert session.core.state == "engaged"
    (reply,) = [r for r in session.of(ReplyRecord) if r.command_id == 77]
    assert "withdrawn" in reply.text
    gain = PROFILES["lust_cdd3000"].parameters.gains.position.number
    assert session.command("object", f"axis read {gain:x}").ok


def test_many_questions_leave_each_turn_of_measurements_its_slots():
    session = Session(rig_file("axis"), PROFILES).engaged(0.5)
    gain = PROFILES["lust_cdd3000"].parameters.gains.position.number
    began = len(session.of(ReplyRecord))
    for k in range(60):
        for j in range(8):
            asked = CommandRecord(100 + 8 * k + j, "object", f"axis read {gain:x}")
            session.core.command(session.now_s, asked)
        session.ride(0.06)
    assert session.core.state == "engaged"
    assert sum(r.ok for r in session.of(ReplyRecord)[began:]) > 30


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        ("leg9 read 101801", "no actuator"),
        ("axis read rubbish", "not hexadecimal"),
        ("axis write 101801", "neither"),
        ("axis erase 101801", "neither"),
        ("", "neither"),
    ],
)
def test_what_is_no_request_is_refused(parked: Session, request_: str, why: str):
    answer = parked.command("object", request_)
    assert not answer.ok
    assert why in answer.text


def test_a_lust_drives_parameters_are_read_in_its_slots():
    session = Session(rig_file("axis"), PROFILES).engaged(0.5)
    gain = PROFILES["lust_cdd3000"].parameters.gains.position.number
    answer = session.command("object", f"axis read {gain:x}")
    assert answer.ok, answer.text
    assert len(bytes.fromhex(answer.text)) == 4
    refused = session.command("object", "axis read fff")
    assert not refused.ok
    assert "parameter 4095" in refused.text
    session.ride(0.3)
    assert session.core.state == "engaged"
    watchdog = PROFILES["lust_cdd3000"].parameters.watchdog.number
    assert (
        "hil itself writes" in session.command("object", f"axis write {watchdog:x} 00000000").text
    )


def test_enquiries_are_part_of_what_is_replayed(parked: Session):
    sent = len([f for f in parked.sent() if f.frame.can_id == 0x601])
    parked.command("object", "axis read 101801")
    asked = [f.frame for f in parked.sent() if f.frame.can_id == 0x601][sent:]
    assert asked == [Frame(0x601, bytes.fromhex("4018100100000000"))]
