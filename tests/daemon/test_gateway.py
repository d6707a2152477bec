"""The gateway lets well-formed cues in, shows the rig to clients, and outlives the rest."""

from __future__ import annotations

import json
import os
import shutil
import time

import msgspec
import pytest

from hil import messages
from hil.daemon.gateway.gateway import GatewayOptions
from hil.daemon.records import (
    DriveRecord,
    EventRecord,
    FrameRecord,
    GatewayAlive,
    ReplyRecord,
    SampleRecord,
    SetpointRecord,
)
from hil.errors import ConfigError, RigInUse
from hil.frames import Frame
from tests.daemon.gateway_rig import (
    RunningGateway,
    free_port,
    gateway,
    plain,
    rig_at,
    until,
)

QUIET = GatewayOptions(is_recording=False, command_timeout_s=0.2)


@pytest.fixture
def running(tmp_path):
    with gateway(tmp_path, QUIET) as one:
        yield one


@pytest.fixture
def client(running):
    with plain(running.endpoint) as one:
        yield one


def names(events):
    return [event["name"] for event in events]


def test_a_cue_reaches_control_with_poses_in_the_rigs_order(running, client):
    before_s = time.monotonic()
    poses = [{"roll": 0.03, "dt": 0.01 * k, "yaw": 0.01, "pitch": -0.02} for k in range(40)]
    client.put("cue", json.dumps({"seq": 17, "t": 12.345, "poses": poses}).encode())
    first, second, third = until(lambda: len(cues := running.control.cues()) == 3 and cues)
    assert (first.seq, first.t_client_s, first.client) == (17, 12.345, "anonymous")
    assert (first.part, second.part, third.part) == (0, 1, 2)
    assert first.poses[1] == (0.01, (0.01, -0.02, 0.03))
    assert before_s <= first.received_s <= time.monotonic()


BAD_CUES = {
    "no JSON": b"\xff\xfe roll=1",
    "nothing": b"",
    "a list": b"[]",
    "NaN": b'{"seq":1,"t":0,"poses":[{"dt":0,"yaw":0,"pitch":0,"roll":NaN}]}',
    "infinite": b'{"seq":1,"t":0,"poses":[{"dt":0,"yaw":0,"pitch":0,"roll":1e999}]}',
    "text for a number": b'{"seq":1,"t":0,"poses":[{"dt":0,"yaw":0,"pitch":0,"roll":"0.1"}]}',
    "negative seq": b'{"seq":-1,"t":0,"poses":[{"dt":0,"yaw":0,"pitch":0,"roll":0}]}',
    "unknown key": b'{"seq":1,"t":0,"poses":[{"dt":0,"yaw":0,"pitch":0,"roll":0}],"arm":true}',
    "foreign coordinate": b'{"seq":1,"t":0,"poses":[{"dt":0,"yaw":0,"pitch":0,"heave":0}]}',
    "missing coordinate": b'{"seq":1,"t":0,"poses":[{"dt":0,"yaw":0,"pitch":0}]}',
    "no poses": b'{"seq":1,"t":0,"poses":[]}',
    "too many poses": json.dumps(
        {
            "seq": 1,
            "t": 0,
            "poses": [{"dt": k, "yaw": 0, "pitch": 0, "roll": 0} for k in range(300)],
        }
    ).encode(),
    "time that runs back": b'{"seq":1,"t":0,"poses":[{"dt":1,"yaw":0,"pitch":0,"roll":0},'
    b'{"dt":0,"yaw":0,"pitch":0,"roll":0}]}',
    "a megabyte": b'{"seq":1,"t":0,"poses":[' + b"{}," * 350_000 + b"{}]}",
    "deep nesting": b"[" * 60_000,
}


@pytest.mark.parametrize("payload", BAD_CUES.values(), ids=BAD_CUES.keys())
def test_a_bad_cue_is_refused_told_and_does_not_disturb_the_next(running, client, payload):
    events = client.subscribe("event")
    client.put("cue", payload, attachment="simulator-7")
    refusal = until(lambda: [event for event in events if event["name"] == "cue_refused"])[0]
    assert refusal["severity"] == "warning"
    assert "simulator-7" in refusal["text"]
    assert "cue" in refusal["text"]
    client.cue(seq=2)
    assert until(running.control.cues)[0].seq == 2


