"""SDO abort codes by name (CiA 301, table of SDO abort codes [M])."""

from __future__ import annotations

from typing import Final

from hil.errors import DriveError

ABORTS: Final[dict[int, tuple[str, str]]] = {
    0x0503_0000: ("toggle_bit", "the toggle bit did not alternate"),
    0x0504_0000: ("timeout", "the SDO protocol timed out"),
    0x0504_0001: ("unknown_command", "the command specifier is not known"),
    0x0504_0002: ("block_size", "invalid block size"),
    0x0504_0003: ("sequence_number", "invalid sequence number"),
    0x0504_0004: ("crc", "checksum error"),
    0x0504_0005: ("out_of_memory", "out of memory"),
    0x0601_0000: ("unsupported_access", "the object cannot be accessed so"),
    0x0601_0001: ("write_only", "the object can only be written"),
    0x0601_0002: ("read_only", "the object can only be read"),
    0x0602_0000: ("no_object", "the object does not exist in the drive"),
    0x0604_0041: ("not_mappable", "the object cannot be mapped to a PDO"),
    0x0604_0042: ("pdo_length", "the objects mapped would exceed the PDO's length"),
    0x0604_0043: ("incompatible_parameter", "the parameter is incompatible"),
    0x0604_0047: ("incompatible_device", "internal incompatibility in the device"),
    0x0606_0000: ("hardware", "access failed for a hardware error"),
    0x0607_0010: ("data_length", "the data type or its length does not match"),
    0x0607_0012: ("data_too_long", "the data is too long"),
    0x0607_0013: ("data_too_short", "the data is too short"),
    0x0609_0011: ("no_subindex", "the subindex does not exist"),
    0x0609_0030: ("value_range", "the value is outside the parameter's range"),
    0x0609_0031: ("value_too_high", "the value is too high"),
    0x0609_0032: ("value_too_low", "the value is too low"),
    0x0609_0036: ("maximum_below_minimum", "the maximum is less than the minimum"),
    0x060A_0023: ("resource", "a resource is not available"),
    0x0800_0000: ("general", "general error"),
    0x0800_0020: ("not_stored", "the data cannot be stored"),
    0x0800_0021: ("local_control", "the data cannot be stored: the device is under local control"),
    0x0800_0022: ("device_state", "the data cannot be stored in the present state of the device"),
    0x0800_0023: ("no_dictionary", "there is no object dictionary"),
    0x0800_0024: ("no_data", "there is no data"),
}
"""Code: its stable name and what it means."""

CODES: Final = {name: code for code, (name, _) in ABORTS.items()}
"""Code by name."""


class SdoAbort(DriveError):
    """A transfer was aborted, by the drive or, for want of a valid answer, by us."""

    def __init__(self, code: int, what: str = "") -> None:
        self.code = code
        self.name, meaning = ABORTS.get(
            code, ("unknown", "an abort code that CiA 301 does not list")
        )
        super().__init__(f"{what}{': ' if what else ''}{meaning} ({self.name}, {code:#010x})")


class SdoTimeout(DriveError):
    """A node did not answer a request in time, nor when it was asked again."""
