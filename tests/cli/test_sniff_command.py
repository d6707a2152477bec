"""`hil sniff` on a hub: everything that is said, in words, by a process that cannot speak."""

import asyncio
import json
import threading
import time

import pytest
from typer.testing import CliRunner

from hil.bus.hub import Hub
from hil.bus.port import open_port
from hil.cli.app import app
from hil.cli.sniff import _bitrate_of
from hil.config import RigFile
from hil.configfile import load_rig, parse_settings, rig_toml
from hil.frames import Frame

STATUS = Frame(0x372, bytes.fromhex("3102000000000000"))  # drive 1: ready to switch on
FOREIGN = Frame(0x123, b"\x2a\x00")
DBC = """VERSION ""
NS_ :
BS_:
BU_: NODE
BO_ 291 BATTERY: 2 NODE
 SG_ Volt : 0|16@1+ (0.1,0) [0|100] "V" NODE
"""


@pytest.fixture
def bus(tmp_path):
    """A hub on which a node says STATUS and FOREIGN every 5 ms; gives its URL and what the hub counted."""
    path = tmp_path / "bus.sock"
    done, up, counts = threading.Event(), threading.Event(), {}

    async def serve():
        async with Hub(path, 500_000) as hub:
            port = open_port(f"hub:{path}?node=talker", bitrate_bps=500_000)
            up.set()
            while not done.is_set():
                port.send(STATUS)
                port.send(FOREIGN)
                await asyncio.sleep(0.005)
                counts.update({name: c.received for name, c in hub.clients.items()})
            port.close()

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert up.wait(10.0)
    yield f"hub:{path}", counts
    done.set()
    thread.join()


def sniff(*arguments):
    result = CliRunner().invoke(app, ["sniff", *arguments])
    assert result.exit_code == 0, result.output
    return result.output


def test_frames_are_shown_in_words_with_statistics_at_the_end(bus):
    said = sniff(bus[0], "--rig", "motorcycle", "--seconds", "0.3")
    assert "leg1 status" in said
    assert "ready to switch on" in said
    assert "123#2A00" in said
    assert "no frame of this rig" in said
    assert "bus load" in said


def test_json_gives_a_line_a_frame_and_a_summary(bus):
    lines = [json.loads(line) for line in sniff(bus[0], "--count", "6", "--json").splitlines()]
    assert len(lines) == 7
    assert {line["id"] for line in lines[:-1]} == {STATUS.can_id, FOREIGN.can_id}
    summary = lines[-1]["summary"]
    assert summary["frames"] >= 6
    assert [i["id"] for i in summary["ids"]] == sorted([STATUS.can_id, FOREIGN.can_id])


def test_filters_choose_by_identifier_or_by_name(bus):
    said = sniff(bus[0], "--filter", "123:7ff", "--count", "3", "--json").splitlines()[:-1]
    assert {json.loads(line)["id"] for line in said} == {FOREIGN.can_id}
    named = sniff(bus[0], "--rig", "axis", "--only", "status", "--count", "3", "--json")
    assert {json.loads(line)["id"] for line in named.splitlines()[:-1]} == {STATUS.can_id}


def test_a_dbc_explains_what_the_rig_does_not(bus, tmp_path):
    (tmp_path / "battery.dbc").write_text(DBC)
    said = sniff(bus[0], "--rig", "axis", "--dbc", str(tmp_path / "battery.dbc"), "--count", "4")
    assert "BATTERY" in said
    assert "Volt 4.2" in said


def test_an_extended_message_of_a_dbc_explains_no_standard_frame(bus, tmp_path):
    extended = DBC.replace("BO_ 291 ", f"BO_ {(1 << 31) | 291} ")
    (tmp_path / "battery.dbc").write_text(extended)
    said = sniff(bus[0], "--rig", "axis", "--dbc", str(tmp_path / "battery.dbc"), "--count", "4")
    assert "BATTERY" not in said


def test_a_name_that_nobody_has_is_told_with_those_that_were_heard(bus):
    said = sniff(bus[0], "--rig", "motorcycle", "--only", "leg7", "--seconds", "0.3", "--quiet")
    assert "No frame of leg7 was heard, but leg1, status, unknown." in said


def test_a_rig_of_several_buses_says_which_is_listened_to(bus, tmp_path):
    rig = tmp_path / "two.toml"
    tables = load_rig("stewart_canopen").model_dump()
    tables["can"]["url"], other = bus[0], tables["can"]["further"][0]
    other["url"], other["bitrate"] = "hub:/run/second.sock", 250_000
    rig.write_text(rig_toml(parse_settings(tables, RigFile, "two"), "two"))
    said = sniff(str(rig), "--count", "1", "--quiet").replace("\n", "")
    assert f"Listening to {bus[0]} alone" in said
    assert "hub:/run/second.sock as well" in said
    assert _bitrate_of("hub:/run/second.sock", load_rig(str(rig))) == 250_000


def test_it_has_said_nothing_and_could_not(bus):
    url, counts = bus
    sniff(url, "--seconds", "0.2", "--quiet")
    time.sleep(0.05)
    others = {name: n for name, n in counts.items() if name != "talker"}
    assert not any(others.values())


def test_a_dbc_that_is_none_is_refused(tmp_path):
    wrong = tmp_path / "wrong.dbc"
    wrong.write_text("hello")
    result = CliRunner().invoke(app, ["sniff", "hub:/nowhere.sock", "--dbc", str(wrong)])
    assert "cannot be read as a DBC file" in str(result.exception)