def test_a_client_that_keeps_sending_rubbish_is_told_of_once_a_second(running, client):
    events = client.subscribe("event")
    start_s = time.monotonic()
    for _ in range(150):
        client.put("cue", b"rubbish")
    client.cue(seq=5)
    until(running.control.cues)
    until(lambda: "cue_refused" in names(events))
    assert names(events).count("cue_refused") <= 1 + time.monotonic() - start_s


def test_a_flood_of_cues_is_bounded_before_it_reaches_control(running, client):
    events = client.subscribe("event")
    start_s = time.monotonic()
    for seq in range(3000):
        client.cue(seq=seq)
    until(lambda: "cue_refused" in names(events))
    took_s = time.monotonic() - start_s
    assert len(running.control.cues()) <= 201 + 1000 * took_s


def test_two_clients_are_told_apart_by_name_and_session(running):
    with plain(running.endpoint) as one, plain(running.endpoint) as two:
        import zenoh

        publishers = [each.session.declare_publisher("hil/motorcycle/cue") for each in (one, two)]
        for seq, publisher in enumerate(publishers):
            payload = {"seq": seq, "t": 0, "poses": [{"dt": 0, "yaw": 0, "pitch": 0, "roll": 0}]}
            publisher.put(
                json.dumps(payload),
                attachment="same-name",
                source_info=zenoh.SourceInfo(publisher.id, seq),
            )
        first, second = until(lambda: len(cues := running.control.cues()) == 2 and cues)
    assert first.client != second.client
    assert first.client.startswith("same-name@")


def test_state_is_published_at_the_rate_of_the_rig_file(tmp_path):
    with gateway(tmp_path, QUIET, state_hz=50.0) as running, plain(running.endpoint) as client:
        states = client.subscribe("state")
        for k in range(101):
            running.control.state(t_s=100.0 + 0.01 * k)
            time.sleep(0.003)  # Zenoh drops states where a burst of them fills its queue
        until(lambda: states and states[-1]["t"] == 101.0)
    assert [state["t"] for state in states] == pytest.approx([100 + 0.02 * k for k in range(51)])


def test_a_state_says_by_name_what_is_known_and_leaves_out_the_rest(running, client):
    states = client.subscribe("state")
    running.control.state("engaged", t_s=3.0, slots=10, pairs=9, fault="none really")
    state = until(lambda: states)[0]
    assert state["state"] == "engaged"
    assert state["pose"] == {"yaw": 0.0, "pitch": 0.01, "roll": 0.02}
    assert state["actuators"]["leg2"] == {
        "position": 0.6, "velocity": 0.0, "force": 100.0, "age_s": 0.01,
    }  # fmt: skip
    assert (state["slot_use"], state["fault"], state["bus_load"]) == (0.9, "none really", 0.0)


def test_each_drives_answers_are_published_under_its_name(running, client):
    answers = client.subscribe("drive/leg2")
    others = client.subscribe("drive/leg1")
    running.control.channel.send(SampleRecord(1, "force", 250.0, 7.0, 7.001))
    assert until(lambda: answers) == [{"t": 7.001, "sampled": 7.0, "force": 250.0}]
    assert others == []


def test_a_drives_status_is_published_when_it_changes(running, client):
    seen = client.subscribe("drive/slide/status")
    running.control.channel.send(DriveRecord(8.0, 2, "fault", False, "over-current"))
    assert until(lambda: seen) == [
        {"t": 8.0, "phase": "fault", "enabled": False, "error": "over-current"}
    ]


def test_every_payload_keeps_the_schema_that_is_published_for_it(running, client):
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema checks published payloads")
    kinds = {
        "state": "state",
        "event": "event",
        "drive/*": "drive",
        "drive/*/status": "drive_status",
        "command/arm": "command_reply",
    }
    schemas = {key.rpartition("/")[2]: schema for key, schema in client.get("schema/*")}
    seen = {kind: client.subscribe(tail) for tail, kind in kinds.items() if "command" not in tail}
    running.control.state("fault", fault="leg1 is silent")
    running.control.channel.send(
        SampleRecord(1, "force", 250.0, 7.0, 7.001),
        DriveRecord(8.0, 2, "fault", False, "over-current"),
        EventRecord(1.0, "fault", "silent", "leg1"),
    )
    seen["command_reply"] = [reply for _, reply in client.get("command/arm")]
    for kind, payloads in seen.items():
        until(lambda payloads=payloads: payloads)
        for payload in payloads:
            jsonschema.Draft202012Validator(schemas[kind]).validate(payload)


