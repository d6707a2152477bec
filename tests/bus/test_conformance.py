"""What every kind of port promises, over every kind of bus that this machine has."""

from __future__ import annotations

import asyncio
import itertools
import os
import random
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import pytest

from hil.bus import BusPort, BusState, open_port
from hil.bus.hub import Hub
from hil.errors import BusBusy, BusError, ProtocolError
from hil.frames import Frame, pack

from .harness import collect, run, send_all, silence

BITRATE_BPS = 1_000_000
VCAN = os.environ.get("HIL_VCAN", "vcan0")
_channels = itertools.count()

Open = Callable[..., BusPort]


class Bench:
    """One bus of some kind; opens ports on it and closes them at the end."""

    def __init__(self, url: str, stack: AsyncExitStack) -> None:
        self.url = url
        self._stack = stack

    def open(self, *, read_only: bool = False) -> BusPort:
        port = open_port(self.url, bitrate_bps=BITRATE_BPS, read_only=read_only)
        self._stack.callback(port.close)
        return port


@asynccontextmanager
async def bench(kind: str, folder: Path) -> AsyncIterator[Bench]:
    async with AsyncExitStack() as stack:
        if kind == "hub":
            path = folder / "bus.sock"
            await stack.enter_async_context(Hub(path, BITRATE_BPS))
            yield Bench(f"hub:{path}", stack)
        elif kind == "python-can":
            yield Bench(f"python-can:virtual:conformance-{next(_channels)}", stack)
        else:
            yield Bench(f"socketcan:{VCAN}", stack)


@pytest.fixture(params=["hub", "python-can", pytest.param("socketcan", marks=pytest.mark.vcan)])
def kind(request: pytest.FixtureRequest) -> str:
    if request.param == "socketcan" and not Path(f"/sys/class/net/{VCAN}").exists():
        pytest.skip(f"needs the SocketCAN interface {VCAN} (or the one that HIL_VCAN names)")
    return str(request.param)


