"""What travels in the process data of one drive, and the units in which it counts."""

from __future__ import annotations

from typing import Final, Literal

from hil.config import Actuator, RigFile
from hil.drives.cia402.codec import Field, PdoLayout
from hil.drives.meaning import SetpointKind
from hil.errors import ConfigError
from hil.signals import Quantity

CONTROL: Final = Field("control word", 0x6040, 0, 2, False)
STATUS: Final = Field("status word", 0x6041, 0, 2, False)
POSITION: Final = Field("position", 0x6064, 0, 4, True)
TORQUE: Final = Field("torque", 0x6077, 0, 2, True)

CyclicMode = Literal["csp", "ip", "csv", "cst"]
MODE_CODES: Final[dict[CyclicMode, int]] = {"ip": 7, "csp": 8, "csv": 9, "cst": 10}
"""0x6060's values; the mode's bit in 0x6502 is one less (CiA 402-2, modes of operation) [M]."""
HOMING_MODE: Final = 6
TARGETS: Final[dict[CyclicMode, Field]] = {
    "csp": Field("target position", 0x607A, 0, 4, True),
    "ip": Field("interpolation set-point", 0x60C1, 1, 4, True),
    "csv": Field("target velocity", 0x60FF, 0, 4, True),
    "cst": Field("target torque", 0x6071, 0, 2, True),
}
KIND_OF: Final[dict[CyclicMode, SetpointKind]] = {
    "csp": "position",
    "ip": "position",
    "csv": "velocity",
    "cst": "force",
}
TPDO: Final = PdoLayout((STATUS, POSITION, TORQUE))


def rpdo(mode: CyclicMode) -> PdoLayout:
    """Our process data to a drive in `mode`: control word and target."""
    return PdoLayout((CONTROL, TARGETS[mode]))


def supports(modes: int, mode: CyclicMode) -> bool:
    """Whether a drive whose 0x6502 is `modes` has `mode`."""
    return bool(modes >> (MODE_CODES[mode] - 1) & 1)


def candidates(rig: RigFile, actuator: Actuator) -> tuple[CyclicMode, ...]:
    """The modes that would do, the best first; which of them the drive has is known at boot.

    Whatever reckons forces needs cst. Positions go by csp, else by ip, whose process data has the same form;
    where the rig file wants the position loop in the daemon, by csv.
    """
    if rig.control.mode != "drive":
        return ("cst",)
    return ("csv",) if actuator.drive.cyclic == "velocity" else ("csp", "ip")


class Units:
    """Increments, increments/s and thousandths of the rated torque to SI at the output, and back."""

    def __init__(self, actuator: Actuator) -> None:
        node = actuator.drive
        self._counts = node.counts_per_unit
        self._force = node.force_per_count
        if actuator.force_max / node.force_per_count > 32767:
            raise ConfigError(
                f"{actuator.name}: drive.force_per_count = {node.force_per_count:g} N is a thousandth of the "
                f"rated torque; force_max {actuator.force_max:g} N would be over 32 times that: correct one"
            )

    def si(self, kind: SetpointKind, raw: int) -> float:
        """SI value of a target or an actual value."""
        return raw * self._force if kind == "force" else raw / self._counts

    def raw(self, kind: SetpointKind, value: float) -> float:
        """The target, not rounded yet."""
        return value / self._force if kind == "force" else value * self._counts

    def measured(self, quantity: Quantity, raw: int) -> float:
        """SI value of an actual value."""
        return raw * self._force if quantity == "force" else raw / self._counts
