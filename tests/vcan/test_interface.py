"""What a port does when its interface is set down, pulled, full, flooded or spoken to by strangers."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import can
import pytest

from hil.bus import BusPort, BusState, open_port
from hil.errors import BusBusy, BusError, BusOff
from hil.frames import Frame, pack
from tests.bus.harness import collect, run, silence

from .wire import BITRATE_BPS, URL, VCAN, ip, raw_socket, stop_the_queue

pytestmark = pytest.mark.vcan


def opened(*, read_only: bool = False) -> closing[BusPort]:
    return closing(open_port(URL, bitrate_bps=BITRATE_BPS, read_only=read_only))


@pytest.fixture
def port() -> Iterator[BusPort]:
    with opened() as made:
        yield made


def heard(port: BusPort, count: int) -> list[Frame]:
    """The next frames: a vcan hands them over in its own time."""

    async def wait() -> list[Frame]:
        return [item.frame for item in await collect(port, count, timeout_s=30.0)]

    return run(wait())


def test_an_interface_that_is_down_refuses_to_be_opened_and_says_how_to_bring_it_up() -> None:
    ip("link", "set", VCAN, "down")
    with pytest.raises(BusError, match=f"ip link set {VCAN} up"):
        open_port(URL, bitrate_bps=BITRATE_BPS)


def test_set_down_with_frames_in_flight_is_off_the_bus_after_them_and_back_when_up(port) -> None:
    with raw_socket() as wire:
        for n in range(5):
            wire.send(pack(Frame(0x371, bytes([n]))))
        ip("link", "set", VCAN, "down")
        *before, notice = [item.frame for item in port.receive()]
        assert [frame.data[0] for frame in before] == [0, 1, 2, 3, 4]
        assert notice.is_error
        assert port.state is BusState.BUS_OFF
        for _ in range(3):
            with pytest.raises(BusOff, match=r"the interface is down.*ip link set vcan0 up"):
                port.send(Frame(0x295, bytes(8)))
        assert port.receive() == []
        ip("link", "set", VCAN, "up")
    with raw_socket() as witness:
        port.send(Frame(0x295, b"back"))
        assert port.state is BusState.ERROR_ACTIVE
        assert witness.recv(16) == pack(Frame(0x295, b"back"))


def test_one_that_only_listens_hears_again_after_down_and_up(port) -> None:
    ip("link", "set", VCAN, "down")
    assert [item.frame.is_error for item in port.receive()] == [True]
    ip("link", "set", VCAN, "up")
    with raw_socket() as wire:
        wire.send(pack(Frame(0x371)))
    assert heard(port, 1) == [Frame(0x371)]
    assert port.state is BusState.ERROR_ACTIVE


def test_a_pulled_adapter_is_a_lost_bus_after_the_frames_that_came_before(port) -> None:
    with raw_socket() as wire:
        wire.send(pack(Frame(0x371, b"last")))
    ip("link", "del", VCAN)
    assert port.receive()[0].frame == Frame(0x371, b"last")
    with pytest.raises(BusError, match="No such device") as loss:
        port.receive()
    assert not isinstance(loss.value, BusOff)
    with pytest.raises(BusError, match=VCAN):
        port.send(Frame(0x295, bytes(8)))


def test_a_full_queue_is_busy_and_sends_again_when_it_flows(port) -> None:
    stop_the_queue()
    for _ in range(20):
        with suppress(BusBusy):
            port.send(Frame(0x295, bytes(8)))
    assert 1 <= port.counters.sent <= 15
    refused = port.counters.refused
    with pytest.raises(BusBusy, match="transmit queue is full"):
        port.send(Frame(0x295, bytes(8)))
    assert port.counters.refused == refused + 1
    assert port.state is BusState.ERROR_ACTIVE
    subprocess.run(["tc", "qdisc", "del", "dev", VCAN, "root"], check=True)
    port.send(Frame(0x295, bytes(8)))


def test_remote_extended_short_and_error_frames_come_as_what_they_are(port) -> None:
    frames = [
        Frame(0x371, is_remote=True),
        Frame(0x371, bytes(3)),
        Frame(0x371, bytes(8), is_extended=True),
        Frame(0x004, bytes([0, 0x08, 0, 0, 0, 0, 0, 0]), is_error=True),
    ]
    with raw_socket() as wire:
        for frame in frames:
            wire.send(pack(frame))
    assert heard(port, len(frames)) == frames
    assert port.state is BusState.ERROR_WARNING


def test_can_fd_frames_of_others_do_not_reach_a_classic_port(port) -> None:
    """Only where the interface carries them at all; a port asks for classic frames."""
    ip("link", "set", VCAN, "down")
    ip("link", "set", VCAN, "mtu", "72")
    ip("link", "set", VCAN, "up")
    port.receive()
    with can.Bus(interface="socketcan", channel=VCAN, fd=True) as other:
        other.send(can.Message(arbitration_id=0x371, is_fd=True, data=bytes(64)))
        other.send(can.Message(arbitration_id=0x371, is_extended_id=False, data=b"classic"))
    assert heard(port, 1) == [Frame(0x371, b"classic")]
    assert port.counters.malformed == 0


def test_a_flood_loses_no_frame_that_is_read_in_time_and_never_holds_the_loop(port) -> None:
    command = ["cangen", VCAN, "-I", "000", "-L", "8", "-D", "i", "-g", "0", "-n", "3000"]
    with subprocess.Popen(command) as flood:
        counts = [int.from_bytes(frame.data, "little") for frame in heard(port, 3000)]
    assert flood.returncode == 0
    assert counts == list(range(3000))


def test_a_replayed_log_arrives_frame_by_frame(tmp_path: Path) -> None:
    log = tmp_path / "can.log"
    frames = [Frame(0x371 + n % 3, n.to_bytes(4, "little")) for n in range(200)]
    log.write_text(
        "".join(
            f"({10 + n * 0.002:.6f}) can0 {frame.can_id:03X}#{frame.data.hex().upper()}\n"
            for n, frame in enumerate(frames)
        )
    )

    with (
        opened(read_only=True) as listener,
        subprocess.Popen(["canplayer", "-I", str(log), f"{VCAN}=can0"]) as player,
    ):
        assert heard(listener, len(frames)) == frames
    assert player.returncode == 0


def test_a_read_only_port_cannot_transmit_by_any_way_and_hears_its_interface_alone(port) -> None:
    async def scene() -> None:
        with opened(read_only=True) as listener:
            with pytest.raises(BusError, match="reading only"):
                listener.send(Frame(0x295, bytes(8)))
            with pytest.raises(OSError, match="No such device"):
                os.write(listener.fileno(), pack(Frame(0x295, bytes(8))))
            await silence(port)
            with raw_socket("vcan1") as elsewhere:
                elsewhere.send(pack(Frame(0x372)))
            port.send(Frame(0x371))
            assert [item.frame for item in await collect(listener, 1)] == [Frame(0x371)]

    run(scene())
