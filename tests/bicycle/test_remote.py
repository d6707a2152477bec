"""A client far from the bicycle starts and stops its recording over Zenoh, as it would a driven rig's."""

import asyncio
import contextlib
import time

import pytest

from hil.bicycle.acquisition import Acquisition, acquire
from hil.bicycle.remote import RemoteControl
from hil.bus.hub import Hub
from hil.bus.port import open_port
from hil.client import RigClient
from hil.config import BicycleFile
from hil.configfile import load_bicycle
from hil.drives.bicycle_nodes import encode_lean, encode_steer, encode_wheel
from hil.runs import load_run
from tests.daemon.gateway_rig import free_port


@pytest.fixture
def bicycle():
    tables = load_bicycle("bicycle").model_dump()
    tables["zenoh"]["listen"] = (f"tcp/127.0.0.1:{free_port()}",)
    return BicycleFile.model_validate(tables)


async def ask(client, name, **arguments):
    return await asyncio.to_thread(client.command, name, **arguments)


def test_record_on_and_off_make_a_run_of_what_the_nodes_said_between(bicycle, tmp_path):
    path = tmp_path / "bus.sock"

    async def session():
        told = []
        async with contextlib.AsyncExitStack() as stack:
            await stack.enter_async_context(Hub(path, 500_000))
            port, nodes = (open_port(f"hub:{path}", bitrate_bps=500_000) for _ in range(2))
            stack.callback(port.close)
            stack.callback(nodes.close)
            acquisition = Acquisition(bicycle, tmp_path / "runs", told.append, live=False)
            control = RemoteControl(bicycle, acquisition, time.monotonic)
            stack.callback(control.close)
            control.open()
            listening = asyncio.create_task(
                acquire(acquisition, port, time.monotonic, None, wait=True)
            )
            client = RigClient(bicycle.name, bicycle.zenoh.listen[0], name="far")
            await asyncio.to_thread(client.open)
            stack.callback(client.close)
            replies = [await ask(client, "record", on=False)]
            replies.append(await ask(client, "record", on=True))
            replies.append(await ask(client, "record", on=True))
            base = bicycle.sensors.base_id
            for k in range(20):
                for frame in (
                    encode_lean(base, 0.01, k, saturated=False),
                    encode_wheel(base, 0.1 * k, 2400, k),
                    encode_steer(base, 0.02, 2400, k),
                ):
                    nodes.send(frame)
                await asyncio.sleep(0.01)
            replies.append(await ask(client, "record", on=False))
            replies.append(await ask(client, "arm"))
            replies.append(await ask(client, "dance"))
            listening.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await listening
            return replies, acquisition.paths

    replies, paths = asyncio.run(session())
    assert [r.ok for r in replies] == [False, True, False, True, False, False]
    assert "nothing is being recorded" in replies[0].message
    assert "records already" in replies[2].message
    assert "ridden, not driven" in replies[4].message
    assert "no command 'dance'" in replies[5].message
    (run,) = paths
    recorded = load_run(run, bicycle)
    assert recorded.table["lean"].notna().sum() == 20
    assert "far" in recorded.meta.note