def test_frames_travel_both_ways(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            here.send(Frame(0x295, b"\x0f\x00"))
            assert [item.frame for item in await collect(there, 1)] == [Frame(0x295, b"\x0f\x00")]
            there.send(Frame(0x371, b"\x37\x02"))
            assert [item.frame for item in await collect(here, 1)] == [Frame(0x371, b"\x37\x02")]
            assert here.counters.sent == here.counters.received == 1

    run(scene())


KINDS_OF_FRAME = [
    *(Frame(0x100 + n, bytes(range(0xF0, 0xF0 + n))) for n in range(9)),
    Frame(0x000, b"lowest"),
    Frame(0x7FF, b"highest"),
    Frame(0x000, b"\x01", is_extended=True),
    Frame(0x1FFF_FFFF, b"extended", is_extended=True),
    Frame(0x123, is_remote=True),
    Frame(0x123, bytes(4), is_remote=True),
    Frame(0x12345, bytes(8), is_extended=True, is_remote=True),
]


@pytest.mark.parametrize("frame", KINDS_OF_FRAME, ids=str)
def test_every_classic_frame_arrives_as_it_was_sent(
    kind: str, tmp_path: Path, frame: Frame
) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            here.send(frame)
            assert [item.frame for item in await collect(there, 1)] == [frame]

    run(scene())


def test_frames_of_one_node_keep_their_order(kind: str, tmp_path: Path) -> None:
    rng = random.Random(3)
    frames = [Frame(rng.randrange(0x800), n.to_bytes(4, "little")) for n in range(300)]

    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            sending = asyncio.create_task(send_all(here, frames))
            received = await collect(there, len(frames))
            await sending
            assert [item.frame for item in received] == frames
            stamps = [item.t_s for item in received]
            assert stamps == sorted(stamps)

    run(scene())


def test_stamps_are_on_the_clock_of_the_loop(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            before_s = time.monotonic()
            here.send(Frame(0x123))
            (item,) = await collect(there, 1)
            # The stamp comes by way of the wall clock, whose slewing is some microseconds.
            assert before_s - 1e-3 < item.t_s <= time.monotonic()
            assert item.t_s == pytest.approx(asyncio.get_running_loop().time(), abs=1.0)

    run(scene())


def test_a_stamp_tells_when_the_frame_came_not_when_it_was_read(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            here.send(Frame(0x123))
            await asyncio.sleep(0.3)
            (item,) = there.receive()
            assert time.monotonic() - item.t_s > 0.1

    run(scene())


def test_a_node_does_not_hear_itself(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            here.send(Frame(0x123))
            await collect(there, 1)
            await silence(here)

    run(scene())


def test_all_other_nodes_hear_a_frame(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            sender, *others = (bus.open() for _ in range(5))
            sender.send(Frame(0x123, b"all"))
            for port in others:
                assert [item.frame for item in await collect(port, 1)] == [Frame(0x123, b"all")]

    run(scene())


def test_two_nodes_talk_at_once_and_nothing_is_lost(kind: str, tmp_path: Path) -> None:
    ours = [Frame(0x200, n.to_bytes(2, "little")) for n in range(150)]
    theirs = [Frame(0x100, n.to_bytes(2, "little")) for n in range(150)]

    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            senders = [
                asyncio.create_task(send_all(here, ours)),
                asyncio.create_task(send_all(there, theirs)),
            ]
            at_there, at_here = await asyncio.gather(
                collect(there, len(ours)), collect(here, len(theirs))
            )
            await asyncio.gather(*senders)
            assert [item.frame for item in at_there] == ours
            assert [item.frame for item in at_here] == theirs

    run(scene())


def test_an_empty_port_returns_at_once_with_nothing(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            port = bus.open()
            assert not os.get_blocking(port.fileno())
            assert port.receive() == []
            assert port.state is BusState.ERROR_ACTIVE

    run(scene())


def test_receive_drains_all_that_waits(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            await send_all(here, [Frame(0x123, bytes([n])) for n in range(40)])
            await asyncio.sleep(0.3)
            assert [item.frame.data[0] for item in there.receive()] == list(range(40))
            assert there.receive() == []

    run(scene())


def test_sending_never_blocks_and_a_full_queue_says_so(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            attempts, refused = 3000, 0
            started_s = time.monotonic()
            for n in range(attempts):
                try:
                    here.send(Frame(0x700, n.to_bytes(8, "little")))
                except BusBusy:
                    refused += 1
            assert time.monotonic() - started_s < 2.0
            assert here.counters.refused == refused
            assert here.counters.sent == attempts - refused
            if kind == "hub":  # the others have no bit time by which their queue could fill
                assert refused > 0
            await asyncio.sleep(0.3)
            there.receive()
            await send_all(here, [Frame(0x001, b"after")])
            while Frame(0x001, b"after") not in [item.frame for item in await collect(there, 1)]:
                pass

    run(scene())


def test_a_read_only_port_hears_but_cannot_transmit(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            monitor, sender, witness = bus.open(read_only=True), bus.open(), bus.open()
            with pytest.raises(BusError, match="reading only"):
                monitor.send(Frame(0x295, b"\x0f"))
            with pytest.raises(OSError):  # noqa: PT011 - EPIPE or ENXIO, by the kind of bus
                os.write(monitor.fileno(), pack(Frame(0x295, b"\x0f")))
            await silence(witness)
            assert monitor.counters.refused == 1
            assert monitor.counters.sent == 0
            sender.send(Frame(0x371, b"\x01"))
            assert [item.frame for item in await collect(monitor, 1)] == [Frame(0x371, b"\x01")]

    run(scene())


def test_what_is_no_frame_to_send_is_refused(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there = bus.open(), bus.open()
            for wrong in (
                Frame(0x800),
                Frame(-1),
                Frame(0x2000_0000, is_extended=True),
                Frame(0x123, bytes(9)),
                Frame(0x040, bytes(8), is_error=True),
            ):
                with pytest.raises(ProtocolError):
                    here.send(wrong)
            assert here.counters.refused == 5
            await silence(there)

    run(scene())


def test_closing_twice_is_no_error_and_gives_the_descriptor_back(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            port = bus.open()
            assert port.fileno() >= 0
            port.close()
            port.close()
            assert port.fileno() == -1
            for use in (port.receive, lambda: port.send(Frame(0x123))):
                with pytest.raises(BusError, match=port.name):
                    use()

    run(scene())


def test_a_node_that_leaves_does_not_disturb_the_others(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there, leaver = bus.open(), bus.open(), bus.open()
            leaver.send(Frame(0x7FE))
            leaver.close()
            here.send(Frame(0x123, b"still"))
            received = {item.frame for item in await collect(there, 2)}
            assert received == {Frame(0x7FE), Frame(0x123, b"still")}

    run(scene())


def test_what_was_sent_before_closing_still_goes_out(kind: str, tmp_path: Path) -> None:
    """The last frame of a program that ends may be the one that disables a drive."""

    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            here, there, other = bus.open(), bus.open(), bus.open()
            other.send(Frame(0x001))  # unread by the one that closes
            frames = [Frame(0x295, bytes([n] * 8)) for n in range(20)]
            for frame in frames:
                here.send(frame)
            here.close()
            received = [item.frame for item in await collect(there, len(frames) + 1)]
            assert [frame for frame in received if frame.can_id == 0x295] == frames

    run(scene())


def test_names_tell_which_bus_it_is(kind: str, tmp_path: Path) -> None:
    async def scene() -> None:
        async with bench(kind, tmp_path) as bus:
            assert bus.open().name == bus.url

    run(scene())
