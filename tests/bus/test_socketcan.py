from __future__ import annotations

import errno
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.bus import BusState, open_port
from hil.bus.socketcan import IdFilter, open_socketcan, parse_filters
from hil.errors import BusError
from hil.frames import Frame, pack

from .harness import collect, run, silence

VCAN = os.environ.get("HIL_VCAN", "vcan0")


def can_sockets() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


@pytest.fixture
def wire() -> Iterator[socket.socket]:
    """A bare socket on the interface, for what a port would not send."""
    if not Path(f"/sys/class/net/{VCAN}").exists():
        pytest.skip(f"needs the SocketCAN interface {VCAN} (or the one that HIL_VCAN names)")
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sock:
        sock.bind((VCAN,))
        yield sock


@pytest.mark.skipif(can_sockets(), reason="this kernel has CAN sockets")
def test_a_kernel_without_can_sockets_is_told_from_a_missing_interface() -> None:
    with pytest.raises(BusError, match="this kernel has no CAN sockets") as refusal:
        open_port("socketcan:can0", bitrate_bps=500_000)
    assert "modprobe" in str(refusal.value)
    assert "hub:" in str(refusal.value)
    assert isinstance(refusal.value.__cause__, OSError)
    assert refusal.value.__cause__.errno == errno.EAFNOSUPPORT


@pytest.mark.vcan
def test_a_missing_interface_is_named(wire: socket.socket) -> None:
    with pytest.raises(BusError, match="no interface nocan9"):
        open_socketcan("nocan9")


@pytest.mark.vcan
def test_what_is_no_can_interface_is_refused(wire: socket.socket) -> None:
    with pytest.raises(BusError, match="socketcan:lo"):
        open_socketcan("lo")


@pytest.mark.vcan
def test_a_filter_lets_its_identifiers_pass_and_no_others(wire: socket.socket) -> None:
    async def scene() -> None:
        port = open_port(f"socketcan:{VCAN}?filter=371:7ff,520:7f0", bitrate_bps=500_000)
        wanted = [Frame(0x371), Frame(0x529)]
        for frame in (
            Frame(0x370),
            wanted[0],
            Frame(0x371, is_extended=True),
            Frame(0x371, is_remote=True),
            wanted[1],
            Frame(0x530),
        ):
            wire.send(pack(frame))
        assert [item.frame for item in await collect(port, 2)] == wanted
        await silence(port)
        port.close()

    run(scene())


@pytest.mark.vcan
@pytest.mark.parametrize("read_only", [False, True])
def test_error_frames_come_through_and_name_the_state(wire: socket.socket, read_only: bool) -> None:
    async def scene() -> None:
        port = open_socketcan(VCAN, read_only=read_only, filters=(IdFilter(0x371),))
        passive = Frame(0x004, bytes([0, 0x20, 0, 0, 0, 0, 0, 0]), is_error=True)
        for frame, state in (
            (passive, BusState.ERROR_PASSIVE),
            (Frame(0x040, bytes(8), is_error=True), BusState.BUS_OFF),
            (Frame(0x100, bytes(8), is_error=True), BusState.ERROR_ACTIVE),
        ):
            wire.send(pack(frame))
            assert [item.frame for item in await collect(port, 1)] == [frame]
            assert port.state is state
        port.close()

    run(scene())


@pytest.mark.vcan
def test_stamps_are_the_kernels(wire: socket.socket) -> None:
    port = open_socketcan(VCAN)
    assert port.receive() == []
    wire.send(pack(Frame(0x371)))
    with socket.socket(fileno=os.dup(port.fileno())) as same:
        _, ancillary, _, _ = same.recvmsg(16, 64)
    assert [len(data) for _, _, data in ancillary] == [struct.calcsize("@ll")]
    port.close()


def test_filters_are_written_as_candump_writes_them() -> None:
    assert parse_filters("371:7ff,529") == (IdFilter(0x371, 0x7FF), IdFilter(0x529, 0x7FF))
    for wrong in ("", "371:", "xyz", "371:7ff,,"):
        with pytest.raises(BusError, match="371:7ff"):
            parse_filters(wrong)


@pytest.mark.parametrize(
    "url",
    ["", "can0", "socketcan:", "hub:", "python-can:", "tcp:host", "hub:?node=a"],
)
def test_a_url_that_names_no_bus_is_refused_with_those_that_do(url: str) -> None:
    with pytest.raises(BusError, match="socketcan:INTERFACE, hub:SOCKET_PATH"):
        open_port(url, bitrate_bps=500_000)


@pytest.mark.parametrize("url", ["hub:/tmp/h?name=a", "socketcan:can0?filters=1"])
def test_an_unknown_option_is_named(url: str) -> None:
    with pytest.raises(BusError, match="is no option"):
        open_port(url, bitrate_bps=500_000)
