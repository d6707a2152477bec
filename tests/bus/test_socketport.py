from __future__ import annotations

import itertools
import socket
import struct
import time
from collections.abc import Iterator

import pytest

from hil.bus import BusState
from hil.bus.clocks import SO_TIMESTAMPNS, monotonic_minus_realtime_s, received_s
from hil.bus.socketport import SocketPort
from hil.errors import BusError, BusOff
from hil.frames import Frame, pack

Pair = tuple[SocketPort, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    """A port, and the bare other end of its socket."""
    mine, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    port = SocketPort("test:", mine, read_only=False, remedy="plug it in again")
    yield port, theirs
    port.close()
    theirs.close()


def error_frame(error_class: int, detail: int = 0) -> bytes:
    return pack(Frame(error_class, bytes([0, detail, 0, 0, 0, 0, 0, 0]), is_error=True))


def test_records_that_are_no_frames_are_counted_and_passed_over(pair: Pair) -> None:
    port, wire = pair
    too_long_a_length = struct.pack("=IB3x8s", 0x123, 9, bytes(8))
    for record in (b"", b"x", bytes(15), bytes(17), bytes(5000), too_long_a_length):
        wire.send(record)
    wire.send(pack(Frame(0x123, b"sound")))
    assert [item.frame for item in port.receive()] == [Frame(0x123, b"sound")]
    assert port.counters.malformed == 6
    assert port.counters.received == 1


def test_a_flood_does_not_hold_the_caller_for_ever(pair: Pair) -> None:
    port, wire = pair
    wire.setblocking(False)
    wire.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    sent = 0
    try:
        while sent < 5000:
            wire.send(pack(Frame(0x001)))
            sent += 1
    except BlockingIOError:
        pass
    first = len(port.receive())
    assert 0 < first <= 512
    rest = first
    while more := len(port.receive()):
        rest += more
    assert rest == sent


@pytest.mark.parametrize(
    ("detail", "state"),
    [
        (0x04, BusState.ERROR_WARNING),
        (0x08, BusState.ERROR_WARNING),
        (0x10, BusState.ERROR_PASSIVE),
        (0x20, BusState.ERROR_PASSIVE),
        (0x40, BusState.ERROR_ACTIVE),
        (0x01, BusState.ERROR_ACTIVE),  # receive overflow: no state of its own
    ],
)
def test_error_frames_name_the_controllers_state(pair: Pair, detail: int, state: BusState) -> None:
    port, wire = pair
    wire.send(error_frame(0x004, detail))
    (item,) = port.receive()
    assert item.frame.is_error
    assert port.state is state


def test_off_the_bus_nothing_is_sent_until_the_controller_is_restarted(pair: Pair) -> None:
    port, wire = pair
    wire.setblocking(False)
    wire.send(error_frame(0x040))
    port.receive()
    with pytest.raises(BusOff, match="test:"):
        port.send(Frame(0x123))
    with pytest.raises(BlockingIOError):
        wire.recv(16)
    wire.send(error_frame(0x100))
    port.receive()
    port.send(Frame(0x123))
    assert wire.recv(16) == pack(Frame(0x123))


def test_whoever_receives_again_is_on_the_bus_again(pair: Pair) -> None:
    port, wire = pair
    wire.send(error_frame(0x040))
    wire.send(pack(Frame(0x371)))
    port.receive()
    assert port.state is BusState.ERROR_ACTIVE


def test_the_loss_of_the_bus_is_told_after_the_frames_before_it(pair: Pair) -> None:
    port, wire = pair
    wire.send(pack(Frame(0x371)))
    wire.close()
    assert len(port.receive()) == 1
    with pytest.raises(BusError, match=r"test:: the other end has closed; plug it in again"):
        port.receive()
    with pytest.raises(BusError, match="plug it in again"):
        port.send(Frame(0x123))
    assert port.counters.refused == 1


def _stamp(t_s: float) -> list[tuple[int, int, bytes]]:
    seconds = int(t_s)
    data = struct.pack("@ll", seconds, round((t_s - seconds) * 1e9))
    return [(socket.SOL_SOCKET, SO_TIMESTAMPNS, data)]


def test_a_stamp_of_the_wall_clock_is_brought_to_the_monotonic_clock() -> None:
    now_s, wall_s = time.monotonic(), time.time()
    stamped_s = received_s(_stamp(wall_s - 0.25), monotonic_minus_realtime_s(), now_s)
    assert stamped_s == pytest.approx(now_s - 0.25, abs=1e-3)


@pytest.mark.parametrize("age_s", [-0.5, 60.0, 1e6])
def test_a_stamp_that_a_step_of_the_wall_clock_has_spoilt_is_not_believed(age_s: float) -> None:
    now_s, wall_s = time.monotonic(), time.time()
    assert received_s(_stamp(wall_s - age_s), monotonic_minus_realtime_s(), now_s) == now_s


def test_without_a_stamp_the_instant_of_reading_holds() -> None:
    assert received_s([], 0.0, 12.5) == 12.5
    assert received_s([(socket.SOL_SOCKET, SO_TIMESTAMPNS, b"short")], 0.0, 12.5) == 12.5


def test_stamps_never_run_back_whatever_the_reading_of_the_clocks(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    port, wire = pair
    true_s = monotonic_minus_realtime_s()
    stamps = []
    for late_s in (0.0, -0.02, -0.001):  # interrupted between the two readings
        monkeypatch.setattr(
            "hil.bus.socketport.monotonic_minus_realtime_s", lambda late_s=late_s: true_s + late_s
        )
        wire.send(pack(Frame(0x371)))
        stamps += [item.t_s for item in port.receive()]
    assert stamps == sorted(stamps)
    assert len(stamps) == 3


def test_waiting_between_the_clocks_does_not_shift_the_stamps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls = itertools.count()
    read = time.clock_gettime_ns

    def interrupted(clock: int) -> int:
        if next(calls) == 0:
            time.sleep(0.03)
        return read(clock)

    expected_s = monotonic_minus_realtime_s()
    monkeypatch.setattr(time, "clock_gettime_ns", interrupted)
    assert monotonic_minus_realtime_s() == pytest.approx(expected_s, abs=2e-3)
