"""What the bus tests share: running a loop to a clean end, and waiting for frames on a port."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from hil.bus import BusPort
from hil.errors import BusBusy
from hil.frames import Frame, StampedFrame

T = TypeVar("T")


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` and insist that it has ended all the tasks that it began."""

    async def whole() -> T:
        result = await main
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left, f"tasks left pending: {left}"
        return result

    return asyncio.run(whole())


async def collect(port: BusPort, count: int, timeout_s: float = 5.0) -> list[StampedFrame]:
    """The next `count` frames of `port`, read when its descriptor says so."""
    loop = asyncio.get_running_loop()
    frames: list[StampedFrame] = []
    done: asyncio.Future[None] = loop.create_future()

    def readable() -> None:
        try:
            frames.extend(port.receive())
        except Exception as error:  # noqa: BLE001 - the test shall see it, not the loop
            loop.remove_reader(port)
            if not done.done():
                done.set_exception(error)
            return
        if len(frames) >= count and not done.done():
            done.set_result(None)

    loop.add_reader(port, readable)
    try:
        await asyncio.wait_for(done, timeout_s)
    except TimeoutError:
        raise AssertionError(f"{len(frames)} of {count} frames came: {frames}") from None
    finally:
        loop.remove_reader(port)
    return frames


async def silence(port: BusPort, for_s: float = 0.1) -> None:
    """Insist that nothing reaches `port`."""
    await asyncio.sleep(for_s)
    assert port.receive() == []


async def send_all(port: BusPort, frames: list[Frame]) -> None:
    """Send at the pace of the bus."""
    for frame in frames:
        while True:
            try:
                port.send(frame)
                break
            except BusBusy:
                await asyncio.sleep(0.001)
