"""CANopen frames of a rig's bus in words: whose frame it is and what it says. Pure; nothing is raised."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from hil.config import RigFile
from hil.drives.cia402 import codec
from hil.drives.cia402.aborts import ABORTS
from hil.drives.cia402.mapping import KIND_OF, TPDO, Units, candidates, rpdo
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.describe import Described, describe_imu
from hil.drives.power import decode_control_word, decode_status_word
from hil.drives.profiles import Profiles
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.units import quantity_unit

_UNKNOWN: Final = Described("", "unknown", "no frame of this rig")
_SDO: Final = {
    0x20: "write",
    0x40: "read",
    0x60: "next segment, please",
    0x00: "segment",
    0x80: "abort",
}
_ANSWER: Final = {
    0x60: "is written",
    0x40: "is",
    0x20: "segment is taken",
    0x00: "segment",
    0x80: "abort",
}


class CanopenDescriber:
    """Reads the frames of the CANopen drives of a rig file."""

    def __init__(self, rig: RigFile, profiles: Profiles) -> None:
        self._is_rotary = rig.is_rotary
        self._imu_id = rig.can.imu_base_id if rig.imu else None
        self._names = {rig.address(i): a.name for i, a in enumerate(rig.actuators)}
        self._readers: dict[int, tuple[str, str, Callable[[bytes], Described]]] = {}
        for i, actuator in enumerate(rig.actuators):
            profile = profiles[actuator.drive.profile]
            if isinstance(profile, Cia402Profile):
                self._add(rig, i, profile)

    def _add(self, rig: RigFile, i: int, profile: Cia402Profile) -> None:
        actuator = rig.actuators[i]
        ids, name, units = codec.node_ids(rig.address(i)), actuator.name, Units(actuator)
        mode = candidates(rig, actuator)[0]
        layout, kind = rpdo(mode), KIND_OF[mode]

        def setpoint(data: bytes) -> Described:
            word, target = layout.unpack(data)
            value = units.si(kind, target)
            command = decode_control_word(word).name.lower().replace("_", " ")
            return Described(
                name, "setpoint", f"{command}, {self._shown(kind, value)}", {"setpoint": value}
            )

        def answer(data: bytes) -> Described:
            word, position, torque = TPDO.unpack(data)
            values = {
                "position": units.measured("position", position),
                "force": units.measured("force", torque),
            }
            shown = ", ".join(self._shown(q, v) for q, v in values.items())
            return Described(name, "status", f"{decode_status_word(word)}, {shown}", values)

        def emergency(data: bytes) -> Described:
            said = codec.decode_emcy(data)
            text = profile.error_text(said.code) if said.code else "no error any more"
            return Described(name, "emergency", text)

        def heartbeat(data: bytes) -> Described:
            state = codec.decode_heartbeat(data)
            is_boot = state is codec.NmtState.BOOT_UP
            return Described(name, "boot-up" if is_boot else "heartbeat", str(state))

        self._readers |= {
            ids.rpdo: (name, "setpoint", setpoint),
            ids.tpdo: (name, "status", answer),
            ids.emcy: (name, "emergency", emergency),
            ids.heartbeat: (name, "heartbeat", heartbeat),
            ids.sdo_request: (name, "request", _sdo(name, "request", _SDO, profile)),
            ids.sdo_answer: (name, "answer", _sdo(name, "answer", _ANSWER, profile)),
            codec.NMT_ID: ("rig", "network", self._network),
            codec.SYNC_ID: ("rig", "sync", lambda _: Described("rig", "sync", "SYNC")),
            codec.HEARTBEAT_BASE + profile.supervision.master_node: (
                "rig",
                "heartbeat",
                lambda _: Described("rig", "heartbeat", "the master is here"),
            ),
        }

    def describe(self, frame: Frame) -> Described:
        """What `frame` says."""
        if self._imu_id is not None and frame.can_id in (self._imu_id, self._imu_id + 1):
            return describe_imu(self._imu_id, frame)
        found = self._readers.get(frame.can_id)
        if frame.is_error or frame.is_extended or found is None:
            return _UNKNOWN
        who, name, read = found
        if frame.is_remote:
            return Described(who, name, "a remote frame, which nobody here sends")
        try:
            return read(frame.data)
        except ProtocolError as error:
            return Described(who, name, f"cannot be read: {error}")

    def _network(self, data: bytes) -> Described:
        command, node = codec.decode_nmt(data)
        whom = self._names.get(node, f"node {node}") if node else "all nodes"
        return Described("rig", "network", f"{command.name.lower().replace('_', ' ')}: {whom}")

    def _shown(self, quantity: str, value: float) -> str:
        number = f"{value:+.{7 if quantity == 'position' else 3}f}"
        return f"{number} {quantity_unit(quantity, is_rotary=self._is_rotary)}"


def _sdo(
    who: str, name: str, verbs: dict[int, str], profile: Cia402Profile
) -> Callable[[bytes], Described]:
    def read(data: bytes) -> Described:
        if len(data) != codec.SDO_LENGTH:
            raise ProtocolError(f"an SDO has {codec.SDO_LENGTH} bytes, not {len(data)}")
        command = data[0] & 0xE0
        verb = verbs.get(command, f"command {data[0]:#04x}")
        if "segment" in verb:
            return Described(who, name, verb)
        key = (data[1] | data[2] << 8, data[3])
        thing = (
            str(profile.objects[key]) if key in profile.objects else f"{key[0]:#06x}:{key[1]:02x}"
        )
        raw = int.from_bytes(data[4:], "little")
        if command == 0x80:
            return Described(who, name, f"{thing}: {ABORTS.get(raw, (f'{raw:#010x}', ''))[0]}")
        carries = (name == "request") == (command == 0x20) and data[0] & 0x02
        if not carries:
            return Described(
                who, name, f"{verb} {thing}" if name == "request" else f"{thing} {verb}"
            )
        size = 4 - (data[0] >> 2 & 3) if data[0] & 1 else 4
        value = int.from_bytes(data[4 : 4 + size], "little")
        text = f"{verb} {thing} = {value:#x}" if name == "request" else f"{thing} {verb} {value:#x}"
        return Described(who, name, text)

    return read
