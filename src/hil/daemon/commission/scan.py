"""Who is on a rig's buses: listens, then asks every CANopen node what it is. Nothing can be written."""

from __future__ import annotations

import select
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Final

from hil.bus.port import BusPort, open_port
from hil.config import RigFile
from hil.daemon.lock import RigLock
from hil.drives.build import parts_of
from hil.drives.cia402 import codec
from hil.drives.cia402.sdo import Transfer
from hil.drives.lust_cdd3000.codec import frame_ids
from hil.drives.meaning import Ask, Meaning
from hil.drives.profile import GROUP, LustProfile
from hil.drives.profiles import Profiles
from hil.errors import BusBusy
from hil.frames import Frame
from hil.safety import Gate, GateLimits

LISTEN_S: Final = 0.6
ANSWER_S: Final = 0.3
PACE_S: Final = 0.002
"""Between two requests: a scan must not fill anybody's queue."""
ROOM_TRIES: Final = 100
SERVO: Final = 402


class ScanMeaning:
    """All that a scan may say: read the device type and identity of a CANopen node."""

    lengths: Final = dict.fromkeys(
        range(codec.SDO_REQUEST_BASE + 1, codec.SDO_REQUEST_BASE + 1 + codec.LARGEST_NODE),
        codec.SDO_LENGTH,
    )
    reads: Final = frozenset({(0x1000, 0), (0x1018, 1), (0x1018, 2)})

    def writable(self, i: int) -> frozenset[int]:
        """Nothing."""
        return frozenset()

    def meaning(self, can_id: int, data: bytes) -> Meaning:
        """A read of one of these objects; everything else is unknown."""
        key = (data[1] | data[2] << 8, data[3])
        if data[0] == 0x40 and key in self.reads and not any(data[4:]):
            return Meaning(Ask.READ, parameter=key[0] << 8 | key[1])
        return Meaning(Ask.UNKNOWN, text="a scan only reads device type and identity")


@dataclass(slots=True)
class Found:
    """Somebody on a bus."""

    bus: int
    address: int
    family: str
    actuator: str = ""
    """Whose address it is in the rig file; empty: nobody's."""
    text: str = ""
    values: dict[str, int] = field(default_factory=dict)


def scan(rig: RigFile, profiles: Profiles) -> list[Found]:
    """Everybody on the rig's buses, by bus and address. RigInUse where a daemon runs the rig."""
    found: list[Found] = []
    with ExitStack() as stack:
        stack.enter_context(RigLock(rig.name, *rig.can.urls))
        for bus, (url, bitrate) in enumerate(zip(rig.can.urls, rig.can.bitrates, strict=True)):
            port = open_port(url, bitrate_bps=bitrate)
            stack.callback(port.close)
            found += _scan_bus(rig, profiles, bus, port)
    return sorted(found, key=lambda f: (f.bus, f.family, f.address))


def _scan_bus(rig: RigFile, profiles: Profiles, bus: int, port: BusPort) -> Iterator[Found]:
    names = {rig.address(i): a.name for i, a in enumerate(rig.actuators) if a.drive.bus == bus}
    families = {
        profiles[rig.actuators[actuators[0]].drive.profile].protocol: part
        for on, actuators, part in parts_of(rig, profiles)
        if on == bus
    }
    heard = {f.can_id for f in _heard(port, LISTEN_S)}
    if "canlust" in families:
        yield from _lust(families["canlust"], profiles, bus, heard, names)
    if "canopen" in families:
        yield from _nodes(port, bus, heard, names)


def _lust(
    rig: RigFile, profiles: Profiles, bus: int, heard: set[int], names: dict[int, str]
) -> Iterator[Found]:
    profile = profiles[rig.actuators[0].drive.profile]
    assert isinstance(profile, LustProfile)
    base, stride = profile.ids.log_on, profile.ids.stride
    for can_id in sorted(i for i in heard if base <= i < base + GROUP):
        address = (can_id - base) // stride
        yield Found(bus, address, profile.name, names.get(address, ""), "logs on")
    for address, name in names.items():
        ids = frame_ids(profile.ids, address)
        if ids.log_on not in heard and heard & {ids.status, ids.answer}:
            yield Found(bus, address, profile.name, name, "is in operation under a master")


def _nodes(port: BusPort, bus: int, heard: set[int], names: dict[int, str]) -> Iterator[Found]:
    gate = Gate(GateLimits((), 1e-3, 1.0), ScanMeaning())
    every = range(1, codec.LARGEST_NODE + 1)
    types = _read(port, gate, every, 0x1000, 0)
    vendors = _read(port, gate, types, 0x1018, 1)
    products = _read(port, gate, types, 0x1018, 2)
    silent = {i - codec.HEARTBEAT_BASE for i in heard if i - codec.HEARTBEAT_BASE in every}
    for node in sorted({*types, *silent}):
        name = names.get(node, "")
        if node not in types:
            yield Found(bus, node, "canopen", name, "is heard and does not answer SDO")
            continue
        profile = types[node] & 0xFFFF
        what = "servo drive (402)" if profile == SERVO else f"device profile {profile}"
        values = {"vendor": vendors.get(node, 0), "product": products.get(node, 0)}
        text = f"{what}, vendor {values['vendor']:#x}, product {values['product']:#x}"
        yield Found(bus, node, "canopen", name, text, values)


def _read(
    port: BusPort, gate: Gate, nodes: range | dict[int, int], index: int, sub: int
) -> dict[int, int]:
    """The object of each node that answers."""
    transfers = {node: Transfer(index, sub) for node in nodes}
    frames: list[Frame] = []
    for node, transfer in transfers.items():
        request = Frame(codec.SDO_REQUEST_BASE + node, transfer.request)
        if gate.pass_frame(time.monotonic(), request).ok:
            frames += _send(port, request)
        frames += _heard(port, PACE_S)
    for frame in [*frames, *_heard(port, ANSWER_S)]:
        waiting = transfers.get(frame.can_id - codec.SDO_ANSWER_BASE)
        if waiting is not None and not waiting.is_done and waiting.fits(frame.data):
            waiting.take(frame.data)
    return {
        node: int.from_bytes(t.result, "little")
        for node, t in transfers.items()
        if t.is_done and t.error is None
    }


def _send(port: BusPort, frame: Frame) -> list[Frame]:
    """Send as soon as the queue has room, and what was heard meanwhile; BusBusy if it never has."""
    frames: list[Frame] = []
    for tries_left in reversed(range(ROOM_TRIES)):
        try:
            port.send(frame)
            break
        except BusBusy:
            if not tries_left:
                raise
            frames += _heard(port, 10 * PACE_S)
    return frames


def _heard(port: BusPort, for_s: float) -> list[Frame]:
    end_s = time.monotonic() + for_s
    frames: list[Frame] = []
    while (left_s := end_s - time.monotonic()) > 0.0:
        select.select([port], [], [], left_s)
        frames += [stamped.frame for stamped in port.receive()]
    return frames
