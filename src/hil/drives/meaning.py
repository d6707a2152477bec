"""What a frame asks of the drives, read back from its bytes.

The gate judges what goes out by what it *means*, not by what somebody meant to send: each drive family
gives it a `FrameMeaning`, which decodes the master's frames with the family's frame layout and nothing
else of the driver that made them. Whatever cannot be read back in full is `UNKNOWN` and goes nowhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, unique
from typing import Final, Literal, NamedTuple, Protocol

from hil.config import RigFile
from hil.drives.lust_cdd3000 import codec
from hil.drives.power import PowerCommand
from hil.drives.profile import LustProfile, Parameters

SetpointKind = Literal["position", "force", "velocity"]
"""m or rad in the rig file's coordinates, N or N·m, or m/s or rad/s; at the actuator's output."""


@unique
class Ask(Enum):
    """What a frame of ours asks for."""

    POWER_OFF = "power_off"
    """One drive without force: disabled, stopped, or ready to be switched on. Its reference moves nothing."""
    POWER_ON = "power_on"
    """One drive's power stage on or towards on, with a setpoint: without one it goes nowhere."""
    FAULT_RESET = "fault_reset"
    """One drive's latched error cleared; its power stage stays off."""
    SYSTEM_START = "system_start"
    """All drives execute the control words they hold, together."""
    SYSTEM_STOP = "system_stop"
    """All drives stop."""
    READ = "read"
    """One parameter of one drive read."""
    WRITE = "write"
    """One parameter of one drive written."""
    NETWORK = "network"
    """One node, or all, started, stopped or reset as a communication partner (NMT)."""
    SYNC = "sync"
    """The instant for which all drives' values hold."""
    ALIVE = "alive"
    """We are here: our heartbeat."""
    UNKNOWN = "unknown"
    """A frame that the family's layout does not explain in full."""


class Meaning(NamedTuple):
    """What one frame asks. Fields that the ask does not need are None."""

    ask: Ask
    actuator: int | None = None
    """Index in the rig file's list of actuators; None: all drives, or none known."""
    kind: SetpointKind | None = None
    setpoint: float | None = None
    """In the kind's unit."""
    parameter: int | None = None
    value: int | None = None
    """Raw value of a write."""
    text: str = ""
    """Why a frame is UNKNOWN."""
    actuators: tuple[int, ...] | None = None
    """Whom an ask without an actuator concerns; None: all."""


class FrameMeaning(Protocol):
    """A drive family's own reading of the frames its master sends."""

    @property
    def lengths(self) -> Mapping[int, int]:
        """The allow-list: identifier of every frame the master may send, and its data length, bytes."""
        ...

    def writable(self, i: int) -> frozenset[int]:
        """Numbers of the parameters of actuator i's drive that its profile lets the master write."""
        ...

    def meaning(self, can_id: int, data: bytes) -> Meaning:
        """What a frame with an allowed identifier and length asks; Ask.UNKNOWN, never an error."""
        ...


_WITHOUT_FORCE: Final = frozenset(
    {PowerCommand.DISABLE, PowerCommand.QUICK_STOP, PowerCommand.PREPARE}
)
_DRIVECOM_WORDS: Final = frozenset(command.value for command in PowerCommand)
_POSMOD_BYTES: Final = frozenset({0x00, 0x01, 0x80})
_POSMOD_FLAGS: Final = 0x03


class CanlustMeaning:
    """Reads CANLust frames: System Start/Stop, control frames, parameter requests.

    A log-on needs no frame of its own: the drive is answered by its first parameter request. Bits and bytes
    that the layout leaves unused must be zero; jog, field and string requests are nothing that hil asks, so
    they are UNKNOWN.
    """

    def __init__(self, rig: RigFile, profile: LustProfile, kind: SetpointKind) -> None:
        self._layout = profile.layout
        self._system = profile.system
        self._system_id = profile.ids.system
        self._kind = kind
        self._units = tuple(
            1.0 / a.drive.counts_per_unit if kind == "position" else a.drive.force_per_count
            for a in rig.actuators
        )
        ids = [codec.frame_ids(profile.ids, rig.address(i)) for i in range(len(self._units))]
        self._controls = {drive.control: i for i, drive in enumerate(ids)}
        self._requests = {drive.request: i for i, drive in enumerate(ids)}
        self.lengths: Mapping[int, int] = {
            self._system_id: codec.SYSTEM_LENGTH,
            **dict.fromkeys(self._controls, codec.FRAME_LENGTH),
            **dict.fromkeys(self._requests, codec.FRAME_LENGTH),
        }
        self._writable = writable_parameters(profile.parameters)

    def writable(self, i: int) -> frozenset[int]:
        """Numbers of the parameters that may be written: all drives have one profile."""
        return self._writable

    def meaning(self, can_id: int, data: bytes) -> Meaning:
        """What a frame asks; its identifier and length are those of `lengths`."""
        if can_id == self._system_id:
            return self._of_system(codec.decode_system(data))
        if can_id in self._controls:
            return self._of_control(self._controls[can_id], data)
        return self._of_request(self._requests[can_id], data)

    def _of_system(self, byte: int) -> Meaning:
        if byte == self._system.start:
            return Meaning(Ask.SYSTEM_START)
        if byte == self._system.stop:
            return Meaning(Ask.SYSTEM_STOP)
        return Meaning(Ask.UNKNOWN, text=f"System byte {byte:#04x} is neither start nor stop")

    def _of_control(self, i: int, data: bytes) -> Meaning:
        stray = self._stray_bits(data)
        if stray:
            return Meaning(Ask.UNKNOWN, i, text=stray)
        control = codec.decode_control(self._layout, data)
        if control.command in _WITHOUT_FORCE:
            return Meaning(Ask.POWER_OFF, i)
        if control.command is PowerCommand.RESET:
            return Meaning(Ask.FAULT_RESET, i)
        return Meaning(
            Ask.POWER_ON, i, kind=self._kind, setpoint=control.reference * self._units[i]
        )

    def _stray_bits(self, data: bytes) -> str:
        """What in a control frame is no command that hil gives; empty where all is."""
        rest = bytearray(data)
        rest[self._layout.value_byte : self._layout.value_byte + 4] = bytes(4)
        if self._layout.kind == "drivecom":
            word = int.from_bytes(rest[:2], "little")
            if word not in _DRIVECOM_WORDS:
                return f"control word {word:#06x} is no command"
            rest[:2] = bytes(2)
        else:
            if rest[0] not in _POSMOD_BYTES:
                return f"control byte {rest[0]:#04x} is no command"
            rest[0] = 0
            rest[self._layout.flags_byte] &= ~_POSMOD_FLAGS
        return "bits are set that have no meaning here" if any(rest) else ""

    def _of_request(self, i: int, data: bytes) -> Meaning:
        number, mode, value, _ = codec.decode_request(data)
        if mode == codec.Mode.READ:
            return Meaning(Ask.READ, i, parameter=number)
        if mode == codec.Mode.WRITE:
            return Meaning(Ask.WRITE, i, parameter=number, value=value)
        return Meaning(Ask.UNKNOWN, i, text=f"parameter requests of mode {mode} are never made")


def writable_parameters(parameters: Parameters) -> frozenset[int]:
    """Numbers of the parameters that a CANLust profile lets the master write."""
    ahead = parameters.precontrol
    return frozenset(
        {
            parameters.watchdog.number,
            parameters.operating_mode.number,
            ahead.velocity.number,
            ahead.acceleration.number,
            ahead.friction.number,
        }
    )
