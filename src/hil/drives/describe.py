"""Frames of a rig's bus in words, for people who look at it: whose frame it is and what it says.

Pure, and apart from drivers and gate: what cannot be read is said to be so, nothing is raised.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import get_args

from hil.config import RigFile
from hil.drives import imu_node
from hil.drives.lust_cdd3000 import codec
from hil.drives.lust_cdd3000.scales import Scales, kind_of
from hil.drives.power import PowerState
from hil.drives.profile import LustProfile, Parameter, Parameters, WireType
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.signals import Quantity
from hil.units import quantity_unit


@dataclass(frozen=True, slots=True)
class Described:
    """What a frame is: whose (an actuator, "imu", "rig"; "" where unknown), which, and in words."""

    source: str
    name: str
    text: str
    values: Mapping[str, float] = field(default_factory=dict)
    """Numbers in it, SI, by quantity."""


class Describer:
    """Reads the frames that a rig file and its drive file explain."""

    def __init__(self, rig: RigFile, profile: LustProfile) -> None:
        self._profile = profile
        self._kind = kind_of(rig, profile)
        self._is_rotary = rig.is_rotary
        self._imu_id = rig.can.imu_base_id if rig.imu else None
        self._names = parameter_names(profile.parameters)
        self._readers: dict[int, tuple[str, str, Callable[[Frame], Described]]] = {}
        for i, actuator in enumerate(rig.actuators):
            ids = codec.frame_ids(profile.ids, rig.address(i))
            name, scales = actuator.name, Scales(actuator.drive, profile)
            self._readers |= {
                ids.control: (name, "control", self._reader(self._control, name, scales)),
                ids.status: (name, "status", self._reader(self._status, name, scales)),
                ids.request: (name, "request", self._reader(self._request, name, scales)),
                ids.answer: (name, "answer", self._reader(self._answer, name, scales)),
                ids.error: (name, "error", self._reader(self._error, name, scales)),
                ids.log_on: (name, "log-on", self._reader(self._log_on, name, scales)),
            }
        system = profile.ids.system
        self._readers[system] = ("rig", "system", self._system)

    def describe(self, frame: Frame) -> Described:
        """What `frame` says; never raises."""
        if frame.is_error:
            return Described("", "bus error", f"controller reports class {frame.can_id:#x}")
        if self._imu_id is not None and frame.can_id in (self._imu_id, self._imu_id + 1):
            return describe_imu(self._imu_id, frame)
        source, name, read = self._readers.get(frame.can_id, ("", "", None))
        if frame.is_extended or read is None:
            return Described("", "unknown", "no frame of this rig")
        if frame.is_remote:
            return Described(source, name, "a remote frame, which nobody here sends")
        try:
            return read(frame)
        except ProtocolError as error:
            return Described(source, name, f"cannot be read: {error}")

    @staticmethod
    def _reader(
        read: Callable[[str, Scales, bytes], Described], name: str, scales: Scales
    ) -> Callable[[Frame], Described]:
        return lambda frame: read(name, scales, frame.data)

    def _control(self, who: str, scales: Scales, data: bytes) -> Described:
        control = codec.decode_control(self._profile.layout, data)
        value = scales.setpoint(self._kind, control.reference)
        command = control.command.name.lower().replace("_", " ")
        return Described(
            who, "control", f"{command}, {self._shown(self._kind, value)}", {"setpoint": value}
        )

    def _status(self, who: str, scales: Scales, data: bytes) -> Described:
        status = codec.decode_status(self._profile.layout, data)
        words = [str(status.power)]
        if not status.enpo and status.power is not PowerState.NOT_READY:
            words.append("no ENPO")
        if status.referenced:
            words.append("referenced")
        if not self._profile.layout.status_carries_position:
            return Described(who, "status", ", ".join(words))
        value = scales.setpoint("position", status.actual)
        words.append(self._shown("position", value))
        return Described(who, "status", ", ".join(words), {"position": value})

    def _request(self, who: str, scales: Scales, data: bytes) -> Described:
        number, mode, raw, _ = codec.decode_request(data)
        if mode == codec.Mode.READ:
            return Described(who, "request", f"read {self._parameter(number)}")
        verb = "write" if mode == codec.Mode.WRITE else f"mode {mode} on"
        return Described(who, "request", f"{verb} {self._parameter(number, raw)}")

    def _answer(self, who: str, scales: Scales, data: bytes) -> Described:
        answer = codec.decode_answer(data)
        if answer.status:
            text = f"{self._parameter(answer.number)}: {answer.status}"
            return Described(who, "answer", text)
        for quantity in get_args(Quantity):
            if scales.parameters[quantity].number == answer.number:
                value = scales.measured(quantity, answer.value)
                text = f"{quantity} {self._shown(quantity, value)}"
                return Described(who, "answer", text, {quantity: value})
        return Described(who, "answer", self._parameter(answer.number, answer.value))

    def _parameter(self, number: int, raw: int | None = None) -> str:
        """Name of a parameter of the drive file, and the value that `raw` stands for."""
        name, kind, scale = self._names.get(number, (f"parameter {number}", "int32", 1.0))
        return name if raw is None else f"{name} = {codec.from_wire(kind, raw) * scale:g}"

    def _error(self, who: str, scales: Scales, data: bytes) -> Described:
        report = codec.decode_error(self._profile.error_frame, data)
        said = "without a number" if report.code is None else self._profile.error_text(report.code)
        return Described(who, "error", said)

    @staticmethod
    def _log_on(who: str, scales: Scales, data: bytes) -> Described:
        return Described(who, "log-on", "logs on")

    def _system(self, frame: Frame) -> Described:
        byte = codec.decode_system(frame.data)
        names = {self._profile.system.start: "start", self._profile.system.stop: "stop"}
        return Described("rig", "system", names.get(byte, f"byte {byte:#04x}"))

    def _shown(self, quantity: str, value: float) -> str:
        digits = 6 if quantity == "position" else 3
        return f"{value:+.{digits}f} {quantity_unit(quantity, is_rotary=self._is_rotary)}"


def describe_imu(base_id: int, frame: Frame) -> Described:
    """What a frame of the IMU node says."""
    name = "gyro" if frame.can_id == base_id else "accel"
    try:
        reading = imu_node.decode(base_id, frame)
    except ProtocolError as error:
        return Described("imu", name, f"cannot be read: {error}")
    values = {f"{name}_{axis}": v for axis, v in zip("xyz", reading.values, strict=True)}
    shown = " ".join(f"{v:+.4f}" for v in reading.values)
    return Described("imu", name, f"{shown} {quantity_unit(name)}  no. {reading.counter}", values)


def parameter_names(parameters: Parameters) -> dict[int, tuple[str, WireType, float]]:
    """Name, type on the wire and scale of each parameter that the drive file names."""
    groups = (parameters.measurements, parameters.precontrol, parameters.gains)
    names: dict[int, tuple[str, WireType, float]] = {}
    for group, words in zip(groups, ("{}", "{} pre-control", "{} gain"), strict=True):
        for key in type(group).model_fields:
            parameter: Parameter = getattr(group, key)
            names[parameter.number] = (words.format(key), parameter.type, parameter.scale)
    names[parameters.watchdog.number] = ("watchdog", "int32", parameters.watchdog.unit)
    names[parameters.operating_mode.number] = ("operating mode", "int32", 1.0)
    return names
