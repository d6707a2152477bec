"""SDO: our client against the canopen package's server and against ours, and theirs against ours."""

from __future__ import annotations

import canopen
import pytest
from canopen.sdo.exceptions import SdoAbortedError
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.configfile import data_folder
from hil.drives.cia402.aborts import ABORTS, CODES, SdoAbort, SdoTimeout
from hil.drives.cia402.sdo import SdoClient, Transfer
from hil.sim.cia402.sdo_server import SdoServer

EDS = str(data_folder("drives") / "cia402" / "device.eds")
NODE = 5


class Loop(canopen.Network):
    """A network without a bus: what is sent is handed to `hears`."""

    def __init__(self) -> None:
        super().__init__()
        self.hears = lambda can_id, data: None

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self.hears(can_id, bytes(data))


def serve_canopen() -> tuple[canopen.LocalNode, SdoClient, list[bytes]]:
    """A LocalNode, a client of ours, and the requests that were sent."""
    network, client, sent = Loop(), SdoClient(0.1, 2), []
    node = network.create_node(canopen.LocalNode(NODE, EDS))
    network.hears = lambda can_id, data: client.on_answer(data) if can_id == 0x580 + NODE else None
    return node, client, sent


def finish(client: SdoClient, transfer: Transfer, send) -> Transfer:
    client.submit(transfer)
    now_s = 0.0
    while not transfer.is_done and now_s < 10.0:
        request = client.next_request(now_s)
        if request is not None:
            send(request)
        now_s += 0.01
    abort = client.next_request(now_s)
    if abort is not None:
        send(abort)
    return transfer


def with_canopen(transfer: Transfer) -> Transfer:
    node, client, _ = serve_canopen()
    return finish(client, transfer, lambda d: node.sdo.on_request(0x600 + NODE, bytearray(d), 0.0))


def test_four_bytes_and_less_are_read_at_once_from_their_server():
    assert with_canopen(Transfer(0x1000, 0)).result == bytes.fromhex("92010200")
    assert with_canopen(Transfer(0x6502, 0)).result == (0x3E5).to_bytes(4, "little")


def test_a_string_is_read_in_segments_from_their_server():
    assert with_canopen(Transfer(0x1008, 0)).result == b"Servo drive after CiA 402"


@pytest.mark.parametrize("size", [1, 4, 5, 7, 8, 14, 15, 100])
def test_any_length_is_written_to_their_server(size):
    node, client, _ = serve_canopen()
    node.object_dictionary[0x1008].access_type = "rw"
    text = bytes(range(65, 65 + size))
    done = finish(
        client,
        Transfer(0x1008, 0, text),
        lambda d: node.sdo.on_request(0x600 + NODE, bytearray(d), 0.0),
    )
    assert done.error is None
    assert node.get_data(0x1008, 0) == text


@pytest.mark.parametrize(
    ("transfer", "name"),
    [
        (Transfer(0x5FFF, 0), "no_object"),
        (Transfer(0x1018, 9), "no_subindex"),
        (Transfer(0x1000, 0, bytes(4)), "read_only"),
    ],
)
def test_aborts_of_their_server_are_named(transfer, name):
    error = with_canopen(transfer).error
    assert isinstance(error, SdoAbort)
    assert error.name == name
    assert f"{transfer.index:#06x}" in str(error)


def test_abort_codes_are_those_of_the_canopen_package():
    assert SdoAbortedError.CODES.keys() - ABORTS.keys() == set()
    assert len(CODES) == len(ABORTS)


# our server


class Store:
    """A dictionary behind our server."""

    def __init__(self) -> None:
        self.values: dict[tuple[int, int], bytes] = {}
        self.server = SdoServer(self.read, self.write)

    def read(self, index: int, sub: int) -> bytes:
        if (index, sub) not in self.values:
            raise SdoAbort(CODES["no_object"])
        return self.values[index, sub]

    def write(self, index: int, sub: int, data: bytes) -> None:
        self.values[index, sub] = data


def with_ours(store: Store, transfer: Transfer) -> Transfer:
    client = SdoClient(0.1, 2)

    def send(data: bytes) -> None:
        answer = store.server.on_request(data)
        if answer is not None:
            client.on_answer(answer)

    return finish(client, transfer, send)


@settings(max_examples=60, deadline=None)
@given(st.binary(min_size=1, max_size=80))
def test_what_is_written_is_read_back(data):
    store = Store()
    assert with_ours(store, Transfer(0x2000, 1, data)).error is None
    assert with_ours(store, Transfer(0x2000, 1)).result == data


def test_their_client_reads_and_writes_our_server():
    store, network = Store(), Loop()
    node = network.add_node(canopen.RemoteNode(NODE, EDS))

    def hears(can_id: int, data: bytes) -> None:
        answer = store.server.on_request(data)
        if answer is not None:
            node.sdo.on_response(0x580 + NODE, answer, 0.0)

    network.hears = hears
    store.values[0x1008, 0] = b"a name that needs four segments"
    assert node.sdo.upload(0x1008, 0) == b"a name that needs four segments"
    node.sdo.download(0x6065, 0, bytes(4))
    node.sdo.download(0x2100, 0, bytes(range(50)), force_segment=True)
    assert store.values[0x2100, 0] == bytes(range(50))
    with pytest.raises(SdoAbortedError, match="does not exist"):
        node.sdo.upload(0x5FFF, 0)


