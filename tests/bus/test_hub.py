from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Iterable
from contextlib import ExitStack, asynccontextmanager, contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hil.bus import BusPort, BusState, open_port
from hil.bus.faults import Corrupt, Drop, Fault, NodeOff
from hil.bus.hub import Hub, open_hub
from hil.errors import BusBusy, BusError, BusOff, ProtocolError
from hil.frames import FRAME_BYTES, Frame, pack, unpack

from .harness import collect, run, send_all

BITRATE_BPS = 500_000


@asynccontextmanager
async def hub_with(
    path: Path, *nodes: str, faults: Iterable[Fault] = (), bitrate_bps: int = BITRATE_BPS
) -> AsyncIterator[tuple[Hub, list[BusPort]]]:
    async with Hub(path, bitrate_bps, faults=tuple(faults)) as hub:
        with ExitStack() as stack:
            ports: list[BusPort] = []
            for node in nodes:
                port = open_hub(path, node=node)
                stack.callback(port.close)
                ports.append(port)
            await asyncio.sleep(0)
            yield hub, ports
        await asyncio.sleep(0.01)


@contextmanager
def raw_client(path: Path) -> Iterable[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as sock:
        sock.connect(str(path))
        sock.setblocking(False)
        yield sock


def test_frames_take_their_time_on_the_wire(tmp_path: Path) -> None:
    async def scene() -> None:
        async with hub_with(tmp_path / "h", "a", "b", bitrate_bps=50_000) as (_, (a, b)):
            sent_s = time.monotonic()
            for n in range(10):
                a.send(Frame(0x100, bytes([n] * 8)))
            received = await collect(b, 10)
            # 135 bits at 50 kbit/s: 2.7 ms each. Never sooner, and not much later.
            for n, item in enumerate(received):
                late_s = item.t_s - sent_s - (n + 1) * 2.7e-3
                assert -0.3e-3 < late_s < 0.5

    run(scene())


def test_waiting_frames_go_out_by_priority(tmp_path: Path) -> None:
    async def scene() -> None:
        async with hub_with(tmp_path / "h", "a", "b", "c", bitrate_bps=10_000) as (_, ports):
            a, b, c = ports
            a.send(Frame(0x700, bytes(8)))
            await asyncio.sleep(0.003)
            a.send(Frame(0x300, bytes(8)))
            b.send(Frame(0x100, bytes(8)))
            assert [item.frame.can_id for item in await collect(c, 3)] == [0x700, 0x100, 0x300]

    run(scene())


def test_a_full_queue_holds_the_sender_back_and_loses_nothing(tmp_path: Path) -> None:
    async def scene() -> None:
        async with hub_with(tmp_path / "h", "a", "b") as (hub, (a, b)):
            accepted = fill(a, 0x100)
            with pytest.raises(BusBusy, match="queue is full"):
                a.send(Frame(0x100))
            rest = [Frame(0x100, n.to_bytes(8, "big")) for n in range(accepted, 200)]
            sending = asyncio.create_task(send_all(a, rest))
            received = await collect(b, 200)
            await sending
            assert [int.from_bytes(item.frame.data, "big") for item in received] == list(range(200))
            assert hub.clients["a"].received == 200
            assert hub.totals.refused == 0

    run(scene())


def test_the_hub_counts_its_load(tmp_path: Path) -> None:
    async def scene() -> None:
        async with hub_with(tmp_path / "h", "a", "b") as (hub, (a, b)):
            await send_all(a, [Frame(0x100, bytes(8))] * 50)
            await collect(b, 50)
            assert hub.totals.frames == 50
            assert hub.totals.busy_s == pytest.approx(50 * 270e-6)

    run(scene())


def test_clients_go_by_their_names(tmp_path: Path) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        async with hub_with(path, "control", "control", "leg1") as (hub, ports):
            anonymous = open_port(f"hub:{path}", bitrate_bps=BITRATE_BPS)
            named = open_port(f"hub:{path}?node=imu", bitrate_bps=BITRATE_BPS)
            await asyncio.sleep(0.01)
            assert list(hub.clients) == ["control", "control-2", "leg1", "client-4", "imu"]
            anonymous.close()
            named.close()
            ports[0].close()
            await asyncio.sleep(0.01)
            assert list(hub.clients) == ["control-2", "leg1"]

    run(scene())


def test_scripted_faults_strike_named_clients(tmp_path: Path) -> None:
    async def scene() -> None:
        script = [Drop(sender="leg1", count=1), Corrupt(sender="leg2", bits=2)]
        async with hub_with(tmp_path / "h", "leg1", "leg2", "master", faults=script) as (
            hub,
            ports,
        ):
            leg1, leg2, master = ports
            leg1.send(Frame(0x371, b"lost"))
            leg1.send(Frame(0x371, b"kept"))
            assert [item.frame.data for item in await collect(master, 1)] == [b"kept"]
            leg2.send(Frame(0x372, b"bent"))
            (item,) = await collect(master, 1)
            assert item.frame.data != b"bent"
            assert hub.totals.struck == (1, 1)

    run(scene())


def test_a_client_off_the_bus_is_told_and_comes_back(tmp_path: Path) -> None:
    async def scene() -> None:
        script = [NodeOff(node="leg1", at_s=0.1, for_s=0.6)]
        async with hub_with(tmp_path / "h", "leg1", "master", faults=script) as (hub, ports):
            leg1, master = ports
            (notice,) = await collect(leg1, 1)
            assert notice.frame.is_error
            assert leg1.state is BusState.BUS_OFF
            with pytest.raises(BusOff, match="termination"):
                leg1.send(Frame(0x371))
            # One that does not look at its state is not heard either.
            os.write(leg1.fileno(), pack(Frame(0x371, b"deaf")))
            master.send(Frame(0x295, b"unheard"))
            await asyncio.sleep(0.02)
            assert hub.clients["leg1"].refused == 1
            assert leg1.receive() == []
            late = open_hub(tmp_path / "h", node="leg1")  # gets another name: not struck
            await asyncio.sleep(0.01)
            assert late.receive() == []
            late.close()
            await collect(leg1, 1)
            assert leg1.state is BusState.ERROR_ACTIVE
            leg1.send(Frame(0x371, b"back"))
            assert [item.frame.data for item in await collect(master, 1)] == [b"back"]

    run(scene())


def test_who_joins_while_struck_off_the_bus_is_told_at_once(tmp_path: Path) -> None:
    async def scene() -> None:
        script = [NodeOff(node="leg1", at_s=0.0)]
        async with hub_with(tmp_path / "h", faults=script):
            await asyncio.sleep(0.02)
            leg1 = open_hub(tmp_path / "h", node="leg1")
            await collect(leg1, 1)
            assert leg1.state is BusState.BUS_OFF
            leg1.close()

    run(scene())


def test_a_client_that_does_not_read_loses_its_own_frames_only(tmp_path: Path) -> None:
    async def scene() -> None:
        count = 2000
        async with hub_with(tmp_path / "h", "a", "b", "stalled", bitrate_bps=1_000_000) as (hub, p):
            a, b, _ = p
            sending = asyncio.create_task(send_all(a, [Frame(0x100)] * count))
            await collect(b, count, timeout_s=20)
            await sending
            lost = hub.clients["stalled"].lost
            assert lost > 0
            assert lost + hub.clients["stalled"].delivered == count
            assert hub.clients["b"].delivered == count

    run(scene())


def test_a_client_that_dies_with_a_full_queue_is_forgotten_once_it_is_sent(tmp_path: Path) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        async with hub_with(path, "a", "b", "c", bitrate_bps=100_000) as (hub, (a, b, c)):
            sent = fill(a, 0x100)
            await asyncio.sleep(0.005)
            a.close()
            c.send(Frame(0x050, b"and yet"))  # which cannot be handed to the dead one any more
            received = await collect(b, sent + 1)
            assert [item.frame.can_id for item in received].count(0x100) == sent
            await asyncio.sleep(0.01)
            assert list(hub.clients) == ["b", "c"]

    run(scene())


def fill(port: BusPort, can_id: int) -> int:
    """Send numbered frames until the port says that its queue is full; how many went."""
    for n in range(1000):
        try:
            port.send(Frame(can_id, n.to_bytes(8, "big")))
        except BusBusy:
            return n
    raise AssertionError("the queue has no bound")


def is_frame(record: bytes) -> bool:
    try:
        return not unpack(record).is_error
    except ProtocolError:
        return False


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    records=st.lists(
        st.one_of(
            st.binary(max_size=64),
            st.binary(min_size=FRAME_BYTES, max_size=FRAME_BYTES),
            st.builds(
                lambda can_id, data: pack(Frame(can_id, data)),
                st.integers(0, 0x7FF),
                st.binary(max_size=8),
            ),
        ),
        max_size=20,
    )
)
def test_nonsense_is_counted_and_what_is_a_frame_goes_on(
    tmp_path: Path, records: list[bytes]
) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        async with hub_with(path, "ear", bitrate_bps=1_000_000) as (hub, (ear,)):
            with raw_client(path) as garbler:
                for record in records:
                    while True:
                        try:
                            garbler.send(record)
                            break
                        except BlockingIOError:
                            await asyncio.sleep(0.001)
                sent = [unpack(record) for record in records if is_frame(record)]
                garbler.send(pack(Frame(0x7FF, b"the end")))
                sent.append(Frame(0x7FF, b"the end"))
                received = await collect(ear, len(sent))
                assert [item.frame for item in received] == sent
                (counters,) = (c for name, c in hub.clients.items() if name != "ear")
                assert counters.malformed == len(records) + 1 - len(sent)

    run(scene())


