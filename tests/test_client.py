"""A rig client of a few lines: cues, states, events and commands against a real gateway."""

from __future__ import annotations

import asyncio
import runpy
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import pytest

from hil.client import Feed, RigClient
from hil.daemon.gateway.gateway import GatewayOptions
from hil.daemon.records import EventRecord, ReplyRecord
from hil.errors import ConfigError, ProtocolError, RigNotReached
from hil.messages import CueMessage, decode
from tests.daemon.gateway_rig import gateway, until

QUIET = GatewayOptions(is_recording=False)
EXAMPLE = Path(__file__).parents[1] / "examples" / "plain_zenoh_client.py"


@pytest.fixture
def running(tmp_path):
    with gateway(tmp_path, QUIET) as one:
        yield one


@pytest.fixture
def rig(running):
    with RigClient("motorcycle", running.endpoint, name="sim") as client:
        yield client


def test_the_client_learns_the_rigs_coordinates(rig):
    assert rig.coordinates == ("yaw", "pitch", "roll")


def test_a_cue_names_what_moves_and_leaves_the_rest_neutral(running, rig):
    assert rig.cue(roll=0.05) == 1
    assert rig.cues([{"dt": 0.0, "yaw": 0.01}, {"dt": 0.02, "pitch": 0.02}], t_s=7.5) == 2
    first, second = until(lambda: len(cues := running.control.cues()) == 2 and cues)
    assert first.poses == ((0.0, (0.0, 0.0, 0.05)),)
    assert (second.t_client_s, second.poses[1]) == (7.5, (0.02, (0.0, 0.02, 0.0)))
    assert first.client == second.client
    assert first.client.startswith("sim@")


def test_a_coordinate_that_the_rig_has_not_is_refused_before_it_is_sent(rig):
    with pytest.raises(ProtocolError, match="no coordinate heave; it has yaw, pitch, roll"):
        rig.cue(heave=0.1)


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_number_that_is_none_is_refused_before_it_is_sent(rig, number):
    with pytest.raises(ProtocolError, match=f"roll = {number}: a cue holds finite numbers only"):
        rig.cue(roll=number)
    with pytest.raises(ProtocolError, match=f"dt = {number}"):
        rig.cues([{"dt": number}])
    assert rig.cue(roll=0.01) == 1


def test_cues_of_several_threads_are_numbered_in_the_order_in_which_they_leave(rig, monkeypatch):
    class Wire:
        id = rig._cue.id
        sent: ClassVar = []

        def put(self, payload, **_):
            time.sleep(1e-4)
            self.sent.append(decode(payload, CueMessage))

    monkeypatch.setattr(rig, "_cue", Wire())
    with ThreadPoolExecutor(4) as pool:
        numbers = list(pool.map(lambda _: rig.cue(roll=0.01), range(40)))
    assert sorted(numbers) == [cue.seq for cue in Wire.sent] == list(range(1, 41))
    assert all(a.t <= b.t for a, b in pairwise(Wire.sent))


@pytest.mark.parametrize("content", [None, "{ mode: ", "{ nonsense: 1 }"])
def test_a_zenoh_file_that_is_none_is_named(tmp_path, content):
    path = tmp_path / "zenoh.json5"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ConfigError, match=r"zenoh.json5: cannot be read as a Zenoh file"):
        RigClient("motorcycle", config=path).open()


def test_states_arrive_one_by_one_and_the_last_one_is_at_hand(running, rig):
    assert rig.state() is None
    states = rig.states()
    for t_s in (1.0, 2.0, 3.0):
        running.control.state(t_s=t_s)
        assert next(states).t == t_s
        assert rig.state().t == t_s
    assert rig.state().actuators["slide"].position == 0.6


def test_a_rig_that_falls_silent_is_an_error_and_not_a_hang(rig):
    with pytest.raises(RigNotReached, match="states of motorcycle: nothing came"):
        next(rig.states(timeout_s=0.05))


def test_events_arrive(running, rig):
    events = rig.events(timeout_s=2.0)
    running.control.channel.send(EventRecord(1.0, "fault", "drive_error", "leg1: error 5"))
    assert next(event for event in events if event.name == "drive_error").text == "leg1: error 5"