# the channel


def test_a_node_that_says_nothing_is_asked_again_and_then_given_up():
    client = SdoClient(0.1, 2)
    transfer = client.submit(Transfer(0x1000, 0))
    asked = [t for t in range(100) if client.next_request(t * 0.01) == transfer.request]
    assert asked == [0, 10]
    assert isinstance(transfer.error, SdoTimeout)
    assert "0.2 s" in str(transfer.error)
    assert client.is_idle


def test_one_transfer_at_a_time():
    client = SdoClient(0.1, 2)
    first, second = client.submit(Transfer(0x1000, 0)), client.submit(Transfer(0x6502, 0))
    assert client.next_request(0.0) == first.request
    assert client.next_request(0.01) is None
    client.on_answer(bytes.fromhex("4300100092010200"))
    assert first.is_done
    assert client.next_request(0.02) == second.request


@pytest.mark.parametrize(
    ("answer", "name"),
    [
        (b"\x43\x00\x10", "data_length"),
        (bytes.fromhex("4100100000000001"), "out_of_memory"),
    ],
)
def test_answers_that_cannot_be_are_aborted(answer, name):
    client = SdoClient(0.1, 2)
    transfer = client.submit(Transfer(0x1000, 0))
    client.next_request(0.0)
    client.on_answer(answer)
    assert isinstance(transfer.error, SdoAbort)
    assert transfer.error.name == name
    abort = client.next_request(0.01)
    assert abort is not None
    assert abort[0] == 0x80
    assert int.from_bytes(abort[4:], "little") == CODES[name]


@pytest.mark.parametrize(
    "answer",
    [
        "4341600000000000",  # what another object is
        "6000100000000000",  # this object is written
        "8041600000000206",  # another object does not exist
        "0041424344454647",  # a segment
    ],
)
def test_an_answer_to_a_request_before_this_one_is_left_alone(answer):
    client = SdoClient(0.1, 2)
    transfer = client.submit(Transfer(0x1000, 0))
    client.next_request(0.0)
    client.on_answer(bytes.fromhex(answer))
    assert not transfer.is_done
    assert (client.unasked, client.answered) == (1, 0)
    client.on_answer(bytes.fromhex("4300100092010200"))
    assert transfer.result == bytes.fromhex("92010200")


def test_a_node_that_answers_late_answers_twice_and_spoils_nothing():
    """Each request that was repeated has its own answer; the second one comes during the next transfer."""
    store, client = Store(), SdoClient(0.1, 2)
    values = [bytes(range(4)), bytes(range(20)), bytes(range(3))]
    line = []
    for sub, value in enumerate(values, start=1):
        line += [Transfer(0x2000, sub, value), Transfer(0x2000, sub)]
    for transfer in line:
        client.submit(transfer)
    under_way: list[tuple[float, bytes]] = []
    for k in range(3000):
        now_s = k * 0.01
        while under_way and under_way[0][0] <= now_s:
            client.on_answer(under_way.pop(0)[1])
        request = client.next_request(now_s)
        answer = None if request is None else store.server.on_request(request)
        if answer is not None:
            is_segment = answer[0] & 0xE0 in (0x00, 0x20)
            under_way.append((now_s + (0.01 if is_segment else 0.13), answer))
            under_way.sort(key=lambda item: item[0])
    assert [t.error for t in line] == [None] * 6
    assert [t.result for t in line[1::2]] == values
    assert client.unasked == 6


def test_what_was_withdrawn_is_never_sent():
    client = SdoClient(0.1, 2)
    first, second = client.submit(Transfer(0x1000, 0)), client.submit(Transfer(0x6065, 0, bytes(4)))
    assert client.next_request(0.0) == first.request
    client.withdraw(second)
    client.withdraw(first)
    abort = client.next_request(0.01)
    assert abort is not None
    assert abort[0] == 0x80
    assert client.next_request(0.02) is None
    assert client.is_idle
    assert first.error is not None


def test_a_segment_that_comes_twice_is_noticed():
    client = SdoClient(0.1, 2)
    transfer = client.submit(Transfer(0x1008, 0))
    client.next_request(0.0)
    client.on_answer(bytes.fromhex("410810000e000000"))
    client.next_request(0.01)
    client.on_answer(b"\x00ABCDEFG")
    client.next_request(0.02)
    client.on_answer(b"\x00ABCDEFG")
    assert isinstance(transfer.error, SdoAbort)
    assert transfer.error.name == "toggle_bit"


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=9), max_size=30))
def test_whatever_comes_never_raises_and_ends(answers):
    client = SdoClient(0.1, 2)
    transfer = client.submit(Transfer(0x1008, 0))
    for k, answer in enumerate(answers):
        client.next_request(k * 0.01)
        client.on_answer(answer)
    for k in range(200):
        client.next_request(1.0 + k * 0.01)
    assert transfer.is_done