@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    acts=st.lists(
        st.sampled_from(["join", "leave", "vanish with a frame", "shut", "empty", "write"]),
        max_size=25,
    )
)
def test_the_others_talk_on_whatever_clients_do(tmp_path: Path, acts: list[str]) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        async with hub_with(path, "a", "b", bitrate_bps=1_000_000) as (hub, (a, b)):
            strangers: list[socket.socket] = []
            for n, act in enumerate(acts):
                if act == "join" or not strangers:
                    stranger = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
                    stranger.connect(str(path))
                    stranger.setblocking(False)
                    strangers.append(stranger)
                elif act == "shut":
                    strangers[-1].shutdown(socket.SHUT_RDWR)
                    strangers.pop().close()
                elif act in ("leave", "vanish with a frame"):
                    if act != "leave":
                        strangers[0].send(pack(Frame(0x100)))
                    strangers.pop(0).close()
                else:
                    strangers[0].send(b"" if act == "empty" else b"\xff" * 16)
                a.send(Frame(0x200, bytes([n])))
                while bytes([n]) not in [i.frame.data for i in await collect(b, 1)]:
                    pass
            for stranger in strangers:
                stranger.close()
            a.send(Frame(0x200, b"flush"))
            await asyncio.sleep(0.01)
            assert list(hub.clients) == ["a", "b"]

    run(scene())