def test_schemas_can_be_asked_for_one_by_one_and_all_at_once(running, client):
    found = client.get("schema/**")
    assert {key.rpartition("/")[2] for key, _ in found} == set(messages.PAYLOADS)
    ((key, schema),) = client.get("schema/cue")
    assert key == "hil/motorcycle/schema/cue"
    assert set(schema["properties"]["poses"]["items"]["required"]) == {"dt", "yaw", "pitch", "roll"}


def test_a_command_goes_to_control_and_its_answer_comes_back(running, client):
    assert client.get("command/arm") == [
        ("hil/motorcycle/command/arm", {"ok": True, "message": "arm"})
    ]
    payload = b'{"client": "desk", "arguments": {"value": 0.5}}'
    assert client.get("command/gain", payload)[0][1] == {"ok": True, "message": "gain 0.5"}
    assert [command.name for command in running.control.commands()] == ["arm", "gain"]


def test_what_control_refuses_is_told_to_the_client(running, client):
    running.control.answer = lambda command: ReplyRecord(
        command.command_id, False, "leg2 does not answer; is its enable on?"
    )
    assert client.get("command/arm")[0][1] == {
        "ok": False,
        "message": "leg2 does not answer; is its enable on?",
    }


@pytest.mark.parametrize(
    ("name", "payload", "text"),
    [
        ("fly", None, "no command 'fly'"),
        ("arm", b"\x00", "command request"),
        ("arm", b'{"arguments": {"force": true}}', "arm takes no argument"),
        ("arm", b'{"sudo": true}', "sudo"),
        ("gain", None, "gain needs 'value'"),
        ("gain", b'{"arguments": {"value": "much"}}', "a float"),
        ("record", b'{"arguments": {"on": 3}}', "a bool"),
        ("stop", b"x" * 100_000, "at most 65536"),
    ],
)
def test_a_command_that_makes_no_sense_is_refused_before_it_reaches_control(
    running, client, name, payload, text
):
    ((_, reply),) = client.get(f"command/{name}", payload)
    assert not reply["ok"]
    assert text in reply["message"]
    assert running.control.commands() == []


def test_nobody_gives_all_commands_at_once(running, client):
    ((key, text),) = client.get("command/*")
    assert key == "error"
    assert "without wildcards" in text
    assert running.control.commands() == []


def test_a_control_process_that_does_not_answer_is_a_refusal_in_time(running, client):
    running.control.answer = lambda command: None
    states = client.subscribe("state")
    running.control.state()
    until(lambda: states)
    start_s = time.monotonic()
    ((_, reply),) = client.get("command/park")
    assert reply == {"ok": False, "message": "the control process did not answer within 0.2 s"}
    assert time.monotonic() - start_s < 1.0


def test_a_control_process_that_still_starts_is_not_said_to_hang(running, client):
    running.control.answer = lambda command: None  # it compiles, and has told no state yet
    ((_, reply),) = client.get("command/arm")
    assert reply == {
        "ok": False,
        "message": "the control process still starts and did not answer within 0.2 s: "
        "give it once more later",
    }


def test_commands_of_several_clients_get_each_their_own_answer(running):
    held = []
    running.control.answer = lambda command: held.append(command)
    with plain(running.endpoint) as one, plain(running.endpoint) as two:
        asked = [
            each.session.get(f"hil/motorcycle/command/{name}", timeout=2.0)
            for each, name in ((one, "park"), (two, "stop"))
        ]
        until(lambda: len(held) == 2)
        for command in reversed(held):
            running.control.channel.send(ReplyRecord(command.command_id, True, command.name))
        texts = [json.loads(next(iter(replies)).ok.payload.to_bytes()) for replies in asked]
    assert [text["message"] for text in texts] == ["park", "stop"]


def test_the_rig_and_its_clients_show_that_they_live(running, client):
    alive = [reply.ok for reply in client.session.liveliness().get("hil/motorcycle/alive")]
    assert len(alive) == 1
    events = client.subscribe("event")
    token = client.session.liveliness().declare_token("hil/motorcycle/client/desk")
    until(lambda: "client_here" in names(events))
    token.undeclare()
    until(lambda: "client_gone" in names(events))


