from __future__ import annotations

import asyncio
import time
from typing import Any

import can
import pytest

from hil.bus import BusPort, open_port
from hil.bus.pythoncan import PythonCanPort
from hil.errors import BusBusy, BusError
from hil.frames import Frame

from .harness import collect, run


def open_virtual(channel: str) -> BusPort:
    return open_port(f"python-can:virtual:{channel}", bitrate_bps=500_000)


class Broken(can.BusABC):
    """An adapter that works until it is told to fail, and then as the real ones do."""

    def __init__(self, fails: str) -> None:
        super().__init__(channel="broken")
        self.fails = fails

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.fails == "receive":
            raise can.CanOperationError("cable pulled")
        time.sleep(timeout or 0.0)
        return None, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.fails == "send":
            raise can.CanTimeoutError("transmit buffer full")
        time.sleep(timeout or 0.0)


def test_can_fd_frames_are_counted_as_malformed() -> None:
    async def scene() -> None:
        port = open_virtual("fd")
        with can.Bus(interface="virtual", channel="fd", protocol=can.CanProtocol.CAN_FD) as other:
            other.send(can.Message(arbitration_id=0x100, data=bytes(12), is_fd=True))
            other.send(can.Message(arbitration_id=0x101, data=b"\x01", is_extended_id=False))
            assert [item.frame for item in await collect(port, 1)] == [Frame(0x101, b"\x01")]
        assert port.counters.malformed == 1
        port.close()

    run(scene())


def test_an_adapters_error_frames_are_handed_on() -> None:
    async def scene() -> None:
        port = open_virtual("errors")
        with can.Bus(interface="virtual", channel="errors") as other:
            other.send(can.Message(arbitration_id=0x040, data=bytes(8), is_error_frame=True))
            (item,) = await collect(port, 1)
        assert item.frame.is_error
        assert port.state.value == "bus off"
        port.close()

    run(scene())


@pytest.mark.parametrize(
    ("fails", "reason"), [("receive", "cable pulled"), ("send", "transmit buffer full")]
)
def test_an_adapter_that_fails_ends_the_port_with_its_reason(fails: str, reason: str) -> None:
    async def scene() -> None:
        port = PythonCanPort("python-can:broken:", Broken(fails), read_only=False)
        if fails == "send":
            port.send(Frame(0x100))
        with pytest.raises(BusError, match=reason):
            await collect(port, 1)
        with pytest.raises(BusError, match=reason):
            port.send(Frame(0x100))
        port.close()

    run(scene())


def test_an_adapter_that_takes_no_frames_makes_the_port_busy_not_slow() -> None:
    port = PythonCanPort("python-can:slow:", Broken("never"), read_only=False)
    started_s = time.monotonic()

    def fill() -> None:
        for _ in range(1000):
            port.send(Frame(0x100))

    with pytest.raises(BusBusy):
        fill()
    assert time.monotonic() - started_s < 0.5
    port.close()
    assert time.monotonic() - started_s < 4.0


def test_a_port_that_is_not_read_can_still_be_closed() -> None:
    port = open_virtual("unread")
    with can.Bus(interface="virtual", channel="unread") as other:
        for _ in range(2000):  # more than the socket pair holds: the reader thread waits in it
            other.send(can.Message(arbitration_id=0x100, data=bytes(8), is_extended_id=False))
        time.sleep(0.2)
        started_s = time.monotonic()
        port.close()
        assert time.monotonic() - started_s < 2.0


@pytest.mark.parametrize("url", ["python-can:no-such-adapter:0", "python-can:slcan:/dev/none"])
def test_an_interface_that_cannot_be_opened_is_named(url: str) -> None:
    with pytest.raises(BusError, match=url) as refusal:
        open_port(url, bitrate_bps=500_000)
    assert "driver" in str(refusal.value)


def test_a_channel_may_hold_colons() -> None:
    async def scene() -> None:
        a, b = open_virtual("tcp://host:1"), open_virtual("tcp://host:1")
        a.send(Frame(0x100))
        await collect(b, 1)
        a.close()
        b.close()
        await asyncio.sleep(0)

    run(scene())


def test_the_bit_rate_goes_to_the_adapter(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    def bus(**options: Any) -> can.BusABC:
        asked.update(options)
        return Broken("never")

    monkeypatch.setattr(can, "Bus", bus)
    open_port("python-can:slcan:ttyUSB0", bitrate_bps=250_000).close()
    assert asked == {"interface": "slcan", "channel": "ttyUSB0", "bitrate": 250_000}