def test_commands_are_answered(running, rig):
    assert rig.command("arm").ok
    assert rig.command("gain", value=0.5).message == "gain 0.5"
    running.control.answer = lambda command: ReplyRecord(command.command_id, False, "in motion")
    reply = rig.command("disarm")
    assert (reply.ok, reply.message) == (False, "in motion")
    assert "there is no command 'fly'" in rig.command("fly").message


def test_a_finish_is_of_the_session_whose_cues_they_were(running):
    """Two of one name: the one that is done may not park the other's ride."""
    one, two = (RigClient(running.rig.name, running.endpoint, name="same") for _ in range(2))
    with one, two:
        one.cue()
        two.command("finish")
        one.command("finish")
    (cue,) = until(running.control.cues)
    theirs, own = until(lambda: len(c := running.control.commands()) == 2 and c)
    assert (own.argument, theirs.argument.partition("@")[0]) == (cue.client, "same")
    assert theirs.argument != own.argument


@pytest.mark.parametrize("name", ["", "arm/*", "**", "a b", "ümlaut", "arm?x=1"])
def test_names_that_are_no_part_of_a_key_are_refused_at_once(running, rig, name):
    with pytest.raises(ProtocolError, match="is no name"):
        rig.command(name)
    with pytest.raises(ProtocolError, match="is no name"):
        RigClient(name, running.endpoint)


def test_a_rig_is_alive_until_its_daemon_goes(running, rig):
    assert rig.is_alive()
    running.close()
    until(lambda: not rig.is_alive())


def test_nobody_at_the_endpoint_is_said_in_a_sentence():
    client = RigClient("motorcycle", "tcp/127.0.0.1:1", timeout_s=0.2)
    with pytest.raises(RigNotReached, match=r"is `hil run` up.*Timeout!\)$"), client:
        pass


def test_another_rig_at_the_endpoint_is_not_ours(running):
    with (
        pytest.raises(RigNotReached, match="no rig of this name"),
        RigClient("stewart", running.endpoint),
    ):
        pass


def test_a_client_that_is_closed_says_so(running):
    client = RigClient("motorcycle", running.endpoint)
    with client:
        feed = client.states()
    for use in (lambda: client.cue(roll=0.0), lambda: client.command("arm")):
        with pytest.raises(RigNotReached, match="not connected"):
            use()
    assert list(feed) == []
    assert not client.is_alive()


def test_the_same_client_works_in_asyncio(running):
    async def ride() -> list[float]:
        async with RigClient("motorcycle", running.endpoint) as client:
            states = client.states()
            running.control.state(t_s=1.0)
            running.control.state(t_s=2.0)
            found = []
            async for state in states:
                found.append(state.t)
                client.cue(roll=0.01)
                if len(found) == 2:
                    break
            return found

    assert asyncio.run(ride()) == [1.0, 2.0]
    assert len(until(lambda: len(cues := running.control.cues()) == 2 and cues)) == 2


def test_what_waits_in_a_feed_can_be_taken_without_waiting():
    feed: Feed[int] = Feed("numbers", None)
    assert feed.waiting() == []
    feed.put(1)
    feed.put(2)
    assert feed.waiting() == [1, 2]
    assert feed.waiting() == []


def test_a_feed_that_nobody_reads_keeps_the_newest_thousand():
    feed: Feed[int] = Feed("numbers", 0.01)
    for k in range(1500):
        feed.put(k)
    feed.close()
    assert list(feed) == list(range(500, 1500))


def test_the_plain_example_rides_and_imports_nothing_of_hil(running, monkeypatch, capsys):
    assert "import hil" not in EXAMPLE.read_text()
    assert "from hil" not in EXAMPLE.read_text()
    stop = threading.Event()

    def beat():
        while not stop.wait(0.01):
            running.control.state("engaged")

    beating = threading.Thread(target=beat)
    beating.start()
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), running.endpoint, "motorcycle", "0.3"])
    try:
        start_s = time.monotonic()
        runpy.run_path(str(EXAMPLE), run_name="__main__")
        assert time.monotonic() - start_s < 3.0
    finally:
        stop.set()
        beating.join()
    arm, finish = running.control.commands()
    cues = running.control.cues()
    assert (arm.name, finish.name) == ("arm", "finish")
    assert len(cues) > 10
    assert {cue.client.partition("@")[0] for cue in cues} == {finish.argument}
    assert "engaged" in capsys.readouterr().out