def test_events_of_control_are_passed_on(running, client):
    events = client.subscribe("event")
    running.control.channel.send(EventRecord(9.0, "fault", "drive_error", "leg1: error 5"))
    assert until(lambda: events)[0] == {
        "t": 9.0, "severity": "fault", "name": "drive_error", "text": "leg1: error 5",
    }  # fmt: skip


def test_a_log_that_nobody_reads_holds_nothing_up_and_what_it_lacks_is_told(tmp_path):
    end, fd = os.pipe()
    with gateway(tmp_path, QUIET, fd) as running, plain(running.endpoint) as client:
        events = client.subscribe("event")
        for k in range(2000):
            record = EventRecord(float(k), "info", "word", "x" * 100)
            until(lambda record=record: running.control.channel.send(record) == 0)
            time.sleep(0.001)  # Zenoh drops events where a burst of them fills its queue
        until(lambda: "log_stalled" in names(events))
        assert client.get("command/arm")[0][1]["ok"]
        logged = b""
        while b"log_back" not in logged:
            logged += os.read(end, 65536)
        (back,) = until(lambda: [event for event in events if event["name"] == "log_back"])
    lost = int(back["text"].split(": ")[1].split()[0])
    assert lost == pytest.approx(2000 - logged.count(b"name=word"), abs=5)
    assert names(events).count("log_stalled") == 1
    os.close(end)
    os.close(fd)


def test_a_client_that_keeps_asking_is_answered_each_time_and_told_of_once_a_second(
    running, client
):
    events = client.subscribe("event")
    start_s = time.monotonic()
    replies = [client.get("command/dance")[0][1] for _ in range(50)]
    replies += [client.get("command/arm")[0][1] for _ in range(50)]
    assert [reply["ok"] for reply in replies] == [False] * 50 + [True] * 50
    until(lambda: "command_done" in names(events))
    for name in ("command_refused", "command_done"):
        assert 1 <= names(events).count(name) <= 1 + time.monotonic() - start_s


def test_what_a_client_writes_into_an_event_is_cut_short(running, client):
    events = client.subscribe("event")
    assert not client.get(f"command/{'dance' * 10_000}")[0][1]["ok"]
    (told,) = until(lambda: [event for event in events if event["name"] == "command_refused"])
    assert len(told["text"]) == 500


def test_the_gateway_beats_for_control(running):
    def beats():
        return [r for r in running.control.heard if isinstance(r, GatewayAlive)]

    until(lambda: len(beats()) >= 3)
    assert 0.05 < beats()[2].t_s - beats()[1].t_s < 0.5
    assert not beats()[0].is_recording


@pytest.mark.parametrize(("state", "code"), [("parked", 0), ("engaged", 1)])
def test_when_control_dies_clients_are_told_and_the_gateway_leaves(tmp_path, state, code):
    with gateway(tmp_path, QUIET) as running, plain(running.endpoint) as client:
        states, events = client.subscribe("state"), client.subscribe("event")
        running.control.state(state)
        until(lambda: states)
        running.control.die()
        assert until(lambda: running.result is not None and [running.result]) == [code]
        until(lambda: "control_gone" in names(events))
    assert (states[-1]["state"], states[-1]["fault"]) == (
        "offline",
        "the control process has ended",
    )
    assert events[-1]["severity"] == ("fault" if code else "info")


def test_the_last_words_of_control_are_passed_on_and_recorded(tmp_path):
    """More than one reading of the socket holds, sent right before control dies."""
    with gateway(tmp_path) as running, plain(running.endpoint) as client:
        events = client.subscribe("event")
        for k in range(300):
            running.control.channel.send(EventRecord(time.monotonic(), "info", f"word_{k}", ""))
        running.control.die()
        until(lambda: "control_gone" in names(events))
        until(lambda: running.result is not None)
    assert [name for name in names(events) if name.startswith("word")] == [
        f"word_{k}" for k in range(300)
    ]
    (run,) = (tmp_path / "runs").iterdir()
    kept = [json.loads(line)["name"] for line in (run / "events.jsonl").read_text().splitlines()]
    assert kept[-2:] == ["word_299", "control_gone"]
    assert "ended" in (run / "run.toml").read_text()


def test_a_control_process_that_hangs_is_reported_once_and_when_it_is_back(running, client):
    events = client.subscribe("event")
    running.control.state("parked")
    until(lambda: "control_silent" in names(events))
    running.control.state("parked")
    until(lambda: "control_back" in names(events))
    assert names(events).count("control_silent") == 1


