"""Whether the CANopen drives of a rig are there: who is heard, who answers, and who they say they are."""

from __future__ import annotations

import time
from collections.abc import Callable

from hil.bus.port import BusPort
from hil.config import RigFile
from hil.daemon.check.finding import Finding
from hil.drives import build_drivers
from hil.drives.cia402 import codec
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.cia402.sdo import Transfer
from hil.drives.profiles import Profiles
from hil.frames import Frame
from hil.safety import Gate, gate_limits

Heard = Callable[..., list[Frame]]
REMEDY = "is it powered, on this bus, at this bit rate, and set to this node?"


def heard_of(rig: RigFile, seen: set[int]) -> list[Finding]:
    """Which of the rig's nodes said something, and whether nodes of no actuator did."""
    found = []
    nodes = [rig.address(i) for i in range(len(rig.actuators))]
    for name, node in zip(rig.actuator_names, nodes, strict=True):
        ids = codec.node_ids(node)
        if seen & {ids.heartbeat, ids.tpdo, ids.emcy, ids.sdo_answer}:
            found.append(Finding("ok", "drives", f"{name} (node {node}) is on the bus"))
        else:
            text = f"{name} (node {node}) says nothing"
            remedy = f"{REMEDY} A node without heartbeat keeps quiet until it is asked: try --ask"
            found.append(Finding("warn", "drives", text, remedy))
    base = codec.HEARTBEAT_BASE
    for node in sorted(i - base for i in seen if base < i <= base + codec.LARGEST_NODE):
        if node not in nodes:
            text = f"node {node} is on the bus, which no actuator has"
            found.append(Finding("warn", "drives", text, "correct actuators.drive.address"))
    return found


def ask(
    rig: RigFile, profiles: Profiles, port: BusPort, heard: Heard, wait_s: float
) -> list[Finding]:
    """Read each drive's vendor and product, through the gate as everything that leaves."""
    found = []
    gate = _gate(rig, profiles)
    for i, actuator in enumerate(rig.actuators):
        profile = profiles[actuator.drive.profile]
        assert isinstance(profile, Cia402Profile)
        ids, who = codec.node_ids(rig.address(i)), f"{actuator.name} (node {rig.address(i)})"
        told: list[int] = []
        for sub in (1, 2):
            transfer = Transfer(0x1018, sub)
            request = Frame(ids.sdo_request, transfer.request)
            if not gate.pass_frame(time.monotonic(), request).ok:
                break
            port.send(request)
            for frame in heard(port, wait_s, ids.sdo_answer):
                is_answer = frame.can_id == ids.sdo_answer and transfer.fits(frame.data)
                if is_answer and not transfer.is_done:
                    transfer.take(frame.data)
            if not transfer.is_done or transfer.error is not None:
                break
            told.append(int.from_bytes(transfer.result, "little"))
        if len(told) < 2:
            found.append(Finding("fault", "drives", f"{who} does not answer", REMEDY))
            continue
        vendor, product = told
        is_ours = (vendor, product) == (profile.objects.vendor, profile.objects.product)
        text = f"{who} answers: vendor {vendor:#x}, product {product:#x}"
        if is_ours or profile.objects.vendor is None:
            found.append(Finding("ok", "drives", text))
        else:
            remedy = "put the EDS of this drive into its drive folder, or name its folder in drive.profile"
            found.append(Finding("fault", "drives", f"{text}, of which its EDS is not", remedy))
    return found


def release(rig: RigFile, profiles: Profiles) -> list[Frame]:
    """What makes the nodes forget that they had a master: their heartbeat consumers would miss it."""
    gate = _gate(rig, profiles)
    reset = codec.NmtCommand.RESET_COMMUNICATION
    frames = [
        Frame(codec.NMT_ID, codec.encode_nmt(reset, rig.address(i)))
        for i in range(len(rig.actuators))
    ]
    return [frame for frame in frames if gate.pass_frame(time.monotonic(), frame).ok]


def _gate(rig: RigFile, profiles: Profiles) -> Gate:
    """`rig` is the part of a rig on one bus: here that bus is the only one."""
    here = tuple(
        a.model_copy(update={"drive": a.drive.model_copy(update={"bus": 0})}) for a in rig.actuators
    )
    alone = rig.model_copy(update={"actuators": here, "imu": None})
    drives = build_drivers(alone, profiles)
    return Gate(gate_limits(alone, *(d.wire_kind for d in drives)), drives.meaning)