def test_a_crowd_is_turned_away_at_the_door(tmp_path: Path) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        async with hub_with(path, "a", "b") as (hub, (a, b)):
            with ExitStack() as stack:
                for _ in range(80):
                    crowd = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
                    stack.enter_context(crowd)
                    crowd.connect(str(path))
                    await asyncio.sleep(0)
                a.send(Frame(0x100))
                await collect(b, 1)
                assert len(hub.clients) == 64

    run(scene())


def test_ports_learn_that_the_hub_has_gone_after_their_last_frames(tmp_path: Path) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        async with Hub(path, BITRATE_BPS):
            a, b = open_hub(path), open_hub(path)
            a.send(Frame(0x100, b"last"))
            await asyncio.sleep(0.02)
        assert [item.frame.data for item in b.receive()] == [b"last"]
        for _ in range(2):
            with pytest.raises(BusError, match="start the hub again"):
                b.receive()
        with pytest.raises(BusError, match="start the hub again"):
            b.send(Frame(0x100))
        a.close()
        b.close()
        assert not path.exists()

    run(scene())


def test_there_is_one_hub_a_path(tmp_path: Path) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        async with Hub(path, BITRATE_BPS):
            with pytest.raises(BusError, match="another hub"):
                await Hub(path, BITRATE_BPS).start()
            port = open_hub(path)
            port.close()

    run(scene())