def test_rubbish_from_control_is_counted_and_survived(running, client):
    events = client.subscribe("event")
    running.control.channel.send(SampleRecord(77, "force", 0.0, 0.0, 0.0))
    until(lambda: "records_malformed" in names(events))
    running.control.channel.send(SetpointRecord(0.0, 9, "position", 0.0))
    assert client.get("command/arm")[0][1]["ok"]


def test_a_second_daemon_at_the_same_endpoint_is_refused(running, tmp_path):
    second = RunningGateway(rig_at(running.port, tmp_path), QUIET)
    try:
        error = until(lambda: second.result)
    finally:
        second.close()
    assert isinstance(error, RigInUse)
    assert f"tcp/127.0.0.1:{running.port} is taken" in str(error)


def test_an_endpoint_that_makes_no_sense_is_named(tmp_path):
    rig = rig_at(free_port(), tmp_path)
    bad = rig.zenoh.model_copy(update={"listen": ("carrier-pigeon/127.0.0.1:1",)})
    second = RunningGateway(rig.model_copy(update={"zenoh": bad}), QUIET)
    try:
        error = until(lambda: second.result)
    finally:
        second.close()
    assert isinstance(error, ConfigError)
    assert "carrier-pigeon" in str(error)


def test_what_happens_is_recorded_and_the_command_record_switches_it(tmp_path):
    with gateway(tmp_path) as running, plain(running.endpoint) as client:
        running.control.state("engaged", t_s=time.monotonic())
        running.control.channel.send(
            FrameRecord(time.monotonic(), True, Frame(0x0DD, b"\x01")),
            SetpointRecord(time.monotonic(), 0, "position", 0.61),
            SampleRecord(0, "position", 0.6, time.monotonic(), time.monotonic()),
        )
        client.cue(seq=3)
        until(running.control.cues)
        off = client.get("command/record", b'{"arguments": {"on": false}}')[0][1]
        again = client.get("command/record")[0][1]
        assert off["ok"]
        assert again["ok"]
    first, second = sorted((tmp_path / "runs").iterdir())
    assert str(second) in again["message"]
    assert again["folder"] == str(second)
    assert (first / "run.toml").is_file()
    topics = topics_of(first / "recording.mcap")
    assert topics >= {"/state", "/setpoint", "/drive/leg1", "/cue", "/event"}
    assert "0DD#01" in (first / "can.log").read_text()


def topics_of(path):
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        return {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}


def test_a_folder_that_cannot_be_written_stops_the_recording_and_not_the_rig(tmp_path):
    (tmp_path / "runs").write_text("a file where the folder should be")
    with gateway(tmp_path) as running, plain(running.endpoint) as client:
        ((_, reply),) = client.get("command/record")
        assert not reply["ok"]
        assert client.get("command/arm")[0][1]["ok"]


def test_a_recording_for_which_there_is_no_room_is_refused(tmp_path, monkeypatch):
    with gateway(tmp_path, QUIET) as running, plain(running.endpoint) as client:
        full = shutil.disk_usage(tmp_path)._replace(free=3 << 20)
        monkeypatch.setattr("shutil.disk_usage", lambda path: full)
        ((_, reply),) = client.get("command/record")
    assert not reply["ok"]
    assert "only 3 MiB are free, 64 stay reserved" in reply["message"]
    assert list((tmp_path / "runs").iterdir()) == []


def test_metrics_are_served_on_loopback(tmp_path):
    import urllib.request

    port = free_port()
    options = GatewayOptions(is_recording=False, metrics_port=port)
    with gateway(tmp_path, options) as running, plain(running.endpoint) as client:
        running.control.state("engaged", overruns=3)
        client.cue()
        until(running.control.cues)
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
            text = answer.read().decode()
    assert 'hil_state{hil_state="engaged",rig="motorcycle"} 1.0' in text
    assert 'hil_overruns{rig="motorcycle"} 3.0' in text
    assert 'hil_cues_total{outcome="accepted",rig="motorcycle"} 1.0' in text


def test_the_state_message_can_be_read_back(running, client):
    states = client.subscribe("state")
    running.control.state()
    until(lambda: states)
    assert msgspec.convert(states[0], messages.StateMessage).pose["roll"] == 0.02
