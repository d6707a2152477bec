"""What is written to a drive before it may be enabled, and how it is checked.

Each setting is read first: where the drive already holds it, nothing is written; where it holds a value
that this parameter cannot have, the drive file's number is wrong and nothing is written either. Then it is
written, another parameter is read as a barrier, and it is read back. The barrier is there because a drive
answers in order: once it is answered, no late answer to the write can pass for the read-back.
The watchdog is always written.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from hil.config import Actuator, RigFile
from hil.drives.lust_cdd3000.codec import Answer, Mode, Request, from_wire, to_wire
from hil.drives.meaning import SetpointKind
from hil.drives.profile import LustProfile, WireType
from hil.errors import ConfigError

GAIN_TOLERANCE: Final = 0.01
"""Share by which a gain may differ from the rig file's before it is worth telling."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter and the value it must have. Values are wire values, before scaling."""

    name: str
    number: int
    type: WireType
    target: int
    lowest: float
    highest: float
    always_written: bool = False
    scale: float = 1.0

    def shown(self, raw: int) -> str:
        """A value on the wire as a person reads it."""
        return f"{from_wire(self.type, raw) * self.scale:g}"


@dataclass(frozen=True, slots=True)
class Gain:
    """A loop gain of the drive that the rig file also states, SI."""

    name: str
    number: int
    type: WireType
    scale: float
    expected: float


def settings_of(
    rig: RigFile, actuator: Actuator, profile: LustProfile, kind: SetpointKind
) -> tuple[Setting, ...]:
    """What this rig wants of a drive, the watchdog first; ConfigError where a parameter cannot hold it."""
    parameters = profile.parameters
    dog = parameters.watchdog
    increments = round(rig.safety.drive_watchdog / dog.unit)
    if not 1 <= increments <= dog.largest:
        raise ConfigError(
            f"safety.drive_watchdog = {rig.safety.drive_watchdog} s is {increments} increments of "
            f"parameter {dog.number}, which takes 1..{dog.largest}"
        )
    mode = parameters.operating_mode
    settings = [
        Setting("watchdog", dog.number, "int32", increments, 0, dog.largest, True, dog.unit),
        Setting(
            "operating mode",
            mode.number,
            "int32",
            mode.position if kind == "position" else mode.force,
            min(mode.position, mode.force),
            max(mode.position, mode.force),
        ),
    ]
    ahead = parameters.precontrol
    whole = rig.control.precontrol and kind == "position"
    for name, parameter, share in (
        ("velocity pre-control", ahead.velocity, actuator.velocity_ff),
        ("acceleration pre-control", ahead.acceleration, actuator.acceleration_ff),
        ("friction pre-control", ahead.friction, actuator.friction_ff),
    ):
        value = 1.0 if whole else share
        settings.append(
            Setting(
                name,
                parameter.number,
                parameter.type,
                to_wire(parameter.type, value / parameter.scale),
                0.0,
                2.0 / parameter.scale,
                scale=parameter.scale,
            )
        )
    return tuple(settings)


def gains_of(actuator: Actuator, profile: LustProfile) -> tuple[Gain, ...]:
    """The loop gains to read and compare."""
    gains = profile.parameters.gains
    return tuple(
        Gain(name, p.number, p.type, p.scale, expected)
        for name, p, expected in (
            ("position gain", gains.position, actuator.position_gain),
            ("speed gain", gains.speed, actuator.speed_gain),
            ("integral gain", gains.integral, actuator.integral_gain),
        )
    )


class _Step(Enum):
    LOOK = auto()
    WRITE = auto()
    BARRIER = auto()
    VERIFY = auto()


class Configuration:
    """Works through settings and gains, one request at a time."""

    failure_name = "drive_not_configured"

    def __init__(
        self, settings: tuple[Setting, ...], gains: tuple[Gain, ...], barrier: int
    ) -> None:
        self._settings = settings
        self._gains = gains
        self._barrier = barrier
        self.restart()

    def restart(self) -> None:
        """Nothing is verified any more."""
        self._done = 0
        self._step = self._first_step()
        self._gains_read = 0
        self.failure: str | None = None
        self.notes: list[str] = []

    @property
    def watchdog_ok(self) -> bool:
        """The watchdog has been written and read back."""
        return self._done > 0

    @property
    def done(self) -> bool:
        """Every setting has been verified and every gain looked at."""
        return self._done == len(self._settings) and self._gains_read == len(self._gains)

    def request(self) -> Request | None:
        """What to ask next; None when done or failed."""
        if self.failure is not None or self.done:
            return None
        if self._done == len(self._settings):
            return Request(self._gains[self._gains_read].number, Mode.READ)
        setting = self._settings[self._done]
        if self._step is _Step.WRITE:
            return Request(setting.number, Mode.WRITE, setting.target)
        number = self._barrier if self._step is _Step.BARRIER else setting.number
        return Request(number, Mode.READ)

    def answered(self, request: Request, answer: Answer) -> None:
        """Take the answer to a request; answers to requests that it did not make are left alone."""
        if request != self.request():
            return
        if self._done == len(self._settings):
            self._read_gain(answer)
            return
        setting = self._settings[self._done]
        what = f"parameter {request.number} ({setting.name})"
        if self._step is _Step.BARRIER:
            self._step = _Step.VERIFY
        elif answer.status:
            verb = "write" if request.mode is Mode.WRITE else "read"
            self.failure = f"{verb} of {what} was refused: {answer.status}"
        elif self._step is _Step.LOOK:
            self._look(setting, answer.value, what)
        elif self._step is _Step.WRITE:
            self._step = _Step.BARRIER
        elif answer.value != setting.target:
            self.failure = (
                f"wrote {setting.shown(setting.target)} to {what}, but it reads "
                f"{setting.shown(answer.value)}"
            )
        else:
            self._next_setting()

    def _look(self, setting: Setting, raw: int, what: str) -> None:
        if raw == setting.target:
            self._next_setting()
        elif setting.lowest <= from_wire(setting.type, raw) <= setting.highest:
            self._step = _Step.WRITE
        else:
            self.failure = (
                f"{what} holds {setting.shown(raw)}, which it cannot: nothing was written; "
                "correct its number or type in the drive file"
            )

    def _next_setting(self) -> None:
        self._done += 1
        self._step = self._first_step()

    def _first_step(self) -> _Step:
        more = self._done < len(self._settings)
        return _Step.WRITE if more and self._settings[self._done].always_written else _Step.LOOK

    def _read_gain(self, answer: Answer) -> None:
        gain = self._gains[self._gains_read]
        self._gains_read += 1
        if answer.status:
            self.notes.append(f"{gain.name} cannot be read: {answer.status}")
            return
        value = from_wire(gain.type, answer.value) * gain.scale
        if not abs(value - gain.expected) <= GAIN_TOLERANCE * abs(gain.expected):
            self.notes.append(
                f"{gain.name} in the drive is {value:g}, the rig file says {gain.expected:g}"
            )