def test_a_dead_hubs_socket_is_taken_over_but_no_other_file_is(tmp_path: Path) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as dead:
            dead.bind(str(path))
        async with hub_with(path, "a", "b") as (_, (a, b)):
            a.send(Frame(0x100))
            await collect(b, 1)
        path.write_text("mine")
        with pytest.raises(BusError, match="no socket can be put there"):
            await Hub(path, BITRATE_BPS).start()
        assert path.read_text() == "mine"

    run(scene())


def test_where_no_hub_is_the_error_says_how_to_start_one(tmp_path: Path) -> None:
    with pytest.raises(BusError, match=r"python -m hil\.bus\.hub"):
        open_hub(tmp_path / "h")
    with pytest.raises(BusError, match="107 bytes"):
        open_hub(tmp_path / ("x" * 120))
    with pytest.raises(BusError, match="name"):
        open_hub(tmp_path / "h", node="a/b")


def test_a_silent_monitor_that_leaves_is_forgotten_with_the_next_frame(tmp_path: Path) -> None:
    async def scene() -> None:
        path = tmp_path / "h"
        async with hub_with(path, "a", "b") as (hub, (a, b)):
            monitor = open_hub(path, node="monitor", read_only=True)
            a.send(Frame(0x100))
            await collect(monitor, 1)
            monitor.close()
            a.send(Frame(0x100))
            await collect(b, 2)
            assert list(hub.clients) == ["a", "b"]

    run(scene())


def test_it_runs_as_a_program_until_it_is_told_to_stop(tmp_path: Path) -> None:
    path, script = tmp_path / "h", tmp_path / "faults.toml"
    script.write_text('[[fault]]\nkind = "drop"\nids = [0x123]\n')
    program = subprocess.Popen(
        [sys.executable, "-m", "hil.bus.hub", path, "--bitrate", "1000000", "--faults", script],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert program.stderr is not None
        assert "1000000 bit/s" in program.stderr.readline()

        async def scene() -> None:
            a, b = open_hub(path), open_hub(path)
            a.send(Frame(0x123))
            a.send(Frame(0x124))
            assert [item.frame.can_id for item in await collect(b, 1)] == [0x124]
            a.close()
            b.close()

        run(scene())
        program.send_signal(signal.SIGTERM)
        _, rest = program.communicate(timeout=10)
    finally:
        program.kill()
        program.communicate()
    assert program.returncode == 0
    assert "2 frames" in rest
    assert not path.exists()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[[fault]]\nkind = "drop"\nprobability = 1.5\n', "probability"),
        ('[[fault]]\nkind = "melt"\n', "melt"),
        ('[[fault]]\nkind = "delay"\n', "by_s"),
        ('[[fault]]\nkind = "drop"\nhow_often = 3\n', "how_often"),
        ("[[fault", "no TOML"),
    ],
)
def test_a_faulty_fault_file_is_refused_with_its_key(
    tmp_path: Path, text: str, sentence: str
) -> None:
    script = tmp_path / "faults.toml"
    script.write_text(text)
    done = subprocess.run(
        [sys.executable, "-m", "hil.bus.hub", tmp_path / "h", "--faults", script],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == 1
    assert str(script) in done.stderr
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr
