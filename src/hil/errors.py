"""The errors of hil: one root, leaves by cause, each a sentence that says what to do next.

HilError
├── ConfigError          a rig or drive file is wrong: names file, key and bound
├── KinematicsError      no pose closes the mechanism, or it is singular there
├── LimitViolation       something asked for lies outside a limit of the rig
├── ProtocolError        a frame or message is not what its protocol allows
├── BusError             the bus cannot carry frames
│   ├── BusOff           the controller left the bus after too many errors
│   └── BusBusy          the transmit queue is full (ENOBUFS)
├── DriveError           a drive refused, failed or fell silent: names the drive
├── RigNotReached        no daemon of this rig answers at the endpoint, or it fell silent
├── RigInUse             another daemon already runs this rig
├── CommandRefused       the rig's state does not allow this command
├── RunError             a recording cannot be read: names file, column and row
└── IdentificationError  these data cannot answer what was asked: names signal or parameter, and what to do
"""

from __future__ import annotations


class HilError(Exception):
    """Root of all errors that hil raises on purpose."""


class ConfigError(HilError):
    """A rig or drive file is wrong. The message names the file, the key and the bound."""


class KinematicsError(HilError):
    """The mechanism cannot be closed at the pose or actuator positions asked for."""


class LimitViolation(HilError):
    """Something asked for lies outside a limit of the rig. The message names the rule."""


class ProtocolError(HilError):
    """A frame or message is not what its protocol allows."""


class BusError(HilError):
    """The bus cannot carry frames."""


class BusOff(BusError):
    """The CAN controller has left the bus after too many errors."""


class BusBusy(BusError):
    """The transmit queue is full: frames are produced faster than the bus carries them."""


class DriveError(HilError):
    """A drive refused, failed or fell silent. The message names the drive."""


class RigNotReached(HilError):
    """No daemon of this rig answers at the endpoint, or it has fallen silent."""


class RigInUse(HilError):
    """Another daemon already runs this rig."""


class CommandRefused(HilError):
    """The rig's state does not allow this command."""


class RunError(HilError):
    """A recording cannot be read. The message names file, column and row."""


class IdentificationError(HilError):
    """These data cannot answer what was asked. The message names the signal and what to do."""
